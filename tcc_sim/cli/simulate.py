"""`tcc-sim simulate`: solve a scene offline, give the figures of its steady state and, on request, its samples."""

from __future__ import annotations

import argparse
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from tcc_sim.cli.arguments import add_plot, check_plot, new_file
from tcc_sim.errors import InputError

if TYPE_CHECKING:
    from tcc_sim.analysis.summary import Summary
    from tcc_sim.trajectory import Trajectory

CYCLES, SAMPLES, LARGEST_OUTPUT = 150, 200, 50_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What is solved, for how long, how, and where the results go."""
    parser.add_argument("scene", metavar="SCENE", help="name of a bundled scene, or a file")
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[], help="change a key of the scene")
    span = parser.add_mutually_exclusive_group()
    span.add_argument("--cycles", metavar="N", type=int, help=f"engine cycles solved (default {CYCLES})")
    span.add_argument("--duration", metavar="S", type=float, help="seconds solved instead")
    parser.add_argument("--discard", metavar="N", type=int,
                        help="cycles dropped from the summary at the start (default 50, but "
                        "at most half of --cycles, and at most a third of the whole cycles in --duration)")
    parser.add_argument("--solver", metavar="NAME", default="auto", help="name of a solver (default auto)")
    parser.add_argument("--rtol", metavar="R", type=float, help="relative tolerance of an adaptive solver")
    parser.add_argument("--step", metavar="H", type=float, help="step of a fixed-step solver, s")
    parser.add_argument("--damping", action="store_true", help="work out the equivalent damping (21) too")
    parser.add_argument("--lyapunov", action="store_true", help="work out the largest Lyapunov exponent too")
    parser.add_argument("--json", metavar="FILE", type=Path, help="the summary; - is standard output")
    parser.add_argument("--out", metavar="FILE", type=Path, help="the samples: .npz, .csv or .mcap")
    add_plot(parser)
    parser.add_argument("--samples", metavar="N", type=int, default=SAMPLES,
                        help=f"samples per engine cycle in --out (default {SAMPLES})")
    parser.add_argument("--force", action="store_true", help="replace files that exist")


def run(arguments: argparse.Namespace) -> int:
    """Check everything, solve, write what was asked for, and print the summary."""
    from tcc_sim.analysis.summary import summarise, summarise_samples
    from tcc_sim.output.files import STANDARD_OUTPUT, draft, write_json
    from tcc_sim.output.provenance import document
    from tcc_sim.scene import load_scene, parse_assignments

    scene = load_scene(arguments.scene).with_values(parse_assignments(arguments.set))
    system = scene.system
    cycles = arguments.cycles if arguments.cycles is not None or arguments.duration is not None else CYCLES
    discard = _discard(arguments, cycles, system.cycle)
    if arguments.json not in (None, STANDARD_OUTPUT):
        new_file(arguments.json, arguments.force)
    check_plot(arguments, arguments.json, arguments.out)
    if arguments.out is not None:
        _check_out(arguments, (cycles or arguments.duration / system.cycle) * arguments.samples)
    if arguments.lyapunov and system.friction.law != "smoothed":
        raise InputError(f"friction.law is {system.friction.law}; --lyapunov is for the smoothed law")

    shorter = cycles is None and arguments.duration < system.cycle * (1.0 - 1e-12)
    samples = arguments.samples if arguments.out is not None else SAMPLES if shorter else 0

    def solve_it() -> Trajectory:
        from tcc_sim.solvers import solve

        return solve(system, cycles=cycles, duration=arguments.duration, solver=arguments.solver, rtol=arguments.rtol,
                     step=arguments.step, samples_per_cycle=samples,
                     flywheel_angle=arguments.out is not None and arguments.out.suffix == ".mcap")

    solved = _solved(solve_it)
    summary = summarise_samples(solved) if shorter else summarise(solved, discard)
    values = summary.as_json()
    lines = _lines(scene.name, solved, summary)
    if arguments.damping:
        from tcc_sim.analysis.damping import damping_as_json, damping_of_cycles
        from tcc_sim.output.table import damping_row, rows

        assert solved.cycles is not None
        damping = damping_of_cycles(system, solved.cycles[discard:], discard, summary.period, solver=arguments.solver,
                                    rtol=arguments.rtol, step=arguments.step)
        values.update(damping_as_json(damping))
        lines += rows([damping_row(damping)])
    if arguments.lyapunov:
        from tcc_sim.output.table import lyapunov_row, rows
        from tcc_sim.studies.lyapunov import largest_lyapunov_exponent
        from tcc_sim.trajectory import State

        assert solved.cycles is not None
        found = largest_lyapunov_exponent(system, State(*solved.cycles.section[-1].tolist()),
                                          start_cycle=len(solved.cycles),
                                          period=summary.period)
        values["lyapunov"] = found.as_json()
        lines += rows([lyapunov_row(found)])
    if arguments.out is not None:
        from tcc_sim.output.samples import write_samples

        write_samples(arguments.out, solved, scene.text())
        lines.append(f"{len(solved.t)} samples in {arguments.out}")
    if arguments.plot is not None:
        from tcc_sim.views.plots import plot_run

        with draft(arguments.plot) as part:
            plot_run(solved, part, arguments.width, summary=summary, title=scene.name)
        lines.append(f"picture in {arguments.plot}")
    if arguments.json is not None:
        write_json(arguments.json, document("simulate", values, scene, arguments.words))
    if arguments.json != STANDARD_OUTPUT:
        print("\n".join(lines))
    return 0


def _discard(arguments: argparse.Namespace, cycles: int | None, cycle: float) -> int:
    """The cycles to drop, given or by default, checked before anything is solved."""
    from tcc_sim.analysis.cycles import DISCARD, default_discard

    if cycles is None:
        if not 0.0 < arguments.duration <= 1e6:
            raise InputError(f"--duration is {arguments.duration:g} s; it must be above 0 to 1e6 s")
        whole = int(arguments.duration / cycle * (1.0 + 1e-12))
        default = min(DISCARD, whole // 3)
    else:
        if not 1 <= cycles <= 10_000_000:
            raise InputError(f"--cycles is {cycles}; it must be 1 to 10000000")
        whole, default = cycles, default_discard(cycles)
    discard: int = default if arguments.discard is None else arguments.discard
    if not 0 <= discard < max(whole, 1):
        raise InputError(f"--discard is {discard}; it must be 0 to {max(whole - 1, 0)}, since {whole} whole cycles are solved")
    return discard


def _check_out(arguments: argparse.Namespace, samples: float) -> None:
    """Raise InputError for a file of another kind, one that is asked for twice, or too many samples."""
    from tcc_sim.output.samples import check_suffix

    check_suffix(arguments.out)
    new_file(arguments.out, arguments.force)
    if arguments.json is not None and arguments.json.absolute() == arguments.out.absolute():
        raise InputError(f"--json and --out are the same file, {arguments.out}")
    if not 1 <= arguments.samples <= 1_000_000:
        raise InputError(f"--samples is {arguments.samples}; it must be 1 to 1000000 per engine cycle")
    if samples > LARGEST_OUTPUT:
        raise InputError(f"--out would hold {samples:.3g} samples; it must be at most {LARGEST_OUTPUT:g}")


def _solved(solve: Callable[[], Trajectory]) -> Trajectory:
    """What `solve` gives, worked out in a thread: compiled code cannot be interrupted, waiting for it can.

    Raises
    ------
    NumericalFailure
        The solver stopped before the end.
    InputError
        The solver refuses the case.
    """
    from tcc_sim.trajectory import Status

    found: list[Trajectory] = []
    failed: list[BaseException] = []

    def work() -> None:
        try:
            found.append(solve())
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    while thread.is_alive():
        thread.join(0.2)
    if failed:
        raise failed[0]
    if found[0].status is Status.REFUSED:
        raise InputError(f"{found[0].solver}: {found[0].detail or found[0].status.value}")
    return found[0].raise_for_status()


def _lines(name: str, solved: Trajectory, summary: Summary) -> list[str]:
    """The summary for a terminal."""
    from tcc_sim.output.table import rows, summary_rows

    cost = f"{solved.statistics.steps} steps in {solved.statistics.seconds:.3g} s"
    return [f"{name}: {solved.t[-1]:.6g} s, solved by {solved.solver} in {cost}", *rows(summary_rows(summary))]
