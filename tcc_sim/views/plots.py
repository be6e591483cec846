"""Pictures of results: of every result class of the package, and of the JSON of most commands."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tcc_sim.analysis.spectra import Spectrum
from tcc_sim.analysis.summary import Summary, cycles_of, first_cycle_of, summarise
from tcc_sim.errors import InputError, check_suffix, require
from tcc_sim.later_rooms import from_later_room
from tcc_sim.output.files import replaceable
from tcc_sim.result import system_behind
from tcc_sim.shown_units import UNITS, shown_in
from tcc_sim.trajectory import Trajectory, no_cycles
from tcc_sim.views import style
from tcc_sim.views.overview import overview
from tcc_sim.views.stored import (
    Record,
    arguments_in,
    check_stored,
    drawer_of,
    kind_of,
    read_stored,
    refusing_damage,
    revived,
    title_of,
)
from tcc_sim.views.whole_runs import manoeuvre


@dataclass(frozen=True, repr=False)
class Picture:
    """Picture without a file, which a notebook shows.

    png : content of a .png file
    """

    png: bytes

    def __repr__(self) -> str:
        return f"<Picture: {len(self.png)} bytes of PNG>"

    def _repr_png_(self) -> bytes:
        """Return the view in a notebook."""
        return self.png


def check_picture(path: Path, width: str = "page") -> None:
    """Check that a picture can be written to `path`, before anything is computed.

    Raises
    ------
    InputError
        The suffix is not .png, .svg or .pdf, or the width is not column or page.
    MissingPackage
        matplotlib is not installed.
    """
    check_suffix(path, style.SUFFIXES, "--plot ")
    style.width_of(width)
    require("matplotlib", "a picture")


def plot(result: Any, file: str | Path | None = None, width: str = "page", *, title: str = "", ax: Any = None,
         force: bool = False, units: str | None = None) -> Any:
    """Draw a result as a picture, or its main curve into an axis.

    Parameters
    ----------
    result : a result of any function of the package; the JSON of a command or the name of its .json or .npz file; a
        scene, of which the friction law is drawn; of a recording, the first run is drawn. Nothing is solved: of a run
        without samples, its section and the maxima of its cycles are drawn
    file : name ending in .png, .svg or .pdf; without file and axis, the picture is returned, and a notebook shows it
    width : column or page of a paper
    title : title above the picture
    ax : matplotlib axis for the main curve: slip speed over time, the largest slip speed over a key, a gain, or a map
    force : whether to replace an existing file
    units : unit of speeds and frequencies of a picture: rad (rad/s), rpm or hz; None for that of the command which
        wrote the JSON, else rad

    Returns
    -------
    The path of the picture, `ax`, or a `Picture`

    Raises
    ------
    InputError
        The result has no picture, a suffix, width or unit is wrong, both file and axis are given, or the file exists.
    MissingPackage
        matplotlib is not installed.

    Examples
    --------
    >>> import tcc_sim
    >>> run = tcc_sim.solve(tcc_sim.load_scene("minimal"), cycles=60, samples_per_cycle=200)
    >>> tcc_sim.plot(run, folder / "run.png").name
    'run.png'
    """
    if file is not None and ax is not None:
        raise InputError("give either a file or an axis to draw into")
    if units is not None and units not in UNITS:
        raise InputError(f"units is {units!r}; it must be {', '.join(UNITS)}")
    if ax is not None:
        return draw_into(ax, result, title)
    if file is None:
        with TemporaryDirectory(prefix="tcc_sim_") as folder:
            return Picture(plot(result, Path(folder) / "picture.png", width, title=title, units=units).read_bytes())
    path = Path(file)
    check_picture(path, width)
    if replaceable(path) and not force:
        raise InputError(f"{path} exists; it is not overwritten")
    name = str(result) if isinstance(result, (str, Path)) else "the result"
    if isinstance(result, (str, Path)):
        result = read_stored(Path(result))
    with refusing_damage(name) if isinstance(result, Mapping) else nullcontext():
        order = _order_of(result)
        if isinstance(result, Mapping):
            check_stored(name, result)
            units = units or getattr(arguments_in(result), "units", None)
            title, result = title or title_of(result), revived(result)
        with shown_in(units, order):
            return _drawn(result, path, width, title)


def _order_of(result: Any) -> float | None:
    """Return the `engine.order` of a result, or None if the result does not hold it."""
    run, system = getattr(result, "measured", result), system_behind(result)
    order: float | None = result.get("scene", {}).get("engine.order") if isinstance(result, Mapping) else getattr(
        run, "per_revolution", None if system is None else system.engine.order)
    return order


def _drawn(result: Any, path: Path, width: str, title: str) -> Path:
    """Draw a result to a file."""
    look = (drawer_of(kind_of(vars(result))),) if isinstance(result, Record) else look_of(result)
    if look is not None:
        look[0](path, result, title=title, width=style.width_of(width))
        return path
    run = _run_of(result)
    if run is result:
        return plot_run(run, path, width, title=title)
    if all(hasattr(result, name) for name in ("cycles", "first_cycle", "control")):
        return overview(path, run, result.cycles, result.first_cycle, result.summary, title or result.path.name,
                        control=result.control, width=width, spectrum=result.spectrum)
    return plot_run(run, path, width, summary=getattr(result, "summary", None), title=title,
                    spectrum=getattr(result, "spectrum", None))


LOOKS = {"Sweep": ("sweeps", "draw_sweep", "draw_maxima"), "Grid": ("sweeps", "draw_grid", "draw_largest"),
         "Scattered": ("sweeps", "draw_scatter", "draw_scattered"),
         "Linearisation": ("estimation", "bode", "draw_gain"),
         "Identification": ("estimation", "identification", "draw_fit"),
         "Orders": ("order_maps", "plot_orders", "draw_shaft_map"),
         "OrderComparison": ("order_maps", "plot_comparison", "draw_slip_difference"),
         "Spectrum": ("order_maps", "plot_spectrum", "draw_slip_spectrum"),
         "Scene": ("friction_law", "draw_friction", "draw_law"),
         "System": ("friction_law", "draw_friction", "draw_law"),
         "Twin": ("whole_runs", "draw_twin", "draw_slip_speeds")}
"""Module of `views`, function for a whole picture and function for an axis, by the name of a result's class. The first
function takes a png, svg or pdf file, the result (or its JSON, for sweeps and branches), a title and a width in inches,
and raises the errors of `style.figure` and `style.save`. `plot_run` and `overview` draw runs and results with a run.
"""
STUDIED = {"Motions": ("draw_branches", "branches_into"), "Basins": ("draw_basins", "basins_into")}
"""Both functions, by their names in `later_rooms`, for results of the study."""


KINDS = {"sweep": "Sweep", "continue": "Motions", "basins": "Basins", "linearise": "Linearisation",
         "identify": "Identification"}
"""Row of LOOKS or STUDIED that draws a kind of JSON."""


def look_of(result: Any) -> tuple[Callable[..., Any], Callable[..., Any]] | None:
    """Return both drawing functions for a result, its JSON, or a list of planes; None without a row."""
    name = type(result[0] if isinstance(result, list) and result else result).__name__
    if isinstance(result, Mapping):
        name = KINDS.get(kind_of(result), "")
        if name == "Sweep":
            name = "Scattered" if "scatter" in result else "Grid" if result.get("second_values") else "Sweep"
    if name in STUDIED:
        whole, main = STUDIED[name]
        return from_later_room(whole), from_later_room(main)
    if name not in LOOKS:
        return None
    module, whole, main = LOOKS[name]
    drawings = import_module(f"tcc_sim.views.{module}")
    return getattr(drawings, whole), getattr(drawings, main)


def _run_of(result: Any) -> Trajectory:
    """Return a run, the run of a result, or the first run of a recording; InputError if there is none."""
    run = getattr(result, "trajectory", result)
    run = run() if callable(run) else run
    if not isinstance(run, Trajectory):
        raise InputError(f"a {type(result).__name__} cannot be drawn; give a result of solve, simulate, analyse, read, "
                         "sweep, scatter, continuation, basins, linearise or identify")
    return run


def draw_into(ax: Any, result: Any, title: str = "") -> Any:
    """Draw the main curve of a result into an axis, with a legend of several curves or of areas.

    Raises
    ------
    InputError
        The result has no curve for an axis.
    """
    look, before, legend = look_of(result), len(style.entries(ax)[0]), ax.get_legend()
    if look is not None:
        look[1](ax, result)
    else:
        run = _run_of(result)
        if len(run.t) < 3:
            raise InputError(f"a {type(result).__name__} has no curve for an axis; a run needs samples, such as "
                             "samples_per_cycle=200")
        ax.plot(run.t, run.slip_speed, color=style.BLUE, linewidth=0.9)
        ax.set(xlabel="time (s)", ylabel="slip speed (rad/s)")
    named = style.entries(ax)[0]
    if ax.get_legend() is legend and len(named) > before and (len(named) > 1 or named[0].get_gid() == style.KEY):
        style.legend_into(ax)
    if title:
        ax.set_title(title, pad=style.room_for_legend(ax))
    return ax


def plot_run(solved: Trajectory, path: Path, width: str = "page", *, summary: Summary | None = None,
             title: str = "", spectrum: Spectrum | None = None) -> Path:
    """Draw the last cycles of a run, or all of a run whose scene has profiles.

    Parameters
    ----------
    solved : a run with samples; one with per-cycle results alone has no panels over time
    summary : summary of its steady state; computed by default
    spectrum : spectrum of its steady state, if requested
    """
    control = getattr(solved, "control", None)  # Only runs under commands have it.
    if len(solved.t) > 2 and solved.system is not None and solved.system.profile is not None:
        return manoeuvre(path, solved, style.width_of(width), title, control)
    whole = solved.cycles is not None and len(solved.cycles) > 0
    if not whole and len(solved.t) > 2 and solved.t[-1] - solved.t[0] >= solved.cycle:
        solved = replace(solved, cycles=cycles_of(solved))
        whole = solved.cycles is not None and len(solved.cycles) > 0
    if summary is None:
        summary = summarise(solved)
    cycles = solved.cycles if solved.cycles is not None else no_cycles()
    return overview(path, solved, cycles, first_cycle_of(solved) if whole else 0, summary, title,
                    control=control, width=width, spectrum=spectrum)
