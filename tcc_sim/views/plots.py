"""Pictures of one's own work: a run, a recording, a sweep or a grid, from the results as Python or as JSON has them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from tcc_sim.analysis.cycles import cycles_of, first_cycle_of
from tcc_sim.analysis.summary import Summary, summarise, summarise_samples
from tcc_sim.errors import InputError, require
from tcc_sim.output.files import replaceable
from tcc_sim.sweeps.results import Sweep
from tcc_sim.sweeps.scatter import Scattered
from tcc_sim.trajectory import Trajectory, no_cycles
from tcc_sim.views import style
from tcc_sim.views.dense import last_cycles
from tcc_sim.views.overview import HISTORY_CYCLES, ORBIT_CYCLES, overview
from tcc_sim.views.scatter import draw_band, draw_scatter
from tcc_sim.views.sweeps import draw_grid, draw_maxima, draw_sweep, label_of


def check_picture(path: Path, width: str = "page") -> None:
    """Raise before anything is computed where `path` cannot become a picture.

    Raises
    ------
    InputError
        The suffix is none of png, svg and pdf, or the width neither column nor page.
    MissingPackage
        matplotlib is not installed.
    """
    if path.suffix not in style.SUFFIXES:
        raise InputError(f"--plot {path} must end in {', '.join(list(style.SUFFIXES)[:-1])} or "
                         f"{list(style.SUFFIXES)[-1]}")
    style.width_of(width)
    require("matplotlib", "a picture")


def plot(result: Any, file: str | Path | None = None, width: str = "page", *, title: str = "", ax: Any = None,
         force: bool = False) -> Any:
    """Draw a result as a picture, or its main curve into an axis of one's own.

    Parameters
    ----------
    result : a solved Trajectory; what `simulate` or `analyse` gives; a sweep, or what `sweep --json` holds: one key
        gives maxima and orbit diagram, two keys a map
    file : ends in .png, .svg or .pdf
    width : column or page, of a paper
    title : over the picture
    ax : matplotlib's axis that takes the main curve instead: slip speed over time, or the largest slip speed over a key
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
    if isinstance(result, Trajectory):
        return plot_run(result, path, width, title=title)
    if all(hasattr(result, name) for name in ("trajectory", "cycles", "first_cycle", "summary")):
        return overview(path, result.trajectory, result.cycles, result.first_cycle, result.summary,
                        title or _name(result), control=getattr(result, "control", None), width=width)
    if hasattr(result, "trajectory") and hasattr(result, "summary"):
        return plot_run(result.trajectory, path, width, summary=result.summary, title=title)
    if isinstance(result, Scattered):
        return draw_scatter(path, result, style.width_of(width), title)
    values = result if isinstance(result, Mapping) else result.as_json() if hasattr(result, "as_json") else None
    if isinstance(values, Mapping) and "over" in values and "max_slip_speed" in values:
        draw = draw_grid if values.get("second_over") else draw_sweep
        return draw(path, values, style.width_of(width), title)
    raise InputError(f"a {type(result).__name__} cannot be drawn; give a trajectory, or what simulate, analyse or "
                     "sweep gave")


def draw_into(ax: Any, result: Any, title: str = "") -> Any:
    """Draw the main curve of a result into an axis.

    Raises
    ------
    InputError
        A result that has none.
    """
    run = getattr(result, "trajectory", result)
    if isinstance(result, Scattered) and result.over:
        draw_band(ax, result, "max_slip_speed")
        ax.set(xlabel=label_of(result.over), ylabel="max |slip speed| (rad/s)")
    elif isinstance(result, Sweep):
        draw_maxima(ax, result.as_json())
        ax.set(xlabel=label_of(result.curve.key), ylabel="max |slip speed| (rad/s)")
    elif isinstance(run, Trajectory) and len(run.t) > 2:
        ax.plot(run.t, run.slip_speed, color=style.BLUE, linewidth=0.9)
        ax.set(xlabel="time (s)", ylabel="slip speed (rad/s)")
    else:
        raise InputError(f"a {type(result).__name__} has no curve for an axis; a run needs samples, such as "
                         "samples_per_cycle=200")
    if title:
        ax.set_title(title)
    return ax


def plot_run(solved: Trajectory, path: Path, width: str = "page", *, summary: Summary | None = None,
             title: str = "") -> Path:
    """Draw a solved run; its last cycles are solved again with dense samples.

    Parameters
    ----------
    solved : with per-cycle results, or shorter than a cycle and with samples
    summary : of its steady state; worked out by default
    """
    whole = solved.cycles is not None and len(solved.cycles) > 0
    if not whole and len(solved.t) > 2 and solved.t[-1] - solved.t[0] >= solved.cycle:
        solved = replace(solved, cycles=cycles_of(solved))
        whole = solved.cycles is not None and len(solved.cycles) > 0
    if summary is None:
        summary = summarise(solved) if whole else summarise_samples(solved)
    tail = last_cycles(solved, max(summary.period or ORBIT_CYCLES, HISTORY_CYCLES))
    cycles = solved.cycles if solved.cycles is not None else no_cycles()
    return overview(path, tail, cycles, first_cycle_of(solved) if whole else 0, summary, title, width=width)


def _name(result: Any) -> str:
    """The name of a recording."""
    return str(result.path.name) if hasattr(result, "path") else ""
