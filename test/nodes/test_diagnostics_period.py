"""Diagnostics come once a second, also after a pause of the process."""

from collections.abc import Iterator
from types import SimpleNamespace

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
