"""Style of every picture: sizes, fonts, colours, labels and units of axes, legends, and files."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.errors import InputError, check_suffix, one_line, require
from tcc_sim.model.crank_speed import DERIVED
from tcc_sim.model.elements import list_of
from tcc_sim.model.parameters import QUANTITIES
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
STICK_SHARE = "#AFC4D4"
"""Shade of a column that is wholly in stick, where shares of stick are shaded."""
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
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5, "legend.fontsize": 7.5,
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
KEY = "key of a legend"
"""Matplotlib gid of artists that only stand in a legend."""


def use_file(path: Path | None) -> None:
    """Draw with the settings of a matplotlib style file on top of those of this package; None for these alone.

    Raises
    ------
    InputError
        The file cannot be read, or a line is not a setting of matplotlib.
    MissingPackage
        matplotlib is not installed.
    """
    if path is None:
        _CHOSEN.set(None)
        return
    require("matplotlib", "a style")
    import matplotlib

    try:
        text = path.read_text(encoding="utf-8")
        settings: dict[str, Any] = {}
        for number, line in enumerate(text.splitlines(), 1):
            key, _, value = line.partition("#" if line.lstrip().startswith("#") else ":")
            if not line.strip() or line.lstrip().startswith("#"):
                continue
            key = key.strip()
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
def figure(width: float = PAGE, height: float = 4.0, title: str = "") -> Iterator[Any]:
    """Yield a matplotlib Figure of `width` by `height` inch with a title; draw and save it inside the `with`.

    A style with larger labels makes it higher.

    Raises
    ------
    MissingPackage
        matplotlib is not installed.
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
            # A bold letter of ten points is about 0.085 inch wide.
            drawn.suptitle(textwrap.fill(title, max(int(width / 0.085), 20)), x=0.01, ha="left", fontsize=10.0,
                           fontweight="bold", parse_math=False)  # It has names of files.
        yield drawn


def json_values(result: Any) -> Mapping[str, Any]:
    """Return a result as JSON values; JSON values that were read back are returned unchanged."""
    values: Mapping[str, Any] = result if isinstance(result, Mapping) else result.as_json()
    return values


def width_of(name: str) -> float:
    """Return the width, inch, of a picture that is `column` or `page` wide.

    Raises
    ------
    InputError
        Another word.
    """
    if name not in WIDTHS:
        raise InputError(f"width is {name!r}; it must be {' or '.join(WIDTHS)}")
    return WIDTHS[name]


def wide(width: float) -> bool:
    """Return whether a picture of this width, inch, covers the whole page."""
    return width > 0.5 * (COLUMN + PAGE)


def save(drawn: Any, path: Path) -> Path:
    """Write a picture in the format of the suffix of `path`; the same picture gives the same bytes.

    Raises
    ------
    InputError
        Another suffix than those of SUFFIXES.
    """
    check_suffix(path, SUFFIXES)
    convert_axes(drawn)
    lay_out(drawn)
    drawn.savefig(path, metadata=SUFFIXES[path.suffix])
    return path


def convert_axes(drawn: Any) -> None:
    """Convert the axes of a figure whose labels end with (rad/s) to the selected unit; the data stay in SI."""
    for axes in (*drawn.axes, *(child for a in drawn.axes for child in a.child_axes)):
        for axis in (axes.xaxis, axes.yaxis):
            if (shown := shown_axis(axis.get_label_text())) is not None:
                axis.set_label_text(shown[0])
                _rescale(axis, shown[1])


