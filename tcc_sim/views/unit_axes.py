"""Axes of pictures in the units that are asked for: data stay in SI, ticks and labels change."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from tcc_sim.output.shown_units import in_words, shown_axis


def on_axes(drawn: Any) -> None:
    """Turn the axes of a figure whose labels end with (rad/s), and speeds in its texts, into the units shown."""
    from matplotlib.text import Text

    for axes in (*drawn.axes, *(child for a in drawn.axes for child in a.child_axes)):
        for axis in (axes.xaxis, axes.yaxis):
            if (shown := shown_axis(axis.get_label_text())) is not None:
                axis.set_label_text(shown[0])
                _rescale(axis, shown[1])
    for text in drawn.findobj(Text):
        if (words := in_words(text.get_text())) != text.get_text():
            text.set_text(words)


def _rescale(axis: Any, factor: float) -> None:
    """Give an axis ticks at round numbers of another unit; its data stay as they are."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

    class Round(MaxNLocator):
        """Round numbers after scaling."""

        def tick_values(self, low: float, high: float) -> Any:
            """Places on the axis, in its own unit."""
            return np.asarray(super().tick_values(low * factor, high * factor)) / factor

    shown: Callable[[float, int], str] = lambda x, _: f"{x * factor:.6g}"  # noqa: E731
    if axis.get_scale() == "log":
        low, high = (np.log10(x * factor) for x in axis.get_view_interval())
        axis.set_major_locator(FixedLocator((10.0 ** np.arange(np.ceil(low), np.floor(high) + 1.0) / factor).tolist()))
        axis.set_minor_locator(NullLocator())
    else:
        axis.set_major_locator(Round(nbins=6, steps=[1, 2, 2.5, 5, 10]))
    axis.set_major_formatter(FuncFormatter(shown))
