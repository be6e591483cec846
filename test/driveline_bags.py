"""Bags like those of driveline and recorder, without ROS: ticks of the real-time solver, or columns made by hand."""

import math
from functools import cache

import numpy as np

from tcc_sim.messages import cdr
from tcc_sim.messages.held import held_message
from tcc_sim.plant.driveline import Plant
from tcc_sim.recording.announcements import holding_from
from tcc_sim.recording.bag import BagWriter
from tcc_sim.scene import load_scene
from tcc_sim.solvers.fixed_step import Stepper
from tcc_sim.solvers.terms import holding, terms_of
from tcc_sim.topics import FLOAT64, FLOAT64_ARRAY, FLUID_PRESSURE, HEADER, JOINT_STATE, STRING

TICK = 1_000_000
START = 10**18


def ticked(scene, ticks, *, torque=None, pressure=None, resets=(), changes=(), said=None, sources=None):
    """Rows (stamp, six columns of joint_states, applied pressure) of a driveline; torque and pressure are f(tick), None
    for the scene's own input.

    After a tick in `resets` the driveline starts again; `changes` are (tick, values, None) of parameters set while
    running. The list `said` receives (row, text) of every scene published again, the list `sources` (row, stamp, text)
    of every change of an input's source."""
    stepper, system, changes = Stepper(scene.system,
                                       1.0 / scene.operation.rate), scene.system, {k: rest for k, *rest in changes}
    rows, terms, text = [], terms_of(system), ""

    def say(stamp):
        if said is not None and text:
            said.append((len(rows), holding_from(text, stamp)))

    def publish(applied):
        v, angle, speed, flywheel, engine, friction, _ = stepper.now()
        rows.append((stepper.tick * TICK, flywheel, angle, v + speed, speed, engine, friction, applied))

    def say_source(torque, pressure):
        source = ", ".join(f"{name}: {'fallback' if value is None else 'command'}" for name, value in (
            ("engine_torque", torque), ("actuation_pressure", pressure)))
        if sources is not None and (stepper.tick == 0 or sources[-1][2] != source):
            sources.append((len(rows), stepper.tick * TICK, source))

    say_source(None, None)
    publish(system.pressure.mean)
    for k in range(1, ticks):
        if k in changes:
            values, _ = changes[k]
            after = scene.with_values(values)
            system, text = after.system, after.text()
            terms = terms_of(system)
            stepper.use(terms)
            say((stepper.tick + 1) * TICK)
        engine, applied = (f(k) if f is not None else None for f in (torque, pressure))
        stepper.use(holding(terms, engine, None if applied is None else system.torque_per_pressure * applied))
        stepper.advance()
        say_source(engine, applied)
        publish(math.nan if pressure is None else system.pressure.mean if applied is None else applied)
        if k in resets:
            stepper.reset(system)
            stepper.use(terms)
            say(0)
            say_source(None, None)
            publish(system.pressure.mean)
    return rows


def by_hand(seconds, slip_speed, plate_angle, plate_speed, engine_torque, friction_torque):
    """Rows from functions of time, 1 kHz."""
    t = np.arange(round(seconds * 1000) + 1) * 1e-3
    v, angle, speed, engine, friction = (np.broadcast_to(f(t), t.shape).tolist() for f in
                                         (slip_speed, plate_angle, plate_speed, engine_torque, friction_torque))
    return [(k * TICK, angle[k], angle[k], v[k] + speed[k], speed[k], engine[k], friction[k], math.nan)
            for k in range(len(t))]


def readings(scene, ticks, commanded, far=lambda k: None):
    """Rows of a driveline under pressures commanded(k), Pa; and stamps, angles, speeds (rad/s) and torques of its far
    end, which moves at far(k)."""
    plant, rows, ends = Plant(scene), [], []
    for k in range(ticks):
        if k:
            plant.hold(None, commanded(k))
            plant.move_far_end(far(k))
            plant.advance()
        r = plant.reading()
        rows.append((r.stamp_ns, r.flywheel_angle, r.plate_angle, r.flywheel_speed, r.plate_speed, r.engine_torque,
                     r.friction_torque, r.applied_pressure))
        if plant.stepper.far_end is not None:
            ends.append((r.stamp_ns, r.output_angle, r.output_speed, r.shaft_torque))
    return rows, ends