def _rescale(axis: Any, factor: float) -> None:
    """Place the ticks of an axis at round numbers of another unit."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

    class Round(MaxNLocator):
        """Ticks at round numbers of the other unit."""

        def tick_values(self, low: float, high: float) -> Any:
            """Return the ticks in the unit of the data."""
            return np.asarray(super().tick_values(low * factor, high * factor)) / factor

    if axis.get_scale() == "log":
        low, high = sorted(x * factor for x in axis.get_view_interval())
        powers = 10.0 ** np.arange(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1.0)
        few = np.count_nonzero((powers >= low) & (powers <= high)) < 2
        ticks = np.outer([1.0, 2.0, 3.0, 5.0] if few else [1.0], powers) / factor
        axis.set_major_locator(FixedLocator(ticks.ravel().tolist()))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(
            lambda x, _: f"{x * factor:.3g}" if few else f"$10^{{{round(math.log10(x * factor))}}}$"))
    else:
        axis.set_major_locator(Round(nbins=6, steps=[1, 2, 2.5, 5, 10]))
        axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x * factor:.6g}"))


def widened(limits: tuple[float, float]) -> tuple[float, float]:
    """Return the limits of an axis, at least NARROWEST apart."""
    low, high = limits
    missing = max(NARROWEST * max(abs(low), abs(high)) - (high - low), 0.0)
    return low - 0.5 * missing, high + 0.5 * missing


def label_of(key: str) -> str:
    """Return the label of an axis over a scene key, such as "mean pressure $P_m$ (Pa)"."""
    meant = {**QUANTITIES, **DERIVED}.get(list_of(key))
    return key if meant is None else f"{meant.label or key}{meant.unit and f' ({meant.unit})'}"


def lay_out(drawn: Any) -> None:
    """Place the axes of a figure for good, once; with a layout engine, every file would be drawn twice. The positions
    are rounded, since the engine leaves their last digits different every time.
    """
    if drawn.get_layout_engine() is None:
        return
    _keep_numbers_plain(drawn)
    drawn.get_layout_engine().execute(drawn)
    drawn.set_layout_engine(None)
    for axis in drawn.axes:
        axis.set_position([round(x, 5) for x in axis.get_position(original=True).bounds])


def _keep_numbers_plain(drawn: Any) -> None:
    """Write the numbers at ticks as plain text: in mathematical typesetting they look the same and take ten times as
    long. A power of ten beside the axis stays typeset.
    """
    from matplotlib.ticker import ScalarFormatter

    class Plain(ScalarFormatter):
        """Numbers without mathematical typesetting."""

        def __call__(self, x: float, pos: int | None = None) -> str:
            """Return the text of a tick."""
            return super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")

    for axes in drawn.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if type(axis.get_major_formatter()) is ScalarFormatter:
                axis.set_major_formatter(Plain())


def save_both(drawn: Any, stem: Path) -> tuple[Path, Path]:
    """Write `stem`.png and `stem`.svg with one layout, or one file if `stem` has the suffix of a picture."""
    lay_out(drawn)
    if stem.suffix in SUFFIXES:
        return stem, save(drawn, stem)
    raster = save(drawn, stem.with_name(stem.name + ".png"))
    return raster, save(drawn, stem.with_name(stem.name + ".svg"))


def panel_titles(axes: Any, titles: list[str]) -> None:
    """Title the panels (a), (b), ...; a title that does not fit beside the legend is placed above it."""
    for letter, axis, title in zip("abcdefghijklmnop", axes, titles):
        words = f"({letter}) {title}" if len(axes) > 1 else title
        if not wide(axis.figure.get_figwidth()) and "$" not in words:
            words = textwrap.fill(words, 44)
        axis.set_title(words, pad=room_for_legend(axis) if _crowded(axis, words) else None)


def room_for_legend(axis: Any) -> float | None:
    """Return the distance of a title from the axes that leaves room for the legend above them, points; None without."""
    legend = axis.get_legend()
    return None if legend is None or legend._bbox_to_anchor is None else 16.0 + 10.0 * (_rows_of(legend) - 1)


def _rows_of(legend: Any) -> int:
    """Return the number of lines of a legend, its title included."""
    heading, entries, columns = str(legend.get_title().get_text()), len(legend.get_texts()), int(legend._ncols)
    return -(-entries // columns) + (heading.count("\n") + 1 if heading else 0)


def _crowded(axis: Any, title: str) -> bool:
    """Estimate whether a title and the legend beside it are wider than the axes."""
    legend, place = axis.get_legend(), axis.get_subplotspec()
    if legend is None or place is None or legend._bbox_to_anchor is None:  # A legend within the axes.
        return False
    columns = place.get_gridspec().ncols / len(place.colspan)
    room = 72.0 * axis.figure.get_figwidth() / columns - 40.0
    entries = [_entry(text.get_text(), text.get_fontsize()) for text in legend.get_texts()]
    return bool(5.6 * len(title) + sum(entries) > room)


def _entry(text: str, size: float) -> float:
    """Estimate the width of a legend entry with its line, points."""
    return (0.58 * _letters(text) + 2.6) * size


def _letters(text: str) -> int:
    """Return the number of letters of a drawn text; a command of its mathematics is one letter."""
    return len(re.sub(r"\\[A-Za-z]+ ?|[${}_]", lambda match: "x" if match[0].startswith("\\") else "", text))


def key(axis: Any, label: str, *, area: bool = False, **look: Any) -> Any:
    """Add a legend entry for marks or areas that the axes hold without a label, and return its artist."""
    drawn, = axis.fill([], [], label=label, **look) if area else axis.plot([], [], label=label, **look)
    drawn.set_gid(KEY)
    return drawn


def entries(axis: Any) -> tuple[list[Any], list[str]]:
    """Return artists and labels for a legend of axes: those with at least one finite point, and those of `key`."""
    shown = [(handle, name) for handle, name in zip(*axis.get_legend_handles_labels()) if _has_points(handle)]
    return [handle for handle, _ in shown], [name for _, name in shown]


def _has_points(artist: Any) -> bool:
    """Return whether an artist has a finite point, or is a legend's own."""
    if artist.get_gid() == KEY:
        return True
    if hasattr(artist, "get_xydata"):
        parts = [artist.get_xydata()]
    elif hasattr(artist, "get_paths"):
        parts = [path.vertices for path in artist.get_paths()]
    else:
        parts = [artist.get_patch_transform().transform(artist.get_path().vertices)]
    return any(bool(np.isfinite(np.ma.filled(xy, np.nan)).all(axis=1).any()) for xy in parts)


