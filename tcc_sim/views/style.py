"""Style of every picture: sizes, fonts, colours, quantities along axes, legends, and files."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.errors import InputError, check_suffix, one_line, require
from tcc_sim.model.parameters import DERIVED, QUANTITIES, list_of
from tcc_sim.shown_units import shown_axis

COLUMN = 3.5
"""Width of a picture in one column of a paper, inch."""
PAGE = 7.2
"""Width of a picture over the whole page, inch."""
WIDTHS = {"column": COLUMN, "page": PAGE}
SUFFIXES: dict[str, dict[str, Any]] = {".png": {"Software": None}, ".svg": {"Date": None},
                                       ".pdf": {"CreationDate": None, "Producer": None, "Creator": None}}
"""Suffixes of pictures, and metadata left out, so that the same picture is the same file."""
DOTS = 200
"""Resolution of a PNG, dots per inch."""

BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"
PURPLE, SKY, YELLOW = "#CC79A7", "#56B4E9", "#F0E442"
INK, GREY, STICK = "#222222", "#8C8C8C", "#DDE7EE"
RUNAWAY = "#8B0000"
"""Colour of slip that grows."""
CYCLE = (BLUE, RED, GREEN, ORANGE, PURPLE, SKY, INK)
"""Line colours in order: those of Okabe and Ito, which colour-blind readers can distinguish."""
MANY = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, YELLOW, "#7A4B00", "#5B2A86", "#F781BF", "#98D8C8", "#A65628",
        "#B3DE69", "#FB9A99", "#1B4F72", "#C7B299")
"""A colour for every period up to 16, in maps."""

NARROWEST = 0.02
"""Smallest span of an axis, relative to its largest value; a narrower one shows rounding errors."""

_SETTINGS: dict[str, Any] = {
    "font.family": "DejaVu Sans", "font.size": 8.0, "axes.titlesize": 8.5, "axes.labelsize": 8.0,
    "xtick.labelsize": 7.5, "ytick.labelsize": 7.5, "legend.fontsize": 7.5,
    "axes.titlelocation": "left", "axes.titleweight": "bold", "axes.titlepad": 5.0,
    "text.color": INK, "axes.labelcolor": INK, "axes.edgecolor": INK, "xtick.color": INK, "ytick.color": INK,
    "axes.linewidth": 0.7, "xtick.major.width": 0.7, "ytick.major.width": 0.7, "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "axes.spines.top": False, "axes.spines.right": False, "axes.axisbelow": True,
    "axes.grid": True, "grid.color": "#E3E3E3", "grid.linewidth": 0.5,
    "lines.linewidth": 1.1, "lines.solid_joinstyle": "round", "lines.markersize": 3.0,
    "legend.frameon": False, "legend.handlelength": 1.6, "legend.borderaxespad": 0.2, "legend.columnspacing": 1.2,
    "axes.formatter.use_mathtext": True, "axes.formatter.limits": (-3, 6),
    "savefig.dpi": DOTS, "svg.fonttype": "path", "svg.hashsalt": "tcc_sim", "path.simplify": True,
    "pdf.fonttype": 42, "ps.fonttype": 42,  # TrueType: journals refuse Type 3, and text can be searched.
    "agg.path.chunksize": 20000,
}


_CHOSEN: ContextVar[Mapping[str, Any] | None] = ContextVar("chosen", default=None)
KEY, ABOVE = "key of a legend", "legend above the axes"
"""Matplotlib gids of artists that only stand in a legend, and of legends that are placed again in the saved picture."""


class AxisQuantity(NamedTuple):
    """AxisQuantity along an axis: its name, SI unit, and `frequency` as for `shown_units.shown_axis`."""

    name: str
    unit: str = ""
    frequency: str = ""


TIME, PERIOD = AxisQuantity("time", "s"), AxisQuantity("period of excitation")
SLIP, MAX_SLIP = AxisQuantity("slip speed", "rad/s"), AxisQuantity("max |slip speed|", "rad/s")
PLATE_SPEED, ANGLE = AxisQuantity("plate speed", "rad/s"), AxisQuantity("plate angle", "rad")
TORQUE, HEAT = AxisQuantity("torque", "N m"), AxisQuantity("heat", "kJ")
FREQUENCY = AxisQuantity("angular frequency", "rad/s", "other")
ENGINE = AxisQuantity("engine frequency", "rad/s", "engine")


def use_file(path: Path | None) -> None:
    """Draw with the settings of a matplotlib style file on top of those of this package; None for these alone.

    Raise InputError: the file cannot be read, or a line is not a setting of matplotlib; MissingPackage: matplotlib is
    not installed.
    """
    if path is None:
        _CHOSEN.set(None)
        return
    require("matplotlib", "a style")
    import matplotlib

    settings: dict[str, Any] = {}
    try:
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            if not line.strip() or line.lstrip().startswith("#"):
                continue
            key, value = (part.strip() for part in line.partition(":")[::2])
            if key not in matplotlib.rcParams or key.startswith("backend"):
                raise InputError(f"{path}: line {number}: {one_line(key)} is not a setting of a matplotlib style")
            try:
                settings[key] = matplotlib.rcParams.validate[key](value.partition(" #")[0].strip())
            except ValueError as error:
                raise InputError(f"{path}: line {number}: {key}: {one_line(str(error))}") from None
    except (OSError, UnicodeError) as error:
        raise InputError(f"{path} cannot be read: {getattr(error, 'strerror', None) or 'it is no text'}") from None
    _CHOSEN.set(settings)


@contextmanager
def figure(width: float = PAGE, height: float = 4.0, title: str = "", formulas: bool = False) -> Iterator[Any]:
    """Yield a matplotlib Figure of `width` by `height` inch with a title, which may have formulas; draw and save it
    inside the `with`.

    A style with larger labels makes it higher.

    Raise MissingPackage: matplotlib is not installed.
    """
    require("matplotlib", "a picture")
    import matplotlib
    from cycler import cycler
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.font_manager import FontProperties

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_SETTINGS)
        matplotlib.rcParams["axes.prop_cycle"] = cycler(color=CYCLE)
        matplotlib.rcParams.update(_CHOSEN.get() or {})
        points = FontProperties(size=matplotlib.rcParams["axes.labelsize"]).get_size_in_points()
        height *= max(points / _SETTINGS["axes.labelsize"], 1.0)  # Panels grow with the labels beside them.
        # The width of a text depends on the resolution, so the layout uses the resolution of the saved picture.
        drawn = Figure(figsize=(width, height), dpi=DOTS, layout="constrained")
        FigureCanvasAgg(drawn)
        if title:
            drawn.suptitle(title, x=0.01, ha="left", fontsize=10.0, fontweight="bold", wrap=True,
                           parse_math=formulas)  # Names of files are none.
        yield drawn


def width_of(name: str) -> float:
    """Return the width, inch, of a picture that is `column` or `page` wide; raise InputError for another word."""
    if name not in WIDTHS:
        raise InputError(f"width is {name!r}; it must be {' or '.join(WIDTHS)}")
    return WIDTHS[name]


def wide(width: float) -> bool:
    """Return whether a picture of this width, inch, covers the whole page."""
    return width > 0.5 * (COLUMN + PAGE)


def colour_of(period: int) -> str:
    """Return the colour of motions of a period, the same in every picture; dark without a period."""
    return MANY[(period - 1) % len(MANY)] if period else INK


def tint(colour: Any) -> tuple[float, ...]:
    """Return a light version of a colour."""
    from matplotlib.colors import to_rgb

    return tuple(1.0 - 0.35 * (1.0 - part) for part in to_rgb(colour))


def quantity_of(key: str) -> AxisQuantity:
    """Return the quantity of a scene key, such as "mean pressure $P_m$" in Pa."""
    meant = {**QUANTITIES, **DERIVED}.get(list_of(key))
    if meant is None:
        return AxisQuantity(key)
    return AxisQuantity(meant.label or key, meant.unit, "engine" if key == "engine.frequency" else "")


def quantities(axis: Any, x: AxisQuantity | None = None, y: AxisQuantity | None = None) -> None:
    """Name the quantities along axes in the selected unit, with ticks at its round numbers; the data stay in SI."""
    for side, quantity in ((axis.xaxis, x), (axis.yaxis, y)):
        if quantity is not None:
            label, factor = shown_axis(*quantity)
            side.set_label_text(label)
            if factor != 1.0:
                _rescale(side, factor)


def _rescale(axis: Any, factor: float) -> None:
    from matplotlib.ticker import FuncFormatter, MaxNLocator, NullLocator

    class Round(MaxNLocator):
        """Ticks at round numbers of the other unit: on a logarithmic axis powers of ten, or more where there is one."""

        def tick_values(self, low: float, high: float) -> Any:
            """Return the ticks in the unit of the data."""
            low, high = low * factor, high * factor
            if axis.get_scale() != "log":
                return np.asarray(super().tick_values(low, high)) / factor
            powers = 10.0 ** np.arange(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1.0)
            few = np.count_nonzero((powers >= low) & (powers <= high)) < 2
            return np.outer([1.0, 2.0, 3.0, 5.0] if few else [1.0], powers).ravel() / factor

    axis.set_major_locator(Round(nbins=6, steps=[1, 2, 2.5, 5, 10]))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda x, _=None: f"{x * factor:.6g}"))


def widened(limits: tuple[float, float]) -> tuple[float, float]:
    """Return the limits of an axis, at least NARROWEST apart."""
    low, high = limits
    missing = max(NARROWEST * max(abs(low), abs(high)) - (high - low), 0.0)
    return low - 0.5 * missing, high + 0.5 * missing


def save(drawn: Any, path: Path) -> Path:
    """Write a picture in the format of the suffix of `path`, or to `path`.svg and `path`.png; return the last path.

    The same picture gives the same bytes. Raise InputError: another suffix than those of SUFFIXES.
    """
    for file in [path] if path.suffix else [path.with_suffix(".svg"), path.with_suffix(".png")]:
        check_suffix(file, SUFFIXES)
        lay_out(drawn)
        drawn.savefig(file, metadata=SUFFIXES[file.suffix])
    return file


def lay_out(drawn: Any) -> None:
    """Place the axes of a figure for good, once; with a layout engine, every file would be drawn twice. The positions
    are rounded, since the engine leaves their last digits different every time.

    Legends above axes, titles and labels then get the lines that the axes have room for, and the axes move again.
    """
    from matplotlib.ticker import ScalarFormatter

    class Plain(ScalarFormatter):
        """Numbers at ticks as plain text: in mathematical typesetting they look the same and take ten times as long. A
        power of ten beside the axis stays typeset.
        """

        def __call__(self, x: float, pos: int | None = None) -> str:
            """Return the text of a tick."""
            return super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")

    engine = drawn.get_layout_engine()
    if engine is None:
        return
    for axis in (side for axes in drawn.axes for side in (axes.xaxis, axes.yaxis)):
        if type(axis.get_major_formatter()) is ScalarFormatter:
            axis.set_major_formatter(Plain())
    engine.execute(drawn)
    for axis in drawn.axes:
        box, titles = axis.get_window_extent(), (axis.title, axis._left_title)
        for text, size, room in ((axis.yaxis.label, axis.yaxis.label.get_window_extent().height, box.height),
                                 *((title, title.get_window_extent().width, box.width) for title in titles)):
            words = text.get_text()
            if size > room and "\n" not in words:
                text.set_text(textwrap.fill(words, max(int(0.88 * len(words) * room / size), 8)))
        if (named := axis.get_legend()) is not None and named.get_gid() == ABOVE:
            legend_above(axis)
    engine.execute(drawn)
    drawn.set_layout_engine(None)
    for axis in drawn.axes:
        axis.set_position([round(x, 5) for x in axis.get_position(original=True).bounds])


def key(axis: Any, label: str, *, area: bool = False, **look: Any) -> Any:
    """Add a legend entry for marks or areas that the axes hold without a label, and return its artist."""
    drawn, = axis.fill([], [], label=label, **look) if area else axis.plot([], [], label=label, **look)
    drawn.set_gid(KEY)
    return drawn


def entries(axis: Any) -> tuple[list[Any], list[str]]:
    """Return artists and labels for a legend of axes: those with at least one finite point, and those of `key`."""
    def points(artist: Any) -> list[Any]:
        if hasattr(artist, "get_xydata"):
            return [artist.get_xydata()]
        return [path.vertices for path in artist.get_paths()] if hasattr(artist, "get_paths") else [np.zeros((1, 2))]

    shown = [(handle, name) for handle, name in zip(*axis.get_legend_handles_labels())
             if handle.get_gid() == KEY or any(np.isfinite(np.ma.filled(xy, np.nan)).all(axis=1).any()
                                               for xy in points(handle))]
    return [handle for handle, _ in shown], [name for _, name in shown]


def legend_above(axis: Any) -> None:
    """Place the legend above the axes, in as many columns as they have room for, beside the title or below it."""
    narrow = not wide(axis.figure.get_figwidth())
    small = {"fontsize": 6.5, "handlelength": 1.1, "columnspacing": 0.8, "handletextpad": 0.4} if narrow else {}
    whole, room = axis.get_window_extent(), axis.get_window_extent().width
    top = max([whole.y1, *(each.get_tightbbox().y1 for each in axis.child_axes)])  # Above an axis along the upper side.
    drawn = fitted_legend(axis, *entries(axis), room, loc="lower right",
                    bbox_to_anchor=(1.0, 1.0 + (top - whole.y1) / whole.height), **small)
    if drawn is None:
        return
    drawn.set_gid(ABOVE)
    side = "left" if axis.get_title(loc="left") else "center"
    if title := axis.get_title(loc=side):
        box, words = drawn.get_window_extent(), axis.set_title(title, loc=side, pad=None).get_window_extent()
        beside = box.width + words.width * (1.0 if side == "left" else 2.0) < 0.95 * room
        above = (box.y1 - top) * 72.0 / axis.figure.dpi
        axis.set_title(title, loc=side, pad=None if beside else 4.0 + above)


def fitted_legend(holder: Any, handles: Any, names: Any, room: float, **look: Any) -> Any:
    """Return a legend of axes or of a figure with the largest number of columns that fit into a width, pixels, or one;
    None if there is nothing to name.
    """
    drawn = None
    for columns in range(len(names), 0, -1):
        if drawn is not None:
            drawn.remove()
        drawn = holder.legend(handles, names, ncols=columns, **look)
        if drawn.get_window_extent().width <= room:
            break
    return drawn