class Naming:
    """Names of the runs of rows, and the messages of `held` and `scene` before each row, as of version 1.1."""

    def __init__(self, scene, sources, targets, far):
        self._scene, self._at_begin = scene, None if scene is None else scene.text()
        self._sources = {row: dict(part.split(": ") for part in text.split(", ")) for row, _, text, *_ in sources}
        self._targets = {row: value for row, value in targets if math.isfinite(value)}
        self._far = {stamp: (speed, stamp // TICK) for stamp, _, speed, _ in far}
        self._source, self._target, self._process, self._run, self._last = {}, None, 0, 0, math.inf

    def before(self, row, stamp, torque, pressure, first_of_publisher, texts):
        """Messages before a row: (topic, type, data)."""
        out = []
        if begins := stamp < self._last or first_of_publisher:
            self._process, self._run, self._number = (self._process + 1, 1, 0) if first_of_publisher else (
                self._process, self._run + 1, 0)
            self._target = None
            self.name = f"{0x692a0000 + self._process:08x}9b02.{self._run:03d}"
        new = begins or row in self._sources or row in self._targets or stamp in self._far
        self._last, self._source = stamp, self._sources.get(row, self._source)
        if row in self._targets:
            self._target = self._targets[row], stamp // TICK
        texts = [text if "# holds from" in text else holding_from(text, stamp) for text in texts]
        self._at_begin = texts[-1].rpartition("# holds")[0] if texts else self._at_begin
        if begins and self._at_begin is not None and not texts:
            texts = [holding_from(self._at_begin, 0)]
        out += [("/scene", STRING, cdr.string(text.replace("# holds", f"# run {self.name} of /driveline, holds")))
                for text in texts]
        if new or stamp // TICK % 100 == 0:
            self._number += 1
            out.append(("/held", FLOAT64_ARRAY, held_message(self.name, self._values(stamp, torque, pressure))))
        return out

    def _values(self, stamp, torque, pressure):
        values = [stamp // TICK, stamp, self._number, 0]
        for name, group, value in (("engine_torque", "engine", torque), ("actuation_pressure", "pressure", pressure)):
            of_scene = self._scene is None or getattr(self._scene.system, group).source != "topic"
            kind = 0 if of_scene else 1 if self._source.get(name) == "fallback" else 2
            answered = float(stamp - TICK) if (kind, group) == (2, "pressure") else math.nan
            values += [kind, value, value, answered, stamp // TICK, 0, 0, 0, 0, 0]
        for told in (self._far.get(stamp), self._target):  # Value and first tick of a command, None for nobody's.
            values += [3, *[math.nan] * 4, 0, 0, 0, 0, 0] if told is None else [
                2, told[0], told[0], math.nan, told[1], 1, 0, 0, 0, 0]
        return values


def bag(directory, rows, scene, *, said=(), cut=False, clock=None, publishers=None, targets=(), sources=(), ends=(),
        far=(), joined=None, unpressed=(), numbers=None, named=None, **options):
    """Write rows, and scenes published again before some; with `cut` like a recorder that was killed.

    States name their run if `named`, by default where there are `targets`, which only such recordings place.

    `ends` are the messages of the far end, and `far` those of which `held` states the speed.

    `clock` is the driveline's clock as f(row), ns; `publishers` are (first row, name) of the publisher from there on;
    `targets` are (row, rad/s) of a slip controller; `sources` are (row, stamp, text) of the source of the inputs from
    that state on, and the row of the first sending for a repeated message; `joined` are other messages after the state
    of a row, (topic, type, log time, time of sending, data) and perhaps a publisher; `unpressed` are the stamps without
    an applied pressure; `numbers` are the sequence numbers of the states; `options` are those of BagWriter."""
    clock = clock or (lambda number: START + number * TICK)
    scene = load_scene(scene) if isinstance(scene, str) else scene
    writer = BagWriter(directory, scene.text() if scene is not None else None, **options)
    channel = cache(lambda name, kind, who="": writer.channel(name, kind, publisher=who))
    pressed, at_end = not math.isnan(rows[-1][-1]), {row[0]: row for row in ends}
    joints, applied, owner = {}, {}, 0
    naming = Naming(scene, sources, targets, far) if named or (named is None and targets) else None
    spoken = {row for row, *_ in (*said, *targets, *sources)}
    for first, who in publishers or [(0, "")]:
        joints[first] = writer.channel("/joint_states", JOINT_STATE, publisher=who)
        applied[first] = writer.channel("/applied_pressure", FLUID_PRESSURE, publisher=who) if pressed else 0
    for number, (stamp, *columns, pressure) in enumerate(rows):
        log, owner = clock(number), number if number in joints else owner
        frame = ""
        if naming is not None:
            for name, kind, data in naming.before(number, stamp, columns[4], pressure, number in joints,
                                                  [text for row, text in said if row == number]):
                writer.write(channel(name, kind), log - 2, log - 2, data)
            frame = naming.name
        elif number in spoken:
            for text in (text for row, text in said if row == number):
                writer.describe(text, log_ns=log - TICK // 2)
            for value in (value for row, value in targets if row == number):
                writer.write(channel("/target_slip_speed", FLOAT64), log - TICK // 2, log - TICK // 2,
                             cdr.float64(value))
            for since, text, *first in (rest for row, *rest in sources if row == number):
                sent = clock(first[0]) if first else log
                writer.write(channel("/input_source", HEADER), log - 1, sent - 1, cdr.header(since, text))
        writer.write(joints[owner], log, log, cdr.joint_state(stamp, *columns, frame),
                     numbers[number] + 1 if numbers else number)
        if pressed and stamp not in unpressed:
            writer.write(applied[owner], log, log, cdr.fluid_pressure(stamp, pressure, frame=frame), number)
        if stamp in at_end:
            far = cdr.ENCODERS["output_state"](*at_end[stamp], frame=frame)
            writer.write(channel("/output_state", JOINT_STATE), log, log, far, number)
        for name, kind, when, sent, data, *who in (joined or {}).get(number, ()):
            writer.write(channel(name, kind, *who), when, sent, data, number)
        if number % 100 == 99:
            writer.file.flush()
    writer.file.flush()
    if cut:
        writer.abandon()
    else:
        writer.close({"lost": {"/joint_states": 0}})
    return directory
