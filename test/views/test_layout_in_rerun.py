"""The layout of a stream in Rerun, part by part: origins, names, shares, ranges before the cursor, and colours."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rerun", reason="rerun is not installed")

from tcc_sim.views import rerun_layout, style


def parts(part: Any) -> Iterator[str]:
    """Yield a line for each container and view; ranges in ms before the cursor, bounds, and whether a legend shows."""
    shares = getattr(part, "row_shares", None) or getattr(part, "column_shares", None) or []
    looks = " ".join(re.sub(r"\s+", " ", repr(value)) for value in getattr(part, "properties", {}).values())
    begins = [f"{int(number) // 1_000_000} ms" for number in re.findall(r"'?start'?[:=] ?(?:\S*value=)?(-\d+)", looks)]
    legend = re.findall(r"visible=\[(\w+)\]", looks)
    bounds = [f"{float(low):g} to {float(high):g}"
              for low, high in re.findall(r"_range': \[([-\d.]+), ([-\d.]+)\]", looks)]
    marked = "with events" if "/event/**" in getattr(part, "contents", ()) else ""
    title = getattr(part, "name", None)
    name = f"{part.origin}: {title}" if title else type(part).__name__
    shown = [{"True": "legend", "False": "no legend"}[word] for word in legend]
    yield " ".join(filter(None, (name, " ".join(f"{share:g}" for share in shares), *begins, *shown, marked, *bounds)))
    for inner in [] if title else part.contents:
        yield from parts(inner)


PLATE = ["plate: Plate angle (rad) {} ms no legend", "plate_speed: Plate speed (rad/s) {} ms no legend"]
FIGURES = ["phase: Phase portrait and section of the last 100 cycles -50000 ms -0.42 to 2.3 -0.28 to 1.48",
           "cycles: Largest and smallest slip speed of each cycle (rad/s)"]
TABS = ["Tabs", "summary: Summary", "events: Events"]
CONTROL = ["control: Target and cycle mean (rad/s) -200000 ms legend with events",
           "pressure: Actuation pressure (Pa) -200000 ms legend", "oil: Oil -200000 ms no legend"]


def recent(span: int) -> list[str]:
    """Lines of the views of a few cycles."""
    return [f"torque: Torques (N m) {span} ms legend", f"slip: Slip speed (rad/s) {span} ms no legend with events",
            f"state: Stick and slip {span} ms"]


def test_the_layout_shows_so_many_cycles_in_so_many_parts() -> None:
    """Eight cycles of 0.5 s or the time asked for, 100 of the portrait and 400 of a controller."""
    plate = [line.format(-4000) for line in PLATE]
    shown = list(parts(rerun_layout.blueprint(0.5, True, 0.0, {"oil": "Oil"}).root_container))
    assert shown == ["Horizontal 3 2", "Vertical 3 3 1.6 3 2.5 2", *recent(-4000), *CONTROL, "Vertical 4 3 2 2",
                     *FIGURES, "Horizontal", *plate, *TABS]
    plate = [line.format(-10000) for line in PLATE]
    plain = list(parts(rerun_layout.blueprint(0.5, False, 10.0).root_container))
    assert plain == ["Horizontal 3 2", "Vertical 3 3 1.6 2 2", *recent(-10000), *plate, "Vertical 4 3 2", *FIGURES,
                     *TABS]


BLUE, ORANGE, GREEN, RED, PURPLE, YELLOW, GREY = (int(f"{colour[1:]}FF", 16) for colour in (
    style.BLUE, style.ORANGE, style.GREEN, style.RED, style.PURPLE, style.YELLOW, style.GREY))
LOOKS = {
    "torque/engine": ("engine torque (N m)", ORANGE), "torque/friction": ("friction torque (N m)", BLUE),
    "slip/speed": ("slip speed (rad/s)", BLUE), "plate/angle": ("plate angle (rad)", GREEN),
    "plate_speed/speed": ("plate speed (rad/s)", PURPLE),
    "control/mean": ("cycle mean of the slip speed (rad/s)", BLUE)}
HELD = {
    "torque/engine_command": ("engine torque commanded (N m)", YELLOW), "pressure/command": ("commanded (Pa)", ORANGE),
    "far_end/command": ("output speed (rad/s)", PURPLE), "pressure/applied": ("applied (Pa)", GREEN),
    "torque/shaft": ("shaft torque (N m)", PURPLE), "control/target": ("target (rad/s)", RED)}
MARKS = {"cycles/largest": ("largest slip speed (rad/s)", BLUE, 1, 3.0),
         "cycles/smallest": ("smallest slip speed (rad/s)", RED, 1, 3.0), "event/mark": ("event", RED, 2, 6.0)}


@pytest.mark.parametrize("controlled", [True, False])
def test_signals_have_their_names_and_colours(controlled: bool) -> None:
    shown = {path: re.sub(r"\s+", " ", repr(look)) for path, look in rerun_layout.looks(controlled)}
    held = {path: look for path, look in HELD.items() if controlled or path.startswith("torque")}
    assert shown == {
        **{path: f"rr.SeriesLines( colors=[{colour}], widths=[1.5], names=['{name}'] )"
           for path, (name, colour) in LOOKS.items()},
        **{path: f"rr.SeriesLines( colors=[{colour}], widths=[1.5], names=['{name}'], interpolation_mode=[2] )"
           for path, (name, colour) in held.items()},
        **{path: f"rr.SeriesPoints( colors=[{colour}], markers=[{marker}], names=['{name}'], marker_sizes=[{size}] )"
           for path, (name, colour, marker, size) in MARKS.items()},
        "state": f"rr.StateConfiguration( values=['slip -', 'stick', 'slip +'], labels=['slip -', 'stick', 'slip +'], "
                 f"colors=[{RED}, {GREY}, {BLUE}] )",
        "phase/orbit": f"rr.LineStrips2D( radii=[-0.4000000059604645], colors=[{BLUE}] )",
        "phase/section": f"rr.Points2D( radii=[-3.0], colors=[{RED}] )"}
