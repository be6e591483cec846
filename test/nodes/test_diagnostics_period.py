"""Diagnostics come once a second, also after a pause of the process, and every value is that of the loop."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from tcc_sim.nodes import driveline


def published(times: list[float], monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The times of those at which diagnostics are published, of a node that has started at 0."""
    now = [0.0]
    monkeypatch.setattr(driveline.time, "monotonic", lambda: now[0])
    sent: list[float] = []
    clock = SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=0))
    node = SimpleNamespace(get_clock=lambda: clock, create_publisher=lambda *how: SimpleNamespace(
        publish=lambda message: sent.append(now[0])))
    result = driveline.Diagnostics(node, None, None)
    monkeypatch.setattr(result, "_status", lambda now: driveline.DiagnosticStatus())
    for now[0] in times:
        result.publish_when_due()
    return sent


def every(step: float, count: int) -> Iterator[float]:
    """Times at which a loop looks."""
    return (k * step for k in range(1, count + 1))


def test_there_is_one_a_second_at_any_rate_of_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    assert published(list(every(0.125, 64)), monkeypatch) == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]


def test_after_a_pause_there_is_one_and_none_is_made_up_for(monkeypatch: pytest.MonkeyPatch) -> None:
    times = [0.5, 1.0, 7.5, 7.625, 7.75, 8.25, 8.5, 8.625, 9.5]
    assert published(times, monkeypatch) == [1.0, 7.5, 8.25, 9.5]


def command(name: str, fallen_back: bool) -> SimpleNamespace:
    """A commanded input that has received 7 commands."""
    return SimpleNamespace(name=name, fallen_back=fallen_back, received=7, refused=2, lost=0, refusal="too large",
                           timeouts=4)


