"""Commands as functions: `tcc_sim.simulate`, `analyse`, `spectrum`, `explain`, `fmu`, with the names of their options.

--from is `from_`, because `from` is a word of Python; --set is `set`, a mapping of keys. Commands use the same parts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tcc_sim.analysis.loop import BAND
from tcc_sim.errors import InputError, given_in
from tcc_sim.scene import SceneLike, as_scene, parse_profiles, unused_beside
from tcc_sim.sweeps.simulation import Plan, Simulation, simulate, with_plan_fields
from tcc_sim.tables.chosen_columns import is_table
from tcc_sim.tables.measured_table import MeasuredTable, table_in
from tcc_sim.topics import INPUTS

if TYPE_CHECKING:
    from tcc_sim.analysis.loop.tracking import Limits
    from tcc_sim.analysis.measured.orders import Spectrum
    from tcc_sim.analysis.measured.signals import Signals
    from tcc_sim.replay.measured import MeasuredRun
    from tcc_sim.replay.recorded import Recording
    from tcc_sim.replay.result import Replay
    from tcc_sim.scene import Scene
    from tcc_sim.sweeps.simulation import Start

SAMPLES = 200
"""Samples per period of excitation of a run with inputs or orders."""


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
    from tcc_sim.sweeps.simulation import steady_spectrum

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
               inputs: str | Path | MeasuredTable | Recording | None = None, inputs_scene: str | None = None,
               joints: Mapping[str, str] | None = None, topic: str | None = None, driveline: int | None = None,
               hold: Literal["previous", "linear", "smooth", "next"] | None = None,
               columns: str | Mapping[str, str] | None = None, from_: float | None = None, to: float | None = None,
               orders: bool = False, spectrum: bool = False, pulses: int | None = None,
               samples_per_cycle: int = 0, flywheel_angle: bool = False, start: Start | None = None,
               ready: Callable[[Scene, MeasuredTable | Recording | None], int] | None = None,
               **settings: Any) -> Simulation:
    """Solve a motion and compute its summary and further results, as `tcc-sim simulate` does.

    Parameters
    ----------
    scene : a scene, its name or file, or a system
    plan : how; alternatively the fields of `Plan` one by one, such as ``simulate("fig02", damping=True)``
    set : scene keys with new values, such as {"engine.speed": "1500rpm"}
    profile : linear course between points in time (s) of engine.frequency, engine.mean_torque, engine.torque_amplitude,
        engine.harmonic_amplitudes[n] or pressure.mean
    inputs : torque, pressure and speed of the shaft's far end from a recording, or from the columns t, engine_torque,
        actuation_pressure and output_speed of a table (.csv or other text, .parquet, .mat, .mf4, .tdms)
    inputs_scene : name or file of the scene of the recorded driveline, for a recording without one
    joints : names of the two joints in a recording of another program
    topic : topic of the joint states to read, if several were recorded
    driveline : number of the driveline to read, counted from 0 as in --json (default: one with a scene, on the shortest
        topic, and there the latest run or, without names of runs, the most states)
    hold : input of a table between two rows: value of the previous row, linear, smooth (lines that keep the amplitudes
        of sines), or value of the next row (default: as the table says, else previous)
    columns : columns of a table by the name of the signal, with their units if the table does not give them
    from_ : part of a table from this time on, s
    to : part of a table up to this time, s
    orders : add orders, transmissibility and judder, and those of the measured slip speed in a table of inputs
    spectrum : add the spectra of slip speed and shaft torque in the steady state, over frequency and order
    pulses : pulses per crank revolution in the tacho column of a table (default 1)
    samples_per_cycle, flywheel_angle, start : as for `sweeps.simulation.simulate`
    ready : function that is called before the solve with the scene that is solved and its inputs, and returns the
        samples per cycle

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
    from tcc_sim.analysis.measured.orders import compared, orders_of

    words = [f"{key}={points}" for key, points in profile.items()] if isinstance(profile, Mapping) else list(profile)
    values = {**(set or {}), **parse_profiles(words)}
    changed, source, measured = as_scene(scene).with_changes(values), None, None
    of_table = given_in({"hold": hold, "columns": columns, "from": from_, "to": to, "pulses": pulses})
    of_recording = given_in({"scene": inputs_scene, "joints": joints, "topic": topic, "driveline": driveline})
    if inputs is None and (of_table or of_recording):
        raise InputError(f"{_options(of_table or of_recording)}: only for inputs; give a "
                         f"{'table' if of_table else 'recording'} with --inputs")
    if inputs is not None:
        from tcc_sim.replay.given_inputs import input_table
        from tcc_sim.replay.recorded import read

        source = inputs if not isinstance(inputs, (str, Path)) else (
            input_table(Path(inputs), columns, from_, to) or read(inputs, inputs_scene, joints, topic, driveline))
        if of_recording and isinstance(source, MeasuredTable):
            raise InputError(f"{_options(of_recording)}: only for recordings; {inputs} is a table")
        changed, measured = _driven_scene(changed, source, hold, orders, pulses, values)
    if spectrum:
        changed.system.check_repeats("a spectrum")
    samples = ready(changed, source) if ready is not None else samples_per_cycle or (
        SAMPLES if orders or inputs is not None else 0)
    result = simulate(changed, plan, samples_per_cycle=samples, flywheel_angle=flywheel_angle, start=start, **settings)
    if result.summary is None:
        return result
    if isinstance(source, MeasuredTable):
        from tcc_sim.replay.given_inputs import doubts_about

        result = replace(result, notes=(*source.notes, *doubts_about(source), *(measured.notes if measured else ())))
    if measured is not None:
        both = compared(measured, result.trajectory)
        result = replace(result, orders=both.simulated, measured_orders=both.measured)
    elif orders:
        result = replace(result, orders=orders_of(result.trajectory))
    return replace(result, spectrum=spectrum_of_run(result, changed)) if spectrum else result


