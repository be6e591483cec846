"""The look of every picture in one place: sizes, fonts, colours, and how a picture is saved."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tcc_sim.errors import InputError, check_suffix, require
from tcc_sim.views.unit_axes import on_axes

COLUMN = 3.5
"""Width of a picture in one column of a paper, inch."""
PAGE = 7.2
"""Width of a picture over the whole page, inch."""
WIDTHS = {"column": COLUMN, "page": PAGE}
SUFFIXES: dict[str, dict[str, Any]] = {".png": {"Software": None}, ".svg": {"Date": None},
                                       ".pdf": {"CreationDate": None, "Producer": None, "Creator": None}}
"""What a picture may be written as, and what is left out of it so that the same picture is the same file."""
DOTS = 200
"""Resolution of a PNG, dots per inch."""

BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"
PURPLE, SKY, YELLOW = "#CC79A7", "#56B4E9", "#F0E442"
INK, GREY, STICK = "#222222", "#8C8C8C", "#DDE7EE"
RUNAWAY = "#8B0000"
"""Colour of slip that grows."""
CYCLE = (BLUE, RED, GREEN, ORANGE, PURPLE, SKY, INK)
"""Line colours in order: Okabe and Ito's, which colour-blind readers tell apart."""
MANY = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, YELLOW, "#7A4B00", "#5B2A86", "#F781BF", "#98D8C8", "#A65628",
        "#B3DE69", "#FB9A99", "#1B4F72", "#C7B299")
"""A colour for every period up to 16, in maps."""

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


@contextmanager
def figure(width: float = PAGE, height: float = 4.0, title: str = "") -> Iterator[Any]:
    """A matplotlib Figure of `width` by `height` inch in the house style, with a title over all of it where one is
    given; draw and save it inside the `with`.

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

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_SETTINGS)
        matplotlib.rcParams["axes.prop_cycle"] = cycler(color=CYCLE)
        # Texts are not equally wide at every resolution: the layout is that of the resolution at which it is saved.
        drawn = Figure(figsize=(width, height), dpi=DOTS, layout="constrained")
        FigureCanvasAgg(drawn)
        if title:
            # Ten points bold are about 0.085 inch a letter; what is longer than the picture is wide goes on below.
            drawn.suptitle(textwrap.fill(title, max(int(width / 0.085), 20)), x=0.01, ha="left", fontsize=10.0,
                           fontweight="bold")
        yield drawn


def json_values(result: Any) -> Mapping[str, Any]:
    """A result as its JSON has it, whether it is one or was read back."""
    values: Mapping[str, Any] = result if isinstance(result, Mapping) else result.as_json()
    return values


def width_of(name: str) -> float:
    """The width in inch of a picture that is column or page wide.

    Raises
    ------
    InputError
        Another word.
    """
    if name not in WIDTHS:
        raise InputError(f"width is {name!r}; it must be {' or '.join(WIDTHS)}")
    return WIDTHS[name]


def wide(width: float) -> bool:
    """Whether a picture of this width, inch, is one over the whole page."""
    return width > 0.5 * (COLUMN + PAGE)


def save(drawn: Any, path: Path) -> Path:
    """Write a picture as the suffix of `path` says, the same bytes every time for the same picture.

    Raises
    ------
    InputError
        Another suffix than those of SUFFIXES.
    """
    check_suffix(path, SUFFIXES)
    on_axes(drawn)
    _lay_out(drawn)
    drawn.savefig(path, metadata=SUFFIXES[path.suffix])
    return path


def _lay_out(drawn: Any) -> None:
    """Fix the layout."""
    if drawn.get_layout_engine() is not None:
        drawn.draw_without_rendering()
        drawn.set_layout_engine("none")
        _round_places(drawn)


def _round_places(drawn: Any) -> None:
    """Round the places of the axes: the solver of the layout leaves different last digits every time."""
    for axis in drawn.axes:
        axis.set_position([round(x, 5) for x in axis.get_position(original=True).bounds])


def save_both(drawn: Any, stem: Path) -> tuple[Path, Path]:
    """Write `stem`.png and `stem`.svg, laid out once for both; or one file where its suffix is that of a picture."""
    # An engine lays out anew in every pass, and a picture with one is drawn twice: it goes once its work is done.
    drawn.get_layout_engine().execute(drawn)
    drawn.set_layout_engine(None)
    _round_places(drawn)
    if stem.suffix in SUFFIXES:
        return stem, save(drawn, stem)
    raster = save(drawn, stem.with_name(stem.name + ".png"))
    return raster, save(drawn, stem.with_name(stem.name + ".svg"))


def panel_titles(axes: Any, titles: list[str]) -> None:
    """Letter the panels of a picture, (a), (b), ..., each with its title; above a legend where both need the row."""
    for letter, axis, title in zip("abcdefghijklmnop", axes, titles):
        words = f"({letter}) {title}" if len(axes) > 1 else title
        if not wide(axis.figure.get_figwidth()) and "$" not in words:
            words = textwrap.fill(words, 44)
        axis.set_title(words, pad=16.0 + 10.0 * (_rows_of(axis.get_legend()) - 1) if _crowded(axis, words) else None)


def _rows_of(legend: Any) -> int:
    """Lines of a legend, with those of its title."""
    heading, entries, columns = str(legend.get_title().get_text()), len(legend.get_texts()), int(legend._ncols)
    return -(-entries // columns) + (heading.count("\n") + 1 if heading else 0)


def _crowded(axis: Any, title: str) -> bool:
    """Whether a title and the entries of the legend above are wider than the axes, by about what letters need."""
    legend, place = axis.get_legend(), axis.get_subplotspec()
    if legend is None or place is None:
        return False
    columns = place.get_gridspec().ncols / len(place.colspan)
    room = 72.0 * axis.figure.get_figwidth() / columns - 40.0
    entries = [_entry(text.get_text(), text.get_fontsize()) for text in legend.get_texts()]
    return bool(5.6 * len(title) + sum(entries) > room)


def _entry(text: str, size: float) -> float:
    """Width of an entry of a legend with its line, in points, by about what letters need."""
    return (0.58 * _letters(text) + 2.6) * size


def _letters(text: str) -> int:
    """Letters of a text as it is drawn: a command of its mathematics is one."""
    return len(re.sub(r"\\[A-Za-z]+ ?|[${}_]", lambda found: "x" if found[0].startswith("\\") else "", text))


def legend_above(axis: Any) -> None:
    """The legend above the right end of the axes, where it hides nothing: in one row, or in rows that fit a column."""
    handles, labels = axis.get_legend_handles_labels()
    narrow = not wide(axis.figure.get_figwidth())
    small = {"fontsize": 6.5, "handlelength": 1.1, "columnspacing": 0.8, "handletextpad": 0.4} if narrow else {}
    columns = len(handles)
    while narrow and columns > 1 and columns * max(_entry(name, 6.5) for name in labels) > 72.0 * COLUMN - 50.0:
        columns -= 1
    if handles:
        axis.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, **small)


def legend_below(drawn: Any, axes: Sequence[Any]) -> None:
    """One legend of all axes below the picture, which grows by its rows."""
    found = {name: handle for axis in axes for handle, name in zip(*axis.get_legend_handles_labels())}
    if not found:
        return
    columns = min(len(found), max(int(72.0 * drawn.get_figwidth() / (4.3 * max(map(_letters, found)) + 32.0)), 1))
    drawn.set_figheight(drawn.get_figheight() + 0.17 * -(-len(found) // columns))
    drawn.legend(found.values(), found.keys(), loc="outside lower center", ncols=columns)
