"""Pictures of results: of every result class of the package, and of the JSON of most commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tcc_sim.analysis.steady.summary import cycles_of, first_cycle_of, summarise
from tcc_sim.errors import InputError, TccError, check_suffix, one_line, printable, require
from tcc_sim.later_rooms import from_later_room
from tcc_sim.output.files import replaceable
from tcc_sim.result import system_behind
from tcc_sim.shown_units import UNITS, shown_in
from tcc_sim.trajectory import Trajectory, no_cycles
from tcc_sim.views import style
from tcc_sim.views.panels import Panel, compose, draw_into
from tcc_sim.views.runs import NO_CONTROL, last_cycles, manoeuvre
from tcc_sim.views.stored import DAMAGE, Record, kind_of, read_stored, revived


@dataclass(frozen=True, repr=False)
class Picture:
    """Picture without a file, which a notebook shows.

    png : content of a .png file
    """

    png: bytes

    def __repr__(self) -> str:
        return f"<Picture: {len(self.png)} bytes of PNG>"

    def _repr_png_(self) -> bytes:
        return self.png


def check_picture(path: Path, width: str = "page") -> None:
    """Check that a picture can be written to `path`, before anything is computed.

    Raise InputError: the suffix is not .png, .svg or .pdf, or the width is not column or page; MissingPackage:
    matplotlib is not installed.
    """
    check_suffix(path, style.SUFFIXES, "--plot ")
    style.width_of(width)
    require("matplotlib", "a picture")


def plot(result: Any, file: str | Path | None = None, width: str = "page", *, title: str | None = None,
         ax: Any = None, force: bool = False, units: str | None = None) -> Any:
    """Draw a result as a picture, or its main curve into an axis.

    Parameters
    ----------
    result : a result of any function of the package; the JSON of a command or the name of its .json or .npz file; a
        scene, of which the friction law is drawn; of a recording, the first run is drawn. Nothing is solved: of a run
        without samples, its section and the maxima of its cycles are drawn
    file : name ending in .png, .svg or .pdf; without file and axis, the picture is returned, and a notebook shows it
    width : column or page of a paper
    title : title above the picture; None for that of the command which wrote the JSON, else none
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
    if file is None and ax is None:
        with TemporaryDirectory(prefix="tcc_sim_") as folder:
            return Picture(plot(result, Path(folder) / "picture.png", width, title=title, units=units).read_bytes())
    path = Path(file or "")
    if ax is None:
        check_picture(path, width)
        if replaceable(path) and not force:
            raise InputError(f"{path} exists; it is not overwritten")
    name = str(result) if isinstance(result, (str, Path)) else "the result"
    if isinstance(result, (str, Path)):
        result = read_stored(Path(result))
    stored = result if isinstance(result, Mapping) else None
    try:
        order = _order_of(result)
        if stored is not None:
            units = units or stored.get("shown_units")
            title = printable(str(stored.get("title", ""))) if title is None else title
            result = revived(stored, name)
        with shown_in(units, order):
            kind, title, inches = _class_of(result), title or "", style.width_of(width)
            if isinstance(result, Record):
                if ax is not None:
                    raise InputError(f"the picture of {name} has several panels; give a file in place of an axis")
                drawn: Path = from_later_room(f"draw_{kind_of(vars(result))}")(path, result, title=title, width=inches)
                return drawn
            if ax is not None:
                return draw_into(ax, panels_of(result)[0], title)
            if not title and hasattr(result, "first_cycle"):
                title = result.path.name
            if kind == "Twin":
                title = f"{title}: {result}" if title else str(result)
            return compose(path, panels_of(result), title, inches, below=kind in BELOW)
    except DAMAGE as error:
        if stored is None or isinstance(error, TccError):
            raise
        raise InputError(f"{name} is damaged, or no command of this version wrote it ({type(error).__name__}: "
                         f"{one_line(str(error))})") from None


def _order_of(result: Any) -> float | None:
    run, system = getattr(result, "measured", result), system_behind(result)
    order: float | None = result.get("scene", {}).get("engine.order") if isinstance(result, Mapping) else getattr(
        run, "per_revolution", None if system is None else system.engine.order)
    return order


PANELS = {"Sweep": "sweeps.sweep_panels", "Grid": "sweeps.grid_panels", "Scattered": "sweeps.scatter_panels",
          "GainMap": "sweeps.gain_panels", "Linearisation": "estimation.bode",
          "Identification": "estimation.identification", "Orders": "order_maps.order_panels",
          "OrderComparison": "order_maps.comparison_panels", "Spectrum": "order_maps.spectrum_panels",
          "Scene": "estimation.friction_panels", "System": "estimation.friction_panels",
          "Twin": "runs.beside_recording", "Motions": "branch_panels", "Basins": "basin_panels"}
"""Function that returns the panels of a result, by the name of its class: in a module of `views`, or by its name in
`later_rooms`. The first panel is that for an axis.
"""
KINDS = {"sweep": "Sweep", "continue": "Motions", "basins": "Basins", "linearise": "Linearisation",
         "identify": "Identification"}
"""Class of the result of a kind of JSON."""
BELOW = ("Grid", "Scattered", "GainMap", "Scene", "System", "Motions", "Basins")
"""Results whose panels have one legend below them."""
AS_JSON = ("Sweep", "Grid", "Scattered", "GainMap", "Linearisation", "Motions")
"""Results that are drawn from their JSON."""


def _class_of(result: Any) -> str:
    """Return the name in PANELS of a result, its JSON, or a list of planes."""
    if not isinstance(result, Mapping):
        return type(result[0] if isinstance(result, list) and result else result).__name__
    name = KINDS.get(kind_of(result), "")
    if name != "Sweep":
        return name
    return ("GainMap" if "law" in result else "Scattered" if "scatter" in result else
            "Grid" if result.get("second_values") else "Sweep")


def panels_of(result: Any) -> list[Panel]:
    """Return the panels of a result; raise InputError if it has no picture."""
    name = _class_of(result)
    if name in PANELS:
        module, _, function = PANELS[name].rpartition(".")
        draw = getattr(import_module(f"tcc_sim.views.{module}"), function) if module else from_later_room(function)
        panels: list[Panel] = draw(result if name not in AS_JSON or isinstance(result, Mapping) else result.as_json())
        return panels
    run, summary = getattr(result, "trajectory", result), getattr(result, "summary", None)
    run = run() if callable(run) else run  # A recording: its first run.
    if not isinstance(run, Trajectory):
        raise InputError(f"a {type(result).__name__} cannot be drawn; give a result of solve, simulate, analyse, read, "
                         "sweep, scatter, continuation, basins, linearise or identify")
    if hasattr(result, "first_cycle"):  # The replay of a recording has the end of its run only.
        return last_cycles(run, result.cycles, result.first_cycle, result.summary, result.control, result.spectrum)
    control = getattr(run, "control", None) or NO_CONTROL  # Only runs under commands have it.
    if len(run.t) > 2 and run.system is not None and run.system.profile is not None:
        return manoeuvre(run, control)
    if not run.cycles and len(run.t) > 2 and run.t[-1] - run.t[0] >= run.cycle:
        run = replace(run, cycles=cycles_of(run))
    return last_cycles(run, run.cycles if run.cycles is not None else no_cycles(),
                       first_cycle_of(run) if run.cycles else 0, summary or summarise(run), control,
                       getattr(result, "spectrum", None))