def _driven_scene(scene: Scene, source: MeasuredTable | Recording, hold: str | None, orders: bool,
                  pulses: int | None, keys: Iterable[str]) -> tuple[Scene, Signals | None]:
    """Return the scene with inputs, at the measured engine speed where orders are wanted, and the measured signals;
    `keys` are those that the command gives.
    """
    from tcc_sim.replay.given_inputs import driven_by
    from tcc_sim.replay.measured import at_measured_speed

    driven = driven_by(scene, source, hold)
    inputs = driven.system.inputs
    assert inputs is not None
    given = [name for name, data in zip(INPUTS, (inputs.torque, inputs.pressure)) if data is not None]
    driven = replace(driven, notes=unused_beside(keys, given))
    if orders and isinstance(source, MeasuredTable):
        return at_measured_speed(driven, source, pulses)
    if pulses is not None:
        raise InputError("pulses are those of the tacho of a table, for orders; ask for orders of a table")
    return driven, None


def _options(names: Iterable[str]) -> str:
    """Return the options of keywords."""
    return ", ".join(f"--{name}" for name in names)


def analysis(recording: str | Path | Recording, *, scene: str | None = None, run: int | None = None,
             from_: float | None = None, to: float | None = None, columns: str | Mapping[str, str] | None = None,
             orders: bool = False, spectrum: bool = False, pulses: int | None = None,
             joints: Mapping[str, str] | None = None, topic: str | None = None, driveline: int | None = None,
             discard: int | None = None, frequency: float | None = None, verify: bool = False, damping: bool = False,
             target: float | Mapping[float, float] | None = None, band: float = BAND,
             limits: Limits | None = None, rrd: Path | None = None, spawn: bool = False, connect: str | None = None,
             progress: bool = False) -> Replay | MeasuredRun:
    """Analyse a recording, or orders and spectrum of a table of measurements, as `tcc-sim analyse` does.

    Parameters
    ----------
    recording : bag directory or .mcap file, complete or cut short; or a table of measurements (.csv or other text,
        .parquet, .mat, .mf4, .tdms) for orders and spectrum
    scene : name or file, for a recording without a scene, and for the shaft and the order of a table (default fig02)
    run : only this run, counted from 0 (default: all runs, and figures of the longest one)
    from_ : only from this simulation time on, s
    to : only up to this simulation time, s
    columns : columns of a table by the name of the signal, with their units if the table does not give them
    pulses : pulses per crank revolution in the tacho column of a table (default 1)
    joints : names of the two joints in a recording of another program
    topic : topic of the joint states to read, if several were recorded
    driveline : number of the driveline to read, counted from 0 as in --json (default: one with a scene, on the shortest
        topic, and there the latest run or, without names of runs, the most states)
    orders : add orders, transmissibility and judder
    spectrum : add the spectra of slip speed and shaft torque in the steady state, over frequency and order
    discard : periods of excitation dropped from the figures at the start (default 50, or half of them if there are
        fewer than 100; 0 for a scene with profiles)
    frequency : frequency of the engine torque, rad/s (default: the scene's; for a torque from a topic, estimated from
        the recording)
    verify : solve the run again from the recording alone and compare
    damping : add the equivalent damping (21) of the last cycles
    target : slip speed that a controller was to hold, rad/s (default: the recorded target_slip_speed); or slip speeds
        from simulation times, s, on
    band : least error from the target that counts, and least jump of the target that begins a segment, rad/s
        (default 0.1)
    limits : smallest and largest pressure that the controller commands, Pa: at one of them it may count as saturated
        (default: those that it published; else 0 alone)
    rrd : write the run as a Rerun recording
    spawn : start a Rerun viewer and stream the run to it
    connect : stream to a running viewer, rerun+http://HOST:9876/proxy
    progress : show a bar on a terminal or in a notebook, elsewhere a line a minute

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
    from tcc_sim.analysis.measured.orders import orders_of, spectrum_of
    from tcc_sim.analysis.measured.signals import run_signals
    from tcc_sim.recording.columns import Window
    from tcc_sim.replay.measured import analyse_table
    from tcc_sim.replay.recorded import Recording, read
    from tcc_sim.replay.replay import replay

    others = {"run": run, "joints": joints, "topic": topic, "driveline": driveline, "discard": discard,
              "frequency": frequency, "verify": verify, "damping": damping, "target": target, "limits": limits,
              "rrd": rrd, "spawn": spawn, "connect": connect}
    table = isinstance(recording, (str, Path)) and is_table(Path(recording))
    if given := given_in(others if table else {"columns": columns, "pulses": pulses}):
        raise InputError(f"{_options(given)}: only for recordings; a table takes --orders, --spectrum, --columns, "
                         "--from, --to, --scene and --pulses" if table else
                         f"{_options(given)} is for tables, and {recording} is a recording")
    if table:
        if not (orders or spectrum):
            raise InputError("a table needs --orders or --spectrum; give one of them")
        rows = table_in(Path(str(recording)), ("slip_speed",), columns=columns).part(from_, to)
        return analyse_table(rows, as_scene(scene or "fig02").system, orders=orders, spectrum=spectrum, pulses=pulses)
    opened = recording if isinstance(recording, Recording) else read(recording, scene, joints, topic, driveline)
    result = replay(opened, window=Window(run, from_, to), discard=discard, frequency=frequency, verify=verify,
                    damping=damping, target=target, band=band, limits=limits, rrd=rrd, spawn=spawn, connect=connect,
                    progress=progress)
    if not (orders or spectrum):
        return result
    samples = opened.trajectory(result.run, from_, to)
    signals = run_signals(samples, result.timing.phase_of(samples))
    result = replace(result, orders=orders_of(signals)) if orders else result
    return replace(result, spectrum=spectrum_of(signals, result.summary.period,
                                                result.unbroken)) if spectrum else result


def explanation(scene: SceneLike, *, set: Mapping[str, object] | None = None, cost: bool = False) -> dict[str, Any]:
    """Return what a scene builds and what it leaves out, as the JSON of `tcc-sim explain` has it.

    Parameters
    ----------
    scene : a scene, its name or file, or a system
    set : scene keys with new values
    cost : add topics, optional packages and kernel arguments, and the run time of one tick of the real-time solver with
        the share of the Stribeck exponential

    Examples
    --------
    >>> import tcc_sim
    >>> tcc_sim.explain("fig02")["solver"]
    'smoothed'
    """
    from tcc_sim.output.explanation import explained

    changed = as_scene(scene).with_changes(set or {})
    return {"scene": changed.name, **explained(changed, cost=cost).as_json()}


def fmu_file(scene: SceneLike, *, set: Mapping[str, object] | None = None, fmi: int = 2, step: float | None = None,
             sources_only: bool = False, out: str | Path | None = None) -> Path:
    """Write the FMU of a scene, as `tcc-sim fmu` does, and return its path.

    Parameters
    ----------
    scene : a scene, its name or file, or a system
    set : scene keys with new values
    fmi : version of FMI, 2 or 3
    step : length of a tick, s, 5e-05 to 1 (default: from the scene's rate)
    sources_only : leave out the binary for this machine
    out : file to write (default: tcc_sim_SCENE.fmu)

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
    from tcc_sim.fmi.export import export
    from tcc_sim.output.files import new_file

    changed = as_scene(scene).with_changes(set or {})
    path = Path(out) if out is not None else Path(f"tcc_sim_{changed.name}.fmu")
    check_suffix(path, (".fmu",), "--out ")
    export(changed, new_file(path), fmi, step, sources_only=sources_only)
    return path
