"""Commands as functions: `tcc_sim.simulate`, `analyse`, `spectrum`, `explain`, `fmu`, with the names of their options.

--from is `from_`, because `from` is a word of Python; --set is `set`, a mapping of keys. Commands use the same parts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.analysis.tracking import Limits
from tcc_sim.errors import InputError, given_in
from tcc_sim.replay.given_inputs import doubts_about, driven_by, input_table
from tcc_sim.replay.measured import MeasuredRun, analyse_table, at_measured_speed
from tcc_sim.replay.replay import replay
from tcc_sim.replay.result import Replay
from tcc_sim.scene import SceneLike, as_scene, parse_profiles
from tcc_sim.sweeps.simulation import Plan, Simulation, simulate, with_plan_fields
from tcc_sim.tables.chosen_columns import is_table
from tcc_sim.tables.measured_table import MeasuredTable, table_in

if TYPE_CHECKING:
    from tcc_sim.analysis.signals import Signals
    from tcc_sim.analysis.spectra import Spectrum
    from tcc_sim.replay.recorded import Recording
    from tcc_sim.scene import Scene
    from tcc_sim.sweeps.steady_state import Start
    from tcc_sim.trajectory import Trajectory

SAMPLES = 200
"""Samples per period of excitation of a run with inputs or orders."""


def driven_scene(scene: Scene, source: MeasuredTable | Recording, hold: str | None, orders: bool,
                 pulses: int | None) -> tuple[Scene, Signals | None]:
    """Return the scene with inputs, at the measured engine speed where orders are wanted, and the measured signals."""
    driven = driven_by(scene, source, hold)
    if orders and isinstance(source, MeasuredTable):
        return at_measured_speed(driven, source, pulses)
    if pulses is not None:
        raise InputError("pulses are those of the tacho of a table, for orders; ask for orders of a table")
    return driven, None


def with_figures(result: Simulation, scene: Scene, table: MeasuredTable | None, measured: Signals | None, *,
                 orders: bool, spectrum: bool) -> Simulation:
    """Return a simulation with notes on its table and, if wanted, orders (also the measured ones) and spectrum."""
    from tcc_sim.analysis.orders import compared, orders_of

    if table is not None:
        result = replace(result, notes=(*table.notes, *doubts_about(table), *(measured.notes if measured else ())))
    if orders and measured is None:
        result = replace(result, orders=orders_of(result.trajectory))
    elif orders and measured is not None:
        both = compared(measured, result.trajectory)
        result = replace(result, orders=both.simulated, measured_orders=both.measured)
    return replace(result,
                   spectrum=spectrum_of_run(result, scene)) if spectrum and result.summary is not None else result


def spectrum_of_run(result: Simulation, scene: SceneLike | None = None) -> Spectrum:
    """Return the spectrum of a simulation's steady state.

    Parameters
    ----------
    result : a simulation with a periodic excitation
    scene : its scene; None for that of its trajectory

    Raises
    ------
    InputError
        The excitation does not repeat, or the run has no steady state.

    Examples
    --------
    >>> import tcc_sim
    >>> tcc_sim.spectrum(tcc_sim.simulate("slip", cycles=60)).period
    1
    """
    from tcc_sim.sweeps.steady_state import steady_spectrum

    system = result.trajectory.system if scene is None else as_scene(scene).system
    plan = result.plan or Plan()
    if system is None or result.summary is None:
        raise InputError("the simulation has no summary, whose period a spectrum needs")
    system.check_repeats("a spectrum")
    return steady_spectrum(system, result.end, result.summary.period, solver=plan.solver, rtol=plan.rtol,
                           step=plan.step)


@with_plan_fields
def simulation(scene: SceneLike, plan: Plan | None = None, *, set: Mapping[str, object] | None = None,
               profile: Mapping[str, str] | Sequence[str] = (),
               inputs: str | Path | MeasuredTable | Recording | None = None,
               hold: str | None = None, columns: str | Mapping[str, str] | None = None, from_: float | None = None,
               to: float | None = None, orders: bool = False, spectrum: bool = False, pulses: int | None = None,
               samples_per_cycle: int = 0, flywheel_angle: bool = False, start: Start | None = None,
               **settings: Any) -> Simulation:
    """Solve a motion and compute its summary and further results, as `tcc-sim simulate` does.

    Parameters
    ----------
    scene : a scene, its name or file, or a system
    plan : how; alternatively the fields of `Plan` one by one, such as ``simulate("fig02", damping=True)``
    set : scene keys with new values, such as {"engine.speed": "1500rpm"}
    profile : courses in time, KEY=T:V,T:V,... as words, or {KEY: "T:V,T:V,..."}
    inputs : table or recording that drives the scene
    hold, columns, from_, to : of a table, see `replay.given_inputs.driven_by` and `input_table`
    orders, spectrum : whether to add them
    pulses : of the tacho in a crank revolution
    samples_per_cycle, flywheel_angle, start : as for `sweeps.simulation.simulate`

    Returns
    -------
    Simulation; a numerical failure is its status, without a summary

    Raises
    ------
    InputError
        An unknown scene or setting, a value out of its range, or inputs that cannot be used.

    Examples
    --------
    >>> import tcc_sim
    >>> result = tcc_sim.simulate("slip", set={"engine.speed": "1400rpm"}, cycles=60)
    >>> result.summary.period, result.confirmed
    (1, True)
    """
    words = [f"{key}={points}" for key, points in profile.items()] if isinstance(profile, Mapping) else list(profile)
    changed, table, measured = as_scene(scene).with_values({**(set or {}), **parse_profiles(words)}), None, None
    if inputs is None and any(value is not None for value in (hold, columns, from_, to, pulses)):
        raise InputError("hold, columns, from_, to and pulses are for inputs from a table; give it as inputs")
    if inputs is not None:
        from tcc_sim.replay.recorded import read

        source = inputs if not isinstance(inputs, (str, Path)) else (
            input_table(Path(inputs), columns, from_, to) or read(inputs))
        table = source if isinstance(source, MeasuredTable) else None
        changed, measured = driven_scene(changed, source, hold, orders, pulses)
    if spectrum:
        changed.system.check_repeats("a spectrum")
    samples = samples_per_cycle or (SAMPLES if orders or inputs is not None else 0)
    result = simulate(changed, plan, samples_per_cycle=samples, flywheel_angle=flywheel_angle, start=start, **settings)
    return result if result.summary is None else with_figures(result, changed, table, measured, orders=orders,
                                                              spectrum=spectrum)


def with_recorded_figures(result: Replay, samples: Trajectory, *, orders: bool, spectrum: bool) -> Replay:
    """Return an analysis with orders and spectrum of its run, if wanted, from the samples of that run."""
    from tcc_sim.analysis.orders import orders_of
    from tcc_sim.analysis.signals import run_signals
    from tcc_sim.analysis.spectra import spectrum_of

    if not (orders or spectrum):
        return result
    signals = run_signals(samples, result.timing.phase_of(samples))
    result = replace(result, orders=orders_of(signals)) if orders else result
    return replace(result, spectrum=spectrum_of(signals, result.summary.period,
                                                result.unbroken)) if spectrum else result


def analysis(recording: str | Path | Recording, *, scene: str | None = None, run: int | None = None,
             from_: float | None = None, to: float | None = None, columns: str | Mapping[str, str] | None = None,
             orders: bool = False, spectrum: bool = False, pulses: int | None = None,
             joints: Mapping[str, str] | None = None, topic: str | None = None, driveline: int | None = None,
             discard: int | None = None, frequency: float | None = None, verify: bool = False, damping: bool = False,
             target: float | Mapping[float, float] | None = None, band: float = DEFAULTS.band,
             limits: Limits | None = None, rrd: Path | None = None, spawn: bool = False, connect: str | None = None,
             progress: bool = False) -> Replay | MeasuredRun:
    """Analyse a recording, or orders and spectrum of a table of measurements, as `tcc-sim analyse` does.

    Parameters
    ----------
    recording : bag directory or .mcap file, an opened Recording, or a table
    scene : name or file, for a recording without a scene, and for the shaft and the order of a table (None: fig02)
    run, from_, to : part of the recording; from_ and to also of a table, s
    columns, pulses : of a table, see `tables.measured_table.table_in`, and of its tacho
    orders, spectrum : whether to add them; a table needs one of them
    joints, topic, driveline : see `replay.recorded.Recording`
    discard, frequency, verify, damping, target, band, limits, rrd, spawn, connect, progress : of recordings, see
        `replay.replay.replay`

    Raises
    ------
    InputError
        The file cannot be read or analysed, or an option is for the other kind of file.

    Examples
    --------
    >>> import tcc_sim
    >>> from tcc_sim.output.samples import write_trajectory
    >>> scene = tcc_sim.load_scene("slip")
    >>> write_trajectory(folder / "slip.mcap", tcc_sim.solve(scene, cycles=60, samples_per_cycle=50), scene.text())
    >>> tcc_sim.analyse(folder / "slip.mcap", discard=30).summary.regime
    'slip'
    """
    from tcc_sim.recording.window import Window
    from tcc_sim.replay.recorded import Recording, read

    if isinstance(recording, (str, Path)) and is_table(Path(recording)):
        others = {"run": run, "joints": joints, "topic": topic, "driveline": driveline, "discard": discard,
                  "frequency": frequency, "verify": verify, "damping": damping, "target": target, "limits": limits,
                  "rrd": rrd, "spawn": spawn, "connect": connect}
        given = given_in(others)
        if given or not (orders or spectrum):
            raise InputError(f"{', '.join(given)}: only for recordings" if given else
                             "a table needs orders or spectrum; ask for one of them")
        table = table_in(Path(recording), ("slip_speed",), columns=columns).part(from_, to)
        return analyse_table(table, as_scene(scene or "fig02").system, orders=orders, spectrum=spectrum, pulses=pulses)
    for name, value in (("columns", columns), ("pulses", pulses)):
        if value is not None:
            raise InputError(f"{name} are for tables, and {recording} is a recording")
    opened = recording if isinstance(recording, Recording) else read(recording, scene, joints, topic, driveline)
    result = replay(opened, window=Window(run, from_, to), discard=discard, frequency=frequency, verify=verify,
                    damping=damping, target=target, band=band, limits=limits, rrd=rrd, spawn=spawn, connect=connect,
                    progress=progress)
    if not (orders or spectrum):
        return result
    return with_recorded_figures(result, opened.trajectory(result.run, from_, to), orders=orders, spectrum=spectrum)


def explanation(scene: SceneLike, *, set: Mapping[str, object] | None = None, cost: bool = False) -> dict[str, Any]:
    """Return what a scene builds and what it leaves out, as the JSON of `tcc-sim explain` has it.

    Examples
    --------
    >>> import tcc_sim
    >>> tcc_sim.explain("fig02")["solver"]
    'smoothed'
    """
    from tcc_sim.output.explanation import explain

    return explain(as_scene(scene).with_values(set or {}), cost=cost)


def fmu_file(scene: SceneLike, *, set: Mapping[str, object] | None = None, fmi: int = 2, step: float | None = None,
             sources_only: bool = False, out: str | Path | None = None) -> Path:
    """Write the FMU of a scene, as `tcc-sim fmu` does, and return its path (default: tcc_sim_SCENE.fmu).

    Raises
    ------
    InputError
        The real-time solver cannot run the scene, an option is out of its range, or the file exists.

    Examples
    --------
    >>> import tcc_sim
    >>> tcc_sim.fmu("fig02", sources_only=True, out=folder / "fig02.fmu").name
    'fig02.fmu'
    """
    from tcc_sim.errors import check_suffix
    from tcc_sim.fmu.export import export
    from tcc_sim.output.files import replaceable

    changed = as_scene(scene).with_values(set or {})
    path = Path(out) if out is not None else Path(f"tcc_sim_{changed.name}.fmu")
    check_suffix(path, (".fmu",))
    if replaceable(path):
        raise InputError(f"{path} exists; it is not overwritten")
    export(changed, path, fmi, step, sources_only=sources_only)
    return path