def legend(axis: Any, **look: Any) -> Any:
    """Draw a legend of what the axes show, and return it; None if there is nothing to name."""
    handles, labels = entries(axis)
    return axis.legend(handles, labels, **look) if handles else None


def legend_into(axis: Any) -> None:
    """Draw a legend within axes where it covers no line, mark or text; above them if there is no such place."""
    drawn = legend(axis, loc="best")
    if drawn is None:
        return
    axis.autoscale_view()  # Limits are stale until a picture is drawn.
    box = drawn.get_window_extent().padded(1.0)
    bare = {"None", "none", " ", ""}
    for line in axis.lines:
        path = line.get_transform().transform_path(line.get_path())
        if path.cleaned(remove_nans=True, clip=(*box.min, *box.max), simplify=False).vertices[:-1].size and (
                line.get_linestyle() not in bare or box.count_contains(path.vertices)):
            legend(axis, loc="lower left", bbox_to_anchor=(0.0, 1.0), fontsize="small",
                   ncols=1 + (len(drawn.get_texts()) > 4))
            return


def legend_above(axis: Any) -> None:
    """Place the legend above the right end of the axes, in one row, or in rows that fit a column."""
    handles, labels = entries(axis)
    narrow = not wide(axis.figure.get_figwidth())
    small = {"fontsize": 6.5, "handlelength": 1.1, "columnspacing": 0.8, "handletextpad": 0.4} if narrow else {}
    columns = len(handles)
    while narrow and columns > 1 and columns * max(_entry(name, 6.5) for name in labels) > 72.0 * COLUMN - 50.0:
        columns -= 1
    if handles:
        axis.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, **small)


def legend_below(drawn: Any, axes: Sequence[Any]) -> None:
    """Place one legend of all axes below the picture, whose height grows by the rows of the legend."""
    handles = {name: handle for axis in axes for handle, name in zip(*entries(axis))}
    if not handles:
        return
    columns = min(len(handles), max(int(72.0 * drawn.get_figwidth() / (4.3 * max(map(_letters, handles)) + 32.0)), 1))
    drawn.set_figheight(drawn.get_figheight() + 0.17 * -(-len(handles) // columns))
    drawn.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=columns)