def test_every_value_of_a_status_and_its_message(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rates, shares and losses are those since the status before; other counts are those since the start."""
    monkeypatch.setattr(driveline.time, "monotonic", lambda: 100.0)
    node = SimpleNamespace(create_publisher=lambda *how: None, count_subscribers=len,
                           get_fully_qualified_name=lambda: "/left/driveline")
    pacer = SimpleNamespace(ticks=400, late_ticks=100, missed_ticks=1, period_ns=2_000_000, lateness_max=0.0045,
                            lateness=lambda: (0.00025, 0.003))
    torque, pressure = command("engine_torque", True), command("actuation_pressure", False)
    loop = SimpleNamespace(
        pacer=pacer, late=[0.25, 0.75], paused=False, stick_ticks=300, slip_ticks=100, commands=[torque, pressure],
        pressure_command=pressure, plant=SimpleNamespace(pressures=(2e5, 1.5e5), stepper=SimpleNamespace(
            tick=750, step=0.002, substeps=3, iterations_most=9, iterations_bound=64)),
        outputs=SimpleNamespace(unsent={"/a": 2, "/b": 3}, run="692a1f3c9b02.001"),
        scene=SimpleNamespace(name="mine", operation=SimpleNamespace(rate=500.0, real_time_factor=0.5)))
    told = driveline.Diagnostics(node, loop, SimpleNamespace(publishers=lambda one: f"publishers of {one.name}"))

    def status(now: float) -> tuple[bool, str, dict[str, str]]:
        result = told._status(now)
        assert (result.name, result.hardware_id) == ("/left/driveline: driveline", "692a1f3c9b02.001")
        assert result.level in (driveline.DiagnosticStatus.WARN, driveline.DiagnosticStatus.OK)
        return (result.level == driveline.DiagnosticStatus.WARN, result.message,
                {pair.key: pair.value for pair in result.values})

    late = "25 % of the ticks were late by more than a period of 2 ms; since the start at most by 0.0045 s"
    wrong, message, values = status(102.0)
    assert (wrong, message, told.lateness) == (True, "1 tick missed in real time; " + late + "; no command on "
                                               "engine_torque; the scene's fallback applies", late)
    assert values == {
        "scene": "mine", "simulation time (s)": "1.500", "regime": "stick-slip", "rate (Hz)": "200.0",
        "rate wanted (Hz)": "250", "real-time factor": "0.4000", "missed ticks": "1", "late ticks": "100",
        "paced ticks": "400", "late share": "0.2500", "first late tick (s)": "0.250000",
        "last late tick (s)": "0.750000", "messages not sent": "5", "lateness p50 (s)": "0.000250",
        "lateness p99 (s)": "0.003000", "lateness max (s)": "0.004500", "sub-steps per tick": "3",
        "iterations max": "9", "iterations bound": "64",
        **{f"{one} {what}": value for one, source, count in (
            ("engine_torque", "fallback", "13"), ("actuation_pressure", "topic", "18")) for what, value in {
                "listeners": count, "publishers": f"publishers of {one}", "received": "7", "refused": "2", "lost": "0",
                "last refusal": "too large", "time-outs": "4", "source": source}.items()},
        "commanded pressure (Pa)": "200000", "applied pressure (Pa)": "150000"}
    torque.fallen_back, torque.lost, pressure.lost = False, 2, 3
    loop.stick_ticks, pacer.ticks, loop.pressure_command = 500, 500, None
    loop.scene.operation.real_time_factor = 0.0
    wrong, message, values = status(103.0)
    assert (wrong, message) == (True, "5 commands lost or replaced before a tick could take them")
    assert [values.get(key) for key in ("regime", "rate (Hz)", "rate wanted (Hz)", "late share", "engine_torque lost",
                                        "applied pressure (Pa)")] == ["stick", "200.0", "500", "0.0000", "2", None]
    loop.slip_ticks, torque.lost, pacer.missed_ticks, pacer.ticks, pacer.late_ticks = 110, 6, 4, 900, 200
    assert status(104.0)[1] == ("4 commands lost or replaced before a tick could take them; 3 ticks missed in real "
                                f"time; {late}")
    pacer.ticks, pacer.late_ticks, loop.slip_ticks = 1000, 205, 120
    assert status(104.5)[:2] == (False, "slip")
    assert (told.lateness, status(104.75)[2]["rate (Hz)"]) == ("", "0.0")
    assert status(105.0)[:2] == (False, "waiting")
    loop.paused = True
    assert status(106.0)[:2] == (False, "paused")


def housekeeper(loop: SimpleNamespace, **fields: object) -> Any:
    """A driveline node of these parts, which keeps its warnings as (subject, sentence, count)."""
    node = driveline.DrivelineNode.__new__(driveline.DrivelineNode)
    warned: list[tuple[object, ...]] = []
    throttle = SimpleNamespace(warn=lambda *said: warned.append(said),
                               once=lambda *said: warned.append((*said, "once")))
    scene = SimpleNamespace(operation=SimpleNamespace(rate=1000.0, pacing="".join("lockstep")))
    for name, value in {"loop": loop, "scene": scene, "_throttle": throttle, "warned": warned, "_vehicle": None,
                        "_announced": False, **fields}.items():
        object.__setattr__(node, name, value)
    return node


def test_what_the_node_warns_of_and_when(monkeypatch: pytest.MonkeyPatch) -> None:
    logged, given = list[str](), SimpleNamespace()
    for name in ("log", "warn"):
        monkeypatch.setattr(driveline, name, lambda node, sentence: logged.append(sentence))
    torque = command("engine_torque", True)
    torque.doubt = lambda tick, after: "doubt" if (tick, after) == (750, 500.0) else ""
    loop = SimpleNamespace(
        commands=[torque], clock_started=SimpleNamespace(is_set=lambda: given.started), refused_wishes=["no lock"],
        failure=None, plant=SimpleNamespace(stepper=SimpleNamespace(tick=750)), pacer=SimpleNamespace(
            missed_by=3.25, missed_ticks=3200), outputs=SimpleNamespace(tell_unsent=lambda: logged.append("unsent")))
    told = SimpleNamespace(publish_when_due=lambda: logged.append("published"), lateness="")
    node = housekeeper(loop, diagnostics=told, waiting=SimpleNamespace(
        sentences=lambda: {"/clock": "waits"}, unstamped=lambda: {"engine_torque": "no stamps"}))
    for name in ("_look_for_vehicle", "_look_for_target", "_look_for_clock"):
        monkeypatch.setattr(node, name, lambda name=name: logged.append(name))
    for given.started in (False, True, True):
        node.housekeeping()
    looks = ["published", "unsent", "_look_for_vehicle", "_look_for_target", "_look_for_clock"]
    assert logged == [*looks, *looks, driveline.CLOCK_STARTED, "no lock", *looks]
    assert node.warned == [
        ("engine_torque unit", "doubt", "once"), ("engine_torque refused", "too large", 2),
        ("engine_torque time-outs", "no command on engine_torque within command_timeout; the fallback applied", 4),
        ("/clock", "waits"), ("engine_torque stamps", "no stamps", "once"),
        ("missed ticks", "the real-time loop was 3.25 s late, as after a pause of the process; ticks were missed in "
         "real time, none in simulation time", 3200)] * 3
    told.lateness, loop.failure, loop.plant.stepper.tick = "late", ValueError("why"), 749
    with pytest.raises(ValueError, match="why"):
        node.housekeeping()
    assert node.warned[18][0] == "engine_torque refused"
    assert node.warned[-1] == ("late ticks", "late", "once")
    node.diagnostics, loop.failure = None, None
    node.housekeeping()
    assert node.warned[-1][0] == "missed ticks"


def test_a_vehicle_is_taken_once_it_has_sent_and_left_once_it_has_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    done, given = list[object](), SimpleNamespace()
    far = SimpleNamespace(received=0, refused=0, subscription="its subscription", poll=lambda tick, limit: None,
                          join=lambda tick: done.append(("joined", tick)))
    compiling = SimpleNamespace(done=lambda: given.compiled, result=lambda: done.append("compiled"))
    loop = SimpleNamespace(clock_started=SimpleNamespace(is_set=lambda: given.started), far_end=None,
                           vehicle_waits=False, plant=SimpleNamespace(warm_up_far_end=None,
                                                                      stepper=SimpleNamespace(tick=7)),
                           attach=lambda one: (done.append("attached"), setattr(loop, "far_end", one)),
                           detach=lambda: setattr(loop, "far_end", None))
    loop.request = lambda action, timeout=1.0: (done.append(timeout), action(), given.taken)[2]
    monkeypatch.setattr(driveline, "begun", lambda work, name: (done.append("compiles") or compiling, None))
    monkeypatch.setattr(driveline, "CommandedInput", lambda node, row: far)
    node = housekeeper(loop)
    monkeypatch.setattr(node, "count_publishers", lambda name: given.publishers, raising=False)
    monkeypatch.setattr(node, "destroy_subscription", done.append, raising=False)
    for given.started, loop.vehicle_waits, given.compiled, far.received, given.publishers, given.taken, said in (
            (False, True, True, 1, 1, True, []), (True, False, True, 1, 1, True, []),
            (True, True, False, 0, 1, True, ["compiles"]), (True, True, True, 0, 1, True, ["compiled"]),
            (True, True, True, 1, 1, True, ["compiled", 6.0, ("joined", 7), "attached"]),
            (True, True, True, 1, 1, True, []),
            (True, False, True, 1, 0, False, [1.0])):
        node._look_for_vehicle()
        assert done == said
        done.clear()
    loop.far_end, given.taken = far, True
    node._look_for_vehicle()
    assert (done, node._vehicle, loop.far_end) == ([1.0, "its subscription"], None, None)
    node.scene.operation.pacing = "real_time"
    node._attach(far)
    assert done[2:] == ["attached"]
    node.loop.clock = SimpleNamespace(due=True, begin=lambda stamp: done.append(("begins", stamp)))
    node.loop.plant.stamp_ns = 9
    for given.started, loop.clock.due in ((False, True), (True, False), (True, True)):
        node._look_for_clock()
    assert done[3:] == [1.0, ("begins", 9)]
