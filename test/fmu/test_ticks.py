"""The FMU's ticks are the node's, bit by bit, with inputs and parameters that change on the way."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed")

from fmpy.fmi1 import FMICallException
from fmus import Driven, needs_compiler, written

from tcc_sim.errors import InputError
from tcc_sim.model.groups import TABLE, TABULATED
from tcc_sim.model.parameters import QUANTITIES
from tcc_sim.plant.driveline import Plant
from tcc_sim.scene import Scene, load_scene

pytestmark = needs_compiler
TICKS = int(os.environ.get("TCC_SIM_FMU_TICKS", "450"))
"""Ticks of every scene; 100 000 were compared when this was written."""
COMMANDS = ("engine_torque", "engine.mean_torque"), ("actuation_pressure", "pressure.mean")
NAMES = ("slip_speed", "plate_angle", "plate_speed", "flywheel_angle", "flywheel_speed", "applied_engine_torque",
         "friction_torque", "applied_pressure", "shaft_torque")
FIELDS = tuple(name.replace("applied_engine", "engine") for name in NAMES)
V = range(0, 160, 2)
OTHERS: dict[str, tuple[str, dict[str, object]]] = {
    "one_input": ("controlled", {"pressure.fallback": "harmonic", "pressure.amplitude": 2e4}),
    "table": ("fig02", {"converter.coupling": 1.5, "friction.slip_speeds": [float(v) for v in V],
                        "friction.coefficients": [0.2 - 0.02 * math.exp(-0.05 * v) + 0.05 * math.exp(-1.5 * v)
                                                  for v in V]}),
    "constant_table": ("fig02", {"friction.slip_speeds": [0.0, 1.0, 9.0], "friction.coefficients": [0.25, 0.25, 0.25]}),
    "profiles": ("fig02", {
        "engine.frequency_times": [0.0, 0.02, 0.07005], "engine.frequency_values": [100.0, 180.0, 150.0],
        "engine.mean_torque_times": [0.0, 0.035], "engine.mean_torque_values": [250.0, 320.0],
        "pressure.mean_times": [0.0, 0.02, 0.02203, 0.05], "pressure.mean_values": [2e5, 2.6e5, 2.2e5, 2.4e5],
        "engine.harmonic_amplitudes": [40.0, 0.0, 20.0], "engine.harmonic_phases": [0.4, 0.0, 1.0]}),
    "amplitudes": ("fig02", {
        "engine.torque_amplitude_times": [0.0, 0.02, 0.06], "engine.torque_amplitude_values": [150.0, 300.0, 50.0],
        "engine.harmonic_amplitudes": [40.0, 0.0, 10.0], "engine.harmonic_phases": [0.4, 0.0, -1.0],
        "engine.harmonic_amplitudes_times": [0.0, 0.05],
        "engine.harmonic_amplitudes_values": [40.0, 0.0, 10.0, 5.0, 0.0, 60.0]}),
    "actuator": ("controlled", {"pressure.time_constant": 0.03, "pressure.delay": 0.005, "pressure.rate_limit": 5e5}),
    "late_input": ("controlled", {"pressure.delay": 0.003})}
VERSIONS = {name: 2 + place % 2 for place, name in enumerate(["fig02", "commands", *OTHERS])}
"""Version of FMI of every scene."""
STARTS = {"friction.smoothing": 1e6, "friction.kinetic_coefficient": 0.3}, {"friction.kinetic_coefficient": 0.4,
                                                                        "converter.coupling": 2.0}, {
    "pressure.mean": 1e5, "pressure.amplitude": 2e5, "pressure.frequency_ratio": 0.7}
"""Values that are set before the run: a sharp and a rising law, and a pressure that would be negative."""


KINDS = "fig02", "commands", "table", "profiles", "amplitudes", "actuator"
"""Scenes whose parameters are all set, each one alone."""
FROM_ZERO = {"pressure.amplitude": 2e4, "pressure.rate_limit": 1e6, "engine.torque_amplitude": 20.0,
             "engine.harmonic_amplitudes": 20.0, "engine.harmonic_amplitudes_values": 20.0}
"""Values of keys that are 0; others become 0.3."""
NO_EFFECT = {"pressure.mean", "engine.mean_torque", "pressure.amplitude", "engine.torque_amplitude",
             "pressure.phase", "pressure.frequency_ratio", "engine.harmonic_phases[2]"}
"""Keys that commands replace, and those of a sine whose amplitude is 0."""


def lockstep(name: str, values: dict[str, object] | None = None) -> Scene:
    return load_scene(name).with_values({**(values or {}), "pacing": "lockstep"})


def drawn(draw: np.random.Generator, scene: Scene) -> dict[str, object]:
    """A change of some live keys."""
    kept = (*TABLE, *(TABULATED if scene.system.friction.slip_speeds else ()))  # A table is fixed in an FMU.
    live = [key for key, quantity in QUANTITIES.items()
            if quantity.live and key not in kept and f"{key}_times" not in scene.system.varying]
    base = {key: float(scene.value(key)) for key in live}  # type: ignore[arg-type]
    base["converter.coupling"] = base["converter.coupling"] or 1.0
    changed = {key: base[key] * float(draw.uniform(0.7, 1.3)) for key in draw.choice(live, 3, replace=False)}
    if draw.random() < 0.3:
        changed |= {"engine.torque_amplitude": 0.0, "pressure.amplitude": float(draw.choice([0.0, 4e4]))}
    return {key: value for key, value in changed.items() if key in live}


def differing(scene: Scene, unpacked: Path, start: dict[str, float] | None = None) -> int:
    """Ticks after which any output of the FMU has other bits than the node's plant."""
    driven, draw, change_every = Driven(unpacked), np.random.default_rng(7), TICKS // 15
    driven.put(start or {})
    driven.begin()
    scene = scene.with_values(start or {})
    plant = Plant(scene)
    inputs = {name: scene.value(key) for name, key in (("engine_torque", "engine.mean_torque"),
                                                       ("actuation_pressure", "pressure.mean"))
              if name in driven.references}
    plant.hold(inputs.get("engine_torque"), inputs.get("actuation_pressure"))
    names, count, current = [*NAMES], 0, scene
    references = [driven.references[name] for name in names]
    get = driven.slave.getReal if driven.version == 2 else driven.slave.getFloat64
    for tick in range(TICKS):
        if inputs and tick % 50 == 49:
            fresh = {"engine_torque": float(draw.uniform(-200.0, 600.0)),
                     "actuation_pressure": float(draw.uniform(0.0, 3e5))}
            inputs = {name: fresh[name] for name in inputs}
            driven.put(inputs)
            plant.hold(inputs.get("engine_torque"), inputs.get("actuation_pressure"))
        if scene.system.pressure.actuated and tick > TICKS // 2 and tick % 7 == 0:
            speed = float(draw.uniform(-20.0, 20.0))
            driven.put({"output_speed": speed})
            plant.move_far_end(speed)
        if tick % change_every == change_every - 1:
            changes = drawn(draw, scene)
            current = current.with_values(changes)
            driven.put(changes)
            plant.use(current)
        driven.go()
        reading = plant.advance()
        expected = [getattr(reading, name) for name in FIELDS]
        count += np.array(get(references)).tobytes() != np.array(expected).tobytes()
        count += driven.stick_slip_state != reading.stick_slip_state
    driven.close()
    return count


