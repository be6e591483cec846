"""Late and missed ticks, and commands in a wrong unit, are reported: in diagnostics and on the console."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from tcc_sim.messages import cdr
from tcc_sim.nodes import process
from tcc_sim.nodes.driveline import DOUBTED_AFTER
from tcc_sim.recording.commands import LATE_SHARE


@pytest.fixture
def warned(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Warnings of the node."""
    values: list[str] = []
    monkeypatch.setattr(process, "warn", lambda node, sentence: values.append(sentence))
    return values


def status_after(node: Any, ticks: int, late: int) -> Any:
    """The status in the diagnostics of a node after so many more ticks, of which some were late."""
    pacer = node.loop.pacer
    pacer.ticks, pacer.late_ticks = pacer.ticks + ticks, pacer.late_ticks + late
    return node.diagnostics._status(node.diagnostics._since + 1.0)


@pytest.mark.parametrize(("late", "warns"), [(0, False), (round(1000 * LATE_SHARE), False), (410, True)])
def test_a_share_of_late_ticks_above_its_limit_is_a_warning(bench: Any, warned: list[str], late: int,
                                                            warns: bool) -> None:
    node = bench.driveline(scene="minimal")
    status_after(node, 500, 500)
    status = status_after(node, 1000, late)
    values = {item.key: item.value for item in status.values}
    assert (values["late ticks"], values["paced ticks"], values["late share"]) == (
        str(500 + late), "1500", f"{late / 1000:.4f}")
    assert (status.level == b"\x01") is warns
    assert ("41 % of the ticks were late by more than a period of 1 ms" in status.message) is warns
    for _ in range(3):
        node.housekeeping()
    assert sum("of the ticks were late" in text for text in warned) == warns


def test_missed_ticks_are_said_on_the_console_once(bench: Any, warned: list[str]) -> None:
    node = bench.driveline(scene="minimal")
    node.housekeeping()
    node.loop.pacer.missed_ticks, node.loop.pacer.missed_by = 3200, 3.2
    for _ in range(3):
        node.housekeeping()
    (sentence,) = warned
    assert sentence.startswith("the real-time loop was 3.2 s late, as after a pause of the process")
    assert sentence.endswith("(3200 so far)")


@pytest.mark.parametrize(("pressures", "doubted"), [([0.9], True), ([2.0, 2.4], True), ([0.0, 500.0, 9e4], False),
                                                    ([0.0], False)])
def test_a_pressure_in_bar_is_doubted_once_after_a_while(bench: Any, warned: list[str], pressures: list[float],
                                                         doubted: bool) -> None:
    node = bench.driveline(scene="controlled")
    command, stepper = node.loop.pressure_command, node.loop.plant.stepper
    for tick, pressure in enumerate(pressures):
        command.accept(cdr.fluid_pressure(0, pressure), tick)
    node.housekeeping()
    assert not any("the unit is Pa" in text for text in warned)
    stepper.tick = round(DOUBTED_AFTER * node.scene.operation.rate) + 1
    for _ in range(3):
        node.housekeeping()
    said = [text for text in warned if "the unit is Pa" in text]
    assert said == ([f"the largest actuation_pressure command is {max(pressures):g} Pa; the unit is Pa: "
                     f"{max(pressures):g} bar would be {max(pressures) * 1e5:g}"] if doubted else [])
