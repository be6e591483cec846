"""Lines of results for a terminal and rows of Markdown: whole lines of made-up results."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tcc_sim.analysis.orders import Judder, OrderComparison, Orders
from tcc_sim.analysis.spectra import Spectrum
from tcc_sim.analysis.tracking import Tracking
from tcc_sim.model.parameters import System
from tcc_sim.model.parameters import replace as changed
from tcc_sim.output.tables import (
    aligned,
    comparison_lines,
    damping_row,
    escape,
    friction_formula,
    lyapunov_row,
    markdown_table,
    order_lines,
    quantile_lines,
    simulation_lines,
    spectrum_lines,
    summary_rows,
    sweep_lines,
    text,
    tracking_lines,
)
from tcc_sim.sweeps.results import Sweep
from tcc_sim.sweeps.scatter import Tolerances

NAN = math.nan


def like(base: SimpleNamespace, **changes: Any) -> Any:
    """Return a made-up result with other values."""
    return SimpleNamespace(**{**vars(base), **changes})


SUMMARY = SimpleNamespace(
    max_slip_speed=62.123456789, min_slip_speed=-0.25, period=2, section=[(0.125, 5.0), (0.25, -1.0)],
    stick_fraction=0.12345, regime="stick-slip", cycles=150, discarded=50, settled=True, section_change=1.25e-9,
    solver="smoothed", runaway=False, transient=False, longest_period=16, broken=0, clutch_energy=12.5, mean_power=3.25,
    peak_power=400.0, breakaways=7, min_shaft_torque=-5.5, max_shaft_torque=650.25, coupling_energy=0.0,
    covers=(0.0, 3.0), lost_seconds=0.0, seconds=3.0)
ROWS = {
    "largest |slip speed|": "62.1234568 rad/s", "smallest slip speed": "-0.25 rad/s",
    "regime": "stick-slip, in stick for 12.35 % of the time", "period": "2 periods of excitation, settled",
    "section: plate angle, slip speed": "0.125 rad, 5 rad/s", "": "0.25 rad, -1 rad/s",
    "clutch": "12.5 J turned into heat, 3.25 W on average, at most 400 W; 7 breakaways",
    "shaft torque": "-5.5 to 650.25 N m", "periods of excitation": "150, the first 50 dropped"}
NO_SECTION = {"section: plate angle, slip speed": None, "": None}
NONE_UP_TO = "none up to 16 periods of excitation"
NONE = {**NO_SECTION, "section": "2 points"}


@pytest.mark.parametrize(("changes", "rows"), [
    ({}, {}),
    ({"period": 1, "section": [(0.125, 5.0)]}, {"period": "1 period of excitation, settled", "": None}),
    ({"settled": False}, {"period": "2 periods of excitation, still converging: the section changes by 1.3e-09, "
                          "relative, per period"}),
    ({"runaway": True}, {"period": "none: slip grows and never sticks"}),
    ({"period": 0}, {**NONE, "period": NONE_UP_TO}),
    ({"period": 0, "section": []}, {**NO_SECTION, "period": NONE_UP_TO}),
    ({"period": 0, "section": [(0.1, 0.2)], "transient": True},
     {**NONE, "section": "1 point", "period": f"{NONE_UP_TO}; the motion has not settled: do more"}),
    ({"period": 0, "longest_period": 15}, {**NONE, "period": "none up to 15 periods of excitation, a third of those "
                                           "kept"}),
    ({"period": 0, "longest_period": 1, "broken": 3},
     {**NONE, "period": "none up to 1 period of excitation, a third of those in a row at the end"}),
    ({"period": 0, "longest_period": 0}, {**NONE, "period": "none: too few were solved"}),
    ({"period": 0, "longest_period": 0, "broken": 3},
     {**NONE, "period": "none: it needs 16 or more whole periods of excitation in a row at the end; 3 of 100 kept ones "
      "are not whole or not known"}),
    ({"cycles": 0, "discarded": 0}, {"period": "none: no whole period of excitation is known",
                                     "periods of excitation": "0, none dropped"}),
    ({"breakaways": None}, {"clutch": ROWS["clutch"].replace("7 breakaways", "breakaways were not counted")}),
    ({"breakaways": 1}, {"clutch": ROWS["clutch"].replace("7 breakaways", "1 breakaway")}),
    ({"coupling_energy": 0.5}, {"converter's fluid": "0.5 J turned into heat"}),
    ({"clutch_energy": NAN}, {"clutch": None, "shaft torque": None,
                              "clutch, shaft torque": "none: solver smoothed did not compute them"})])
def test_the_rows_of_a_summary(changes: dict[str, Any], rows: dict[str, str | None]) -> None:
    values = dict(summary_rows(like(SUMMARY, **changes), "do more"))
    assert values == {name: row for name, row in {**ROWS, **rows}.items() if row is not None}


def test_a_long_section_is_cut_and_rows_keep_their_order() -> None:
    rows = summary_rows(like(SUMMARY, period=20, section=[(0.125, 5.0)] * 20), "")
    assert [name for name, _ in rows] == [*list(ROWS)[:4], "section: plate angle, slip speed", *15 * [""],
                                          *list(ROWS)[6:]]


RUN = SimpleNamespace(t=np.array([0.0, 3.0]), solver="smoothed", statistics=SimpleNamespace(steps=1, seconds=0.12345),
                      system=System())
DAMPING = SimpleNamespace(weighted=-1.23456, negative_mean=-4.0, threshold=-0.6)
LYAPUNOV = SimpleNamespace(exponent=1.51, low=1.4, high=1.6, confidence=0.95, diagnosis="chaotic")
PLAIN = SimpleNamespace(trajectory=RUN, summary=SUMMARY, status="reached the end", warnings=[], damping=None,
                        lyapunov=None)
PROFILED = changed(System(), {"pressure.mean_times": [0.0, 1.0], "pressure.mean_values": [1e5, 2e5]})


def test_the_lines_of_a_simulation() -> None:
    def last(**changes: Any) -> list[str]:
        return [line.strip() for line in simulation_lines("it", like(PLAIN, **changes))]

    head = "it: 3 s, solved by smoothed in 1 step in 0.123 s"
    assert last()[:2] == [head, "largest |slip speed|              62.1234568 rad/s"]
    assert last()[-1] == "periods of excitation             150, the first 50 dropped"
    assert last(summary=None) == [head, "status  reached the end"]
    both = last(summary=None, warnings=["a doubt", "another"], damping=DAMPING, lyapunov=LYAPUNOV)
    assert both[2:] == [
        "doubtful                   a doubt", "doubtful                   another",
        "equivalent damping (21)    -1.235 N m s/rad, mean of the negative slope -4; -C23 is -0.6",
        "largest Lyapunov exponent  1.51 1/s, 1.4 to 1.6 at 95 % confidence: chaotic"]
    late = like(SUMMARY, covers=(1.0, 3.0))
    assert last(summary=late)[-1] == "figures cover                     1 to 3 s of 0 to 3 s"
    away = last(summary=like(SUMMARY, runaway=True))[-1]
    assert away.startswith("runaway                           the clutch carries 500 N m in slip, but not at")
    unsettled = like(SUMMARY, period=0, transient=True)
    for system, advice in ((System(), "raise --cycles or --duration"), (PROFILED, "its inputs vary in time"),
                           (None, "raise --cycles or --duration")):
        lines = last(summary=unsettled, trajectory=like(RUN, system=system))
        assert lines[4].endswith(f"; the motion has not settled: {advice}")
    assert not any("runaway" in line for line in last(summary=like(SUMMARY, runaway=True),
                                                      trajectory=like(RUN, system=None)))
    assert damping_row(like(DAMPING, weighted=NAN)) == ("equivalent damping (21)", "none: there is no slip")  # type: ignore[arg-type]
    assert damping_row(like(DAMPING, weighted=NAN, negative_mean=NAN))[1] == (  # type: ignore[arg-type]
        "none: no whole period of excitation could be solved")
    assert lyapunov_row(LYAPUNOV)[0] == "largest Lyapunov exponent"  # type: ignore[arg-type]


ORDER = np.array([0.0, 1.0, 2.0, 3.0])
SLIP = np.array([[0.0, 1.0, 10.0, 1e-3], [0.0, 2.0, 20.0, 1e-3]])
ORDERS = Orders(np.array([0.5, 1.0]), np.array([100.0, 200.0]), ORDER, SLIP, 10.0 * SLIP, np.array([1.0, 3.0]),
                np.array([[0.5, NAN], [0.25, NAN]]), Judder(np.array([1.0, 3.0]), np.array([4.0, 6.0]),
                                                           np.array([7.0, 5.0])), np.zeros(2), (10.0, 20.0))


def with_fields(orders: Orders, **changes: Any) -> Orders:
    return Orders(**{**vars(orders), **changes})


def test_the_lines_of_orders_and_of_their_comparison() -> None:
    assert order_lines(ORDERS) == [
        "  orders   2 windows from engine frequency 100 to 200 rad/s, up to order 3",
        "  order 1  shaft torque over engine torque at most 0.5, at engine frequency 100 rad/s",
        "  order 3  no transmissibility: the engine torque is not known",
        "  judder   at most 6 rad/s about the cycle mean, rms 3 rad/s; 7 breakaways per second"]
    other = with_fields(ORDERS, left_out=2, torque_order=np.empty(0), transmissibility=np.empty((2, 0)),
                        judder=Judder(*np.ones((2, 2)), np.full(2, NAN)))
    assert order_lines(other) == [
        "  orders            2 windows from engine frequency 100 to 200 rad/s, up to order 3; 2 more left out because "
        "of gaps between samples",
        "  transmissibility  none: the engine torque has no order of the excitation",
        "  judder            at most 1 rad/s about the cycle mean, rms 1 rad/s; breakaways are not known: a table has "
        "no states of stick and slip"]
    unmeasured = with_fields(ORDERS, shaft_torque=np.full((2, 4), NAN))
    assert order_lines(unmeasured)[2] == "  order 3  no transmissibility: the shaft torque is not known"
    simulated = with_fields(ORDERS, slip_speed=SLIP * np.array([[10.0], [100.0]]))
    assert comparison_lines(OrderComparison(unmeasured, simulated)) == [
        "  order 1 of slip speed    simulated and measured differ by at most 40 dB, median 30 dB",
        "  order 2 of slip speed    simulated and measured differ by at most 40 dB, median 30 dB",
        "  order 3 of slip speed    simulated and measured differ by at most 40 dB, median 30 dB",
        "  order 1 of shaft torque  not compared: it was not measured",
        "  order 2 of shaft torque  not compared: it was not measured",
        "  order 3 of shaft torque  not compared: it was not measured"]
    steep = with_fields(ORDERS, slip_speed=np.array([[0.0, 1.0, 1.0, 1.0], [0.0, 10.0**1.5, 31.0, 32.0]]))
    ten = with_fields(steep, slip_speed=steep.slip_speed * np.array([[10.0], [1.0]]))
    # Windows more than 30 dB below the largest are left out: the first one of order 3 alone, 30.1 dB below.
    assert [line.split("by ")[1] for line in comparison_lines(OrderComparison(steep, ten))[:3]] == [
        "at most 0 dB, median 0 dB", "at most 20 dB, median 10 dB", "at most 0 dB, median 0 dB"]


def test_the_lines_of_a_spectrum_are_its_largest_by_frequency() -> None:
    order = np.arange(9.0)
    slip = np.array([99.0, 1.0, 8.0, 7.0, 2.0, 6.0, 5.0, 4.0, NAN])
    torque = np.where(order == 3.0, NAN, 10.0 * order)
    spectrum = Spectrum(100.0 * order, order, "ten cycles", 1, np.array([0.5, 1.5]), slip, torque, None, None)
    assert spectrum_lines(spectrum) == [
        "  spectrum window  ten cycles",
        "  order 2          200 rad/s: slip speed 8 rad/s, shaft torque 20 N m",
        "  order 3          300 rad/s: slip speed 7 rad/s, shaft torque not measured",
        *(f"  order {k}          {k}00 rad/s: slip speed {v} rad/s, shaft torque {k}0 N m"
          for k, v in ((4, 2), (5, 6), (6, 5), (7, 4))),
        "  sub-harmonics    orders 0.5, 1.5"]
    for count, more in ((6, ""), (7, " and 1 more"), (9, " and 3 more")):
        lines = spectrum_lines(Spectrum(order, order, "", 1, 0.5 * np.arange(float(count)), slip, torque, None, None))
        assert lines[-1] == f"  sub-harmonics    orders 0, 0.5, 1, 1.5, 2, 2.5{more}"
    lines = spectrum_lines(Spectrum(order, order, "", 1, np.empty(0), slip, torque, None, None))
    assert not any("sub-harmonics" in line for line in lines)
    density = Spectrum(order, order, "Hann's", 0, np.empty(0), None, None, slip, slip)
    assert spectrum_lines(density) == ["  spectrum window  Hann's"]


TRACKED: dict[str, Any] = {
    "target": 20.0, "mean_slip": 20.5, "rms_error": 0.123456, "largest_error": 1.5, "overshoot": 2.0,
    "settling_time": 0.75, "target_low": 20.0, "target_high": 20.0, "verdict": "settled", "verdict_why": "it stays",
    "overshoot_time": 1.25, "peak_deviation": 3.0, "peak_time": 0.5, "seconds": 4.0, "time_at_limit": 0.0}


@pytest.mark.parametrize(("changes", "lines"), [
    ({}, {}), ({"rms_error": NAN, "verdict_why": "no cycle mean"}, {0: "target 20 rad/s: no verdict: no cycle mean"}),
    ({"target_high": 25.0}, {0: "target 20 to 25 rad/s: mean 20.5 rad/s, rms error 0.1235 rad/s, largest 1.5 rad/s"}),
    ({"peak_deviation": -3.0, "overshoot_time": NAN}, {1: "peak -3 rad/s at 0.5 s, overshoot 2 rad/s"}),
    ({"verdict": "hunting"}, {2: "hunting: it stays"}),
    ({"time_at_limit": 0.12345}, {3: "pressure at a limit for 12.3 % of the time"}),
    ({"commands_applied": 1, "command_rate": 12.5, "commands_superseded": 0},
     {3: "1 command applied, 12.5 a second, 0 superseded"}),
    ({"lost_seconds": 0.125}, {3: "over 4 s; 0.125 s between were not observed"})])
def test_the_lines_of_a_controller(changes: dict[str, Any], lines: dict[int, str]) -> None:
    whole = ["target 20 rad/s: mean 20.5 rad/s, rms error 0.1235 rad/s, largest 1.5 rad/s",
             "peak +3 rad/s at 0.5 s, overshoot 2 rad/s at 1.25 s", "settled after 0.75 s: it stays"]
    tracking = Tracking(**{**TRACKED, **changes})
    if "rms_error" in changes:
        assert tracking_lines(tracking) == [lines[0]]
    else:
        assert tracking_lines(tracking) == [lines.get(k, (*whole, "")[k]) for k in range(4 if 3 in lines else 3)]


class Swept(Sweep):
    """A sweep of made-up columns, whose four points have settled."""

    def __init__(self, table: dict[str, Any]) -> None:
        vars(self).update(table=table, points=[POINT] * 4, curve=CURVE)

    def columns(self) -> dict[str, Any]:
        return dict(vars(self)["table"])


POINT = SimpleNamespace(status="reached the end", summary=SUMMARY, judder=None)
CURVE = SimpleNamespace(system=System(), values=(1.0, 2.0))
TABLE = {"friction.kinetic_coefficient": np.array([0.2, 0.25, 0.3, 0.35]),
         "max_slip_speed": np.array([12.3456789, 900.0, 3.0, NAN]), "period": np.array([2, 0, 0, -1]),
         "runaway": np.array([False, True, False, False]), "transient": np.array([False, False, True, False]),
         "stick_fraction": np.array([0.123456, 0.0, 1.0, NAN]), "regime": np.array(["slip", "slip", "stick", ""]),
         "status": np.array(["ok", "ok", "ok", "it failed"])}
LINES = ["kinetic_coefficient  max_slip_speed   period  stick_fraction  regime",
         "                              rad/s  periods",
         "                0.2        12.34568        2          0.1235    slip",
         "               0.25             900  runaway               0    slip",
         "                0.3               3    none*               1   stick",
         "               0.35  it failed"]


def test_the_table_of_a_sweep_is_as_wide_as_the_terminal() -> None:
    sweep = Swept(TABLE)
    assert sweep_lines(sweep) == LINES == sweep_lines(sweep, 68)
    narrow = sweep_lines(sweep, 67)
    assert [line[:60].rstrip() for line in LINES] == narrow[:6]
    assert narrow[6] == "kinetic_coefficient  regime"
    assert narrow[-1] == "               0.35  it failed"
    assert len(sweep_lines(sweep, 10)) == 4 * 6
    more = {**TABLE, **{name: np.arange(4.0) for name in ("judder_peak", "judder_rms", "breakaways", "slip_order_2",
                                                         "max_shaft_torque", "clutch_energy", "not_shown")}}
    assert sweep_lines(Swept(more))[0].split()[5:] == [
        "clutch_energy", "max_shaft_torque", "breakaways", "judder_rms", "judder_peak", "slip_order_2"]


class Quantiles(SimpleNamespace):
    """Scattered results with made-up quantiles."""

    def quantiles(self, name: str) -> Any:
        return self.of[name]


NAMES = ("max_slip_speed", "stick_fraction", "clutch_energy", "max_shaft_torque", "breakaways", "judder_rms",
         "judder_peak")
UNITS = ("rad/s", "", "J", "N m", "", "rad/s", "rad/s")


def quantiles(**changes: Any) -> Any:
    """Two quantiles of results that are 10, 20, ... by their names."""
    of = {name: np.array([[10.0 * k + 10.0, 10.0 * k + 11.0]]) for k, name in enumerate(NAMES)}
    sweeps = [SimpleNamespace(curve=CURVE, points=[POINT, None], plan=SimpleNamespace(duration=None))]
    bounds = ("pressure.mean", 2e5, 2.5e5), ("friction.smoothing", 40.0, 50.0)
    return Quantiles(**{"tolerances": Tolerances(bounds, 4, 0, (0.05, 0.5)), "over": "", "sweeps": sweeps,
                        "left_out": {"runaway": 0, "not_settled": 0}, "sampled": False, "of": of, "orders": None,
                        "order_quantiles": None, **changes})


def test_the_lines_of_quantiles() -> None:
    head = "4 samples of pressure.mean 200000 to 250000 Pa, friction.smoothing 40 to 50 s/rad"
    each = [line for k, (name, unit) in enumerate(zip(NAMES, UNITS))
            for line in (f"{name}{unit and f' ({unit})'}  5 %  50 %", f"   {10 * k + 10}  {10 * k + 11}")]
    assert quantile_lines(quantiles()) == [head, *each[:8]]
    assert quantile_lines(quantiles(sampled=True)) == [head, *each]
    left_out = quantile_lines(quantiles(left_out={"runaway": 1, "not_settled": 2}))[1]
    assert left_out == ("quantiles leave out 1 result that ran away and 2 that have not settled; raise --cycles, or "
                        "give --every-sample")
    failed = SimpleNamespace(status="it failed", summary=None, judder=None)
    one = quantiles().sweeps[0]
    assert quantile_lines(quantiles(sweeps=[like(one, points=[POINT, failed, failed])]))[1] == (
        "quantiles leave out 2 results whose solver failed, the first one: it failed")
    rows = np.array([[10.0, 11.0], [NAN, NAN]])
    over = quantile_lines(quantiles(over="friction.kinetic_coefficient", of=dict.fromkeys(NAMES, rows)))
    assert over[1:4] == ["max_slip_speed (rad/s)  5 %  50 %", "  friction.kinetic_coefficient 1  10  11",
                         "  friction.kinetic_coefficient 2  none: no sample is left"]
    orders = SimpleNamespace(speeds=[100.0, 200.0], order=[1.0, 2.5])
    slip = np.arange(8.0).reshape(2, 2, 2)
    lines = quantile_lines(quantiles(orders=orders, order_quantiles={"slip_speed": slip, "shaft_torque": 10.0 + slip}))
    assert lines[9:] == [
        line for name, unit, plus in (("slip_speed", "rad/s", 0), ("shaft_torque", "N m", 10))
        for i, omega in enumerate((100, 200)) for k, order in enumerate(("1", "2.5")) for line in (
            f"{name} of order {order} at engine frequency {omega} rad/s ({unit})  5 %  50 %",
            f"   {plus + 4 * i + 2 * k}  {plus + 4 * i + 2 * k + 1}")]


def test_formulas_alignment_and_markdown() -> None:
    assert friction_formula(0.12, [0.03, -0.01], [2.0, 0.5]) == (
        "mu(v) = 0.12 + 0.03 exp(-2 |v|) - 0.01 exp(-0.5 |v|)")
    assert friction_formula(0.1234567, [], []) == "mu(v) = 0.123457"
    assert aligned([("a", "1"), ("long", "2")]) == ["  a     1", "  long  2"]
    assert aligned([]) == []
    assert markdown_table(["a", "b"], [["1", "2"]]) == ["| a | b |", "| --- | --- |", "| 1 | 2 |"]
    assert markdown_table(["a", "b", "c"], [], "---:", "---") == ["| a | b | c |", "| --- | ---: | ---: |"]
    assert escape("a|b*c_d<e") == "a\\|b\\*c\\_d&lt;e"
    assert text({"a": 1.234567, "b": [None, True, (1, "x")]}) == "a: 1.2346, b: [none, True, [1, x]]"
