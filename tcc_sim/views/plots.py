"""Pictures of one's own work: every result that the package gives, as Python has it, and some as JSON has them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from tcc_sim.analysis.cycles import cycles_of, first_cycle_of
from tcc_sim.analysis.summary import Summary, summarise, summarise_samples
from tcc_sim.errors import InputError, check_suffix, require
from tcc_sim.output.files import replaceable
from tcc_sim.trajectory import Trajectory, no_cycles
from tcc_sim.views import style
from tcc_sim.views.dense import last_cycles
from tcc_sim.views.manoeuvre import manoeuvre
from tcc_sim.views.overview import HISTORY_CYCLES, ORBIT_CYCLES, overview


def check_picture(path: Path, width: str = "page") -> None:
    """Raise before anything is computed where `path` cannot become a picture: InputError where the suffix is none of
    png, svg and pdf, or the width neither column nor page; MissingPackage where matplotlib is not installed.
    """
    check_suffix(path, style.SUFFIXES, "--plot ")
    style.width_of(width)
    require("matplotlib", "a picture")


def plot(result: Any, file: str | Path | None = None, width: str = "page", *, title: str = "", ax: Any = None,
         force: bool = False) -> Any:
    """Draw a result as a picture, or its main curve into an axis of one's own.

    Parameters
    ----------
    result : what any function of the package gives, or what `sweep --json` or `continue --json` holds; of a recording
        its first run
    file : ends in .png, .svg or .pdf
    width : column or page, of a paper
    title : over the picture
    ax : matplotlib's axis that takes the main curve instead: slip speed over time, the largest slip speed over a key,
        a gain, or a map
    force : whether an existing file is replaced

    Returns
    -------
    The path of the picture, or `ax`

    Raises
    ------
    InputError
        Something else, another suffix or width, neither file nor axis or both, or a file that exists.
    MissingPackage
        matplotlib is not installed.

    Examples
    --------
    >>> import tcc_sim
    >>> run = tcc_sim.solve(tcc_sim.load_scene("minimal"), cycles=60)
    >>> tcc_sim.plot(run, folder / "run.png").name
    'run.png'
    """
    if (file is None) == (ax is None):
        raise InputError("give either a file or an axis to draw into")
    if file is None:
        return draw_into(ax, result, title)
    path = Path(file)
    check_picture(path, width)
    if replaceable(path) and not force:
        raise InputError(f"{path} exists; it is not overwritten")
    look = look_of(result)
    if look is not None:
        return look.drawing(look.whole)(path, result, title=title, width=style.width_of(width))
    run = _run_of(result)
    if run is result:
        return plot_run(run, path, width, title=title)
    if all(hasattr(result, name) for name in ("cycles", "first_cycle", "control")):
        return overview(path, run, result.cycles, result.first_cycle, result.summary, title or result.path.name,
                        control=result.control, width=width)
    return plot_run(run, path, width, summary=getattr(result, "summary", None), title=title)


class Look(NamedTuple):
    """Where the drawing of a result is: its module here, and the functions for a whole picture and for an axis.

    `whole` takes a png, svg or pdf file, the result (or its JSON, for sweeps and branches), a title and a width in
    inches, and raises what `style.figure` and `style.save` do; `main` takes an axis and the result.
    """

    module: str
    whole: str
    main: str = "into"

    def drawing(self, name: str) -> Callable[..., Any]:
        """One of the two functions."""
        found: Callable[..., Any] = getattr(import_module(f"tcc_sim.views.{self.module}"), name)
        return found


LOOKS = {"Sweep": Look("sweeps", "draw_sweep", "draw_maxima"), "Grid": Look("sweeps", "draw_grid", "draw_largest"),
         "Scattered": Look("scatter", "draw_scatter"), "Motions": Look("branch_diagram", "branch_diagram"),
         "Basins": Look("basin_map", "draw"), "Linearisation": Look("bode", "bode"),
         "Identification": Look("identification", "identification"), "Orders": Look("order_map", "plot_orders"),
         "Twin": Look("twin", "draw_twin")}
"""By the name of a result's class; what is a run, or has one, is drawn by `plot_run` and `overview`."""


def look_of(result: Any) -> Look | None:
    """How a result is drawn, or its JSON, or a list of planes of basins; None for what is no row of LOOKS."""
    if isinstance(result, Mapping):
        swept = "Grid" if result.get("second_values") else "Sweep" if "max_slip_speed" in result else ""
        return LOOKS.get("Motions" if "branches" in result else swept if "over" in result else "")
    first = result[0] if isinstance(result, list) and result else result
    return LOOKS.get(type(first).__name__)


def _run_of(result: Any) -> Trajectory:
    """The samples of a run, of what has one, or of a recording's first run; InputError where there are none."""
    run = getattr(result, "trajectory", result)
    run = run() if callable(run) else run
    if not isinstance(run, Trajectory):
        raise InputError(f"a {type(result).__name__} cannot be drawn; give what solve, simulate, analyse, read, sweep, "
                         "scatter, continuation, basins, linearise or identify gave")
    return run


def draw_into(ax: Any, result: Any, title: str = "") -> Any:
    """Draw the main curve of a result into an axis; InputError for a result that has none."""
    look = look_of(result)
    if look is not None:
        look.drawing(look.main)(ax, result)
    else:
        run = _run_of(result)
        if len(run.t) < 3:
            raise InputError(f"a {type(result).__name__} has no curve for an axis; a run needs samples, such as "
                             "samples_per_cycle=200")
        ax.plot(run.t, run.slip_speed, color=style.BLUE, linewidth=0.9)
        ax.set(xlabel="time (s)", ylabel="slip speed (rad/s)")
    if title:
        ax.set_title(title)
    return ax


def plot_run(solved: Trajectory, path: Path, width: str = "page", *, summary: Summary | None = None,
             title: str = "") -> Path:
    """Draw a solved run with per-cycle results, or shorter than a cycle and with samples; its last cycles are solved
    again with dense samples. One whose excitation varies in time is drawn from its beginning to its end.
    """
    if solved.system is not None and solved.system.course is not None:
        return manoeuvre(path, solved, style.width_of(width), title)
    whole = solved.cycles is not None and len(solved.cycles) > 0
    if not whole and len(solved.t) > 2 and solved.t[-1] - solved.t[0] >= solved.cycle:
        solved = replace(solved, cycles=cycles_of(solved))
        whole = solved.cycles is not None and len(solved.cycles) > 0
    if summary is None:
        summary = summarise(solved) if whole else summarise_samples(solved)
    tail = last_cycles(solved, max(summary.period or ORBIT_CYCLES, HISTORY_CYCLES))
    cycles = solved.cycles if solved.cycles is not None else no_cycles()
    return overview(path, tail, cycles, first_cycle_of(solved) if whole else 0, summary, title, width=width)
