"""Pictures as tables of panels, and one composer of a page and of an axis of somebody else's figure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from string import ascii_lowercase
from typing import Any, NamedTuple

from tcc_sim.views import style
from tcc_sim.views.style import AxisQuantity


class Panel(NamedTuple):
    """A panel of a picture.

    draw : function that draws the curves into an axis
    height : inch
    x, y : quantities along the axes; None where `draw` names them
    beside : whether it stands beside the panel before it where the picture covers a page
    over : whether it shares the horizontal axis of the panel above it
    alone : panel for an axis of another figure, if it differs
    named : whether its curves have a legend
    close : whether it stands beside the panel before it in a column too
    """

    title: str
    draw: Callable[[Any], object]
    height: float = 1.6
    x: AxisQuantity | None = None
    y: AxisQuantity | None = None
    beside: bool = False
    over: bool = False
    alone: Panel | None = None
    named: bool = True
    close: bool = False

    def draw_labelled(self, axis: Any) -> None:
        """Draw the panel with the names of its quantities."""
        self.draw(axis)
        style.quantities(axis, self.x, self.y)


def compose(path: Path, panels: Sequence[Panel], title: str = "", width: float = style.PAGE, *,
            below: bool = False, caption: str = "", formulas: bool = False) -> Path:
    """Draw panels with letters, unless only one has a title, below each other, or beside each other where a page has
    room, to a file, or to `path`.png and `path`.svg if it has no suffix.

    below : whether one legend of all panels stands below them, in place of legends above each; it adds to the height
    caption : lines below all panels
    formulas : whether the title may have formulas

    Raise MissingPackage: matplotlib is not installed; InputError: another suffix.
    """
    rows = list(_rows(panels, style.wide(width)))
    heights = [max(panel.height for panel in row) for row in rows]
    columns = min(max(map(len, rows)), 2)  # Of more, each row has its own: all need room for labels and colour bars.
    height = sum(heights) + 0.3 * bool(title) + 0.14 * len(caption.splitlines())
    with style.figure(width, height, title, formulas) as drawn:
        if caption:
            drawn.supxlabel(caption, x=0.01, ha="left", fontsize=6.8, color=style.GREY)
        grid = drawn.add_gridspec(len(rows), columns, height_ratios=heights)
        axes: list[Any] = []
        for k, row in enumerate(rows):
            places = ([grid[k, :]] if len(row) == 1 else [grid[k, n] for n in range(2)] if len(row) == 2 else
                      list(grid[k, :].subgridspec(1, len(row))))
            above = axes[len(axes) - len(rows[k - 1]):] if k else []
            for n, (panel, place) in enumerate(zip(row, places)):
                shared = above[n] if panel.over and n < len(above) else None
                axes.append(drawn.add_subplot(place, sharex=shared))
                panel.draw_labelled(axes[-1])
                if shared is not None:
                    shared.set_xlabel("")
                    shared.tick_params(labelbottom=False)
        titled = [(axis, panel.title) for axis, panel in zip(axes, panels) if panel.title]
        for letter, (axis, words) in zip(ascii_lowercase, titled):
            axis.set_title(f"({letter}) {words}" if len(titled) > 1 else words)
        named = [axis for axis, panel in zip(axes, panels) if panel.named]
        if not below:
            for axis in named:
                style.legend_above(axis)
        elif names := {name: handle for axis in named for handle, name in zip(*style.entries(axis))}:
            legend = style.fitted_legend(drawn, names.values(), names, 0.98 * drawn.bbox.width,
                                         loc="outside lower center")
            drawn.set_figheight(drawn.get_figheight() + legend.get_window_extent().height / drawn.dpi)
        return style.save(drawn, path)


def _rows(panels: Sequence[Panel], wide: bool) -> Iterator[list[Panel]]:
    row: list[Panel] = []
    for panel in panels:
        if row and not (panel.close or (wide and panel.beside)):
            yield row
            row = []
        row.append(panel)
    yield row


def draw_into(axis: Any, panel: Panel, title: str = "") -> Any:
    """Draw a panel into an axis with a legend of several curves or of areas, and return the axis."""
    before, legend = len(style.entries(axis)[0]), axis.get_legend()
    (panel.alone or panel).draw_labelled(axis)
    if title:
        axis.set_title(title)
    named = style.entries(axis)[0]
    if axis.get_legend() is legend and len(named) > before and (len(named) > 1 or named[0].get_gid() == style.KEY):
        style.legend_above(axis)
    return axis