@pytest.mark.parametrize("name", [name for name in VERSIONS if name != "fig02"])
def test_no_bit_differs_from_the_node_with_inputs_and_changes_on_the_way(name: str) -> None:
    scene = lockstep(*OTHERS.get(name, (name, {})))
    assert differing(scene, written(scene, VERSIONS[name])) == 0


def test_no_bit_differs_with_other_values_and_an_optimised_binary() -> None:
    unpacked = written("fig02", 3, options=())
    assert [differing(lockstep("fig02"), unpacked, start) for start in STARTS] == [0, 0, 0]


@pytest.mark.parametrize("name", KINDS)
def test_every_parameter_gives_the_bits_of_the_node_when_it_is_set_before_the_start_and_on_the_way(name: str) -> None:
    """The FMU refuses every value that the node refuses, and takes no change that a running node does not take."""
    scene = lockstep(*OTHERS.get(name, (name, {})))
    driven = Driven(written(scene, VERSIONS[name]))

    def run(before: dict[str, float], later: dict[str, float], n: int = 40) -> tuple[list[float], list[float]]:
        """States of the FMU and of the node, which change a value on the way."""
        before = {"initial.slip_speed": 3.0, **before}  # So that it sticks and slips soon.
        driven.slave.reset()
        found, expected = list[float](), list[float]()
        plant = Plant(scene.with_values(before))
        driven.put(before)
        driven.begin()
        held = {topic: 0.6 * float(scene.value(key)) for topic, key in COMMANDS if topic in driven.references}
        driven.put(held)
        plant.hold(*(held.get(topic) for topic, _ in COMMANDS))
        for changes in ({}, later):
            if changes:
                plant.use(scene.with_values(before | changes))
                driven.put(changes)
            driven.go(n)
            reading = [plant.advance() for _ in range(n)][-1]
            found += driven.get(*NAMES)
            expected += [getattr(reading, field) for field in FIELDS]
        return found, expected

    base, expected = run({}, {})
    assert base == expected
    wrong, idle = [], []
    for row in driven.parameters:
        start = float(row.start)
        key = row.name.partition("[")[0]
        factor = 1.07 if 1.07 * start <= float(row.max or math.inf) else 0.93
        value = factor * start if start else FROM_ZERO.get(key, 0.3)
        try:
            scene.with_values({row.name: value})
        except InputError:
            driven.slave.reset()
            driven.put({row.name: value})
            with pytest.raises(FMICallException):
                driven.begin()
            continue
        found, expected = run({row.name: value}, {})
        wrong += [] if found == expected else [f"{row.name} before the start"]
        if found == base and row.name not in NO_EFFECT | ({"engine.frequency"} if name == "commands" else set()):
            found, expected = run({row.name: value}, {}, 200)
            wrong += [] if found == expected else [f"{row.name} before the start"]
            idle += [row.name] if found == run({}, {}, 200)[0] else []
        if row.variability == "tunable":
            found, expected = run({}, {row.name: value})
            wrong += [] if found == expected else [f"{row.name} on the way"]
        else:
            with pytest.raises(FMICallException):
                driven.put({row.name: value})
    assert wrong == []
    assert idle == []
    driven.close()
