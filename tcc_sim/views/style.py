"""The look of every picture in one place: sizes, fonts, colours, and how a picture is saved."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tcc_sim.errors import MissingPackage

COLUMN = 3.5
"""Width of a picture in one column of a paper, inch."""
PAGE = 7.2
"""Width of a picture over the whole page, inch."""
DOTS = 200
"""Resolution of a PNG, dots per inch."""

BLUE, ORANGE, GREEN, RED, PURPLE, SKY, YELLOW = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#F0E442"
INK, GREY, STICK = "#222222", "#8C8C8C", "#DDE7EE"
CYCLE = (BLUE, RED, GREEN, ORANGE, PURPLE, SKY, INK)
"""Line colours in order: Okabe and Ito's, which colour-blind readers tell apart."""

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
    "axes.formatter.use_mathtext": True, "axes.formatter.limits": (-3, 4),
    "savefig.dpi": DOTS, "svg.fonttype": "path", "svg.hashsalt": "tcc_sim", "path.simplify": True,
    "agg.path.chunksize": 20000,
}


@contextmanager
def figure(width: float = PAGE, height: float = 4.0) -> Iterator[Any]:
    """A matplotlib Figure of `width` by `height` inch in the house style; draw and save it inside the `with`.

    Raises
    ------
    MissingPackage
        matplotlib is not installed.
    """
    try:
        import matplotlib
        from cycler import cycler
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingPackage("pictures need matplotlib: install tcc_sim[view]") from None
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_SETTINGS)
        matplotlib.rcParams["axes.prop_cycle"] = cycler(color=CYCLE)
        drawn = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(drawn)
        yield drawn


def save(drawn: Any, path: Path) -> Path:
    """Write a picture as the suffix of `path` says, png or svg, the same bytes every time for the same picture."""
    metadata: dict[str, Any] = {"Date": None} if path.suffix == ".svg" else {"Software": None}
    drawn.savefig(path, metadata=metadata)
    return path


def save_both(drawn: Any, stem: Path) -> tuple[Path, Path]:
    """Write `stem`.png and `stem`.svg, laid out once for both."""
    # An engine lays out anew in every pass, and a picture with one is drawn twice, so it goes once it has done its work.
    drawn.get_layout_engine().execute(drawn)
    drawn.set_layout_engine(None)
    raster = save(drawn, stem.with_name(stem.name + ".png"))
    return raster, save(drawn, stem.with_name(stem.name + ".svg"))


def panel_titles(axes: Any, titles: list[str]) -> None:
    """Letter the panels of a picture, (a), (b), ..., each with its title."""
    for letter, axis, title in zip("abcdefghijklmnop", axes, titles):
        axis.set_title(f"({letter}) {title}")


def legend_above(axis: Any) -> None:
    """The legend in one row above the right end of the axes, where it hides nothing."""
    handles, labels = axis.get_legend_handles_labels()
    if handles:
        axis.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(handles))
