"""Sizes, legends, titles, ticks and files of every picture: the rules of the style, by small figures."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tcc_sim.errors import InputError

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
from matplotlib.colors import to_hex

from tcc_sim.views import style

LOOK = {"font.size": 8.0, "axes.titlesize": 8.5, "axes.labelsize": 8.0, "xtick.labelsize": 7.5, "ytick.labelsize": 7.5,
        "legend.fontsize": 7.5, "lines.linewidth": 1.1, "lines.markersize": 3.0, "axes.linewidth": 0.7,
        "grid.linewidth": 0.5, "savefig.dpi": 200, "pdf.fonttype": 42, "ps.fonttype": 42, "axes.spines.top": False,
        "axes.spines.right": False, "axes.grid": True, "axes.axisbelow": True, "legend.frameon": False,
        "path.simplify": True, "axes.formatter.limits": [-3, 6]}
"""Settings that the page on pictures promises, or that journals ask for."""


def test_pictures_have_the_sizes_colours_and_settings_of_the_style() -> None:
    import matplotlib

    assert (style.width_of("column"), style.width_of("page")) == (3.5, 7.2)
    with pytest.raises(InputError, match=r"^width is 'poster'; it must be column or page$"):
        style.width_of("poster")
    assert [style.wide(width) for width in (3.5, 5.35, 5.36, 7.2)] == [False, False, True, True]
    before = matplotlib.rcParams["lines.linewidth"]
    with style.figure(3.5, 2.0, "t") as drawn:
        assert {name: matplotlib.rcParams[name] for name in LOOK} == LOOK
        assert (tuple(drawn.get_size_inches()), drawn.dpi, drawn._suptitle.get_text()) == ((3.5, 2.0), 200, "t")
        axis = drawn.subplots()
        colours = [to_hex(axis.plot([0, 1], [k, k])[0].get_color()).upper() for k in range(8)]
        assert colours == [*style.CYCLE, style.CYCLE[0]]
    assert matplotlib.rcParams["lines.linewidth"] == before
    assert len(set(style.MANY)) == len(style.MANY) == 16
    with style.figure(3.5, 2.0, "word " * 20) as drawn:
        lines = drawn._suptitle.get_text().splitlines()
    assert max(map(len, lines)) <= 41 < len(" ".join(lines[:2]))  # As many letters as a column is wide.
    with style.figure(1.0, 2.0, "word " * 20) as drawn:
        assert max(map(len, drawn._suptitle.get_text().splitlines())) in range(15, 21)


@pytest.mark.parametrize(("text", "settings", "says"), [
    ("# a\n\naxes.labelsize: 16 # large\nlines.linewidth : 2\n", {"axes.labelsize": 16.0, "lines.linewidth": 2.0}, ""),
    ("  # axes.labelsize: 9\n", {}, ""), ("axes.edgecolor: '#ff0000'\n", {"axes.edgecolor": "#ff0000"}, ""),
    ("lines.linewidth\n", {}, "line 1: lines.linewidth: "),
    ("\nno.setting: 3\n", {}, "line 2: no.setting is not a setting"),
    ("backend_fallback: True\n", {}, "line 1: backend_fallback is not a setting of a matplotlib style"),
    ("lines.linewidth: wide\n", {}, "line 1: lines.linewidth: Could not convert 'wide' to float")])
def test_a_style_file_is_read_line_by_line(text: str, settings: dict[str, Any], says: str, tmp_path: Path) -> None:
    import matplotlib

    (tmp_path / "a.mplstyle").write_text(text)
    try:
        if says:
            with pytest.raises(InputError) as caught:
                style.use_file(tmp_path / "a.mplstyle")
            assert str(caught.value).startswith(f"{tmp_path / 'a.mplstyle'}: {says}")
        else:
            style.use_file(tmp_path / "a.mplstyle")
            with style.figure(3.5, 2.0) as drawn:
                assert {name: matplotlib.rcParams[name] for name in settings} == settings
                assert drawn.get_figheight() == 2.0 * settings.get("axes.labelsize", 8.0) / 8.0
    finally:
        style.use_file(None)
    (tmp_path / "b.mplstyle").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match=r"b.mplstyle cannot be read: it is no text$"):
        style.use_file(tmp_path / "b.mplstyle")


def test_a_smaller_label_makes_no_lower_picture(tmp_path: Path) -> None:
    (tmp_path / "a.mplstyle").write_text("axes.labelsize: 4\n")
    try:
        style.use_file(tmp_path / "a.mplstyle")
        with style.figure(3.5, 2.0) as drawn:
            assert drawn.get_figheight() == 2.0
    finally:
        style.use_file(None)


@pytest.mark.parametrize(("limits", "wider"), [
    ((0.0, 10.0), (0.0, 10.0)), ((10.0, 10.0), (9.9, 10.1)), ((-10.0, -10.0), (-10.1, -9.9)),
    ((99.5, 100.5), (99.5 - 0.505, 100.5 + 0.505)), ((98.0, 100.0), (98.0, 100.0)), ((0.0, 0.0), (0.0, 0.0))])
def test_a_narrow_axis_is_widened_to_a_fiftieth(limits: tuple[float, float], wider: tuple[float, float]) -> None:
    assert style.widened(limits) == pytest.approx(wider)


def test_axes_are_named_by_their_keys() -> None:
    for key, label in (("engine.frequency", r"engine frequency $\omega$ (rad/s)"),
                       ("pressure.mean", "mean pressure $P_m$ (Pa)"),
                       ("engine.speed", r"crankshaft speed $\omega/n$ (rad/s)"), ("no.key", "no.key"),
                       ("friction.kinetic_coefficient", r"kinetic friction coefficient $\mu_k$")):
        assert style.label_of(key) == label


@pytest.mark.parametrize(("width", "titles", "shown"), [
    (style.PAGE, ["one"], ["one"]), (style.PAGE, ["one", "two"], ["(a) one", "(b) two"]),
    (style.COLUMN, ["word " * 12, "$x$ " * 20], ["(a) word word word word word word word word\nword word word word",
                                                 "(b) " + "$x$ " * 20])])
def test_panels_are_lettered_and_long_titles_are_broken_in_a_column(width: float, titles: list[str],
                                                                    shown: list[str]) -> None:
    with style.figure(width, 2.0) as drawn:
        axes = drawn.subplots(len(titles), 1, squeeze=False)[:, 0]
        style.panel_titles(axes, titles)
        assert [axis.get_title(loc="left") for axis in axes] == shown


def lines(axis: Any, *names: str) -> None:
    for k, name in enumerate(names):
        axis.plot([0.0, 1.0], [float(k)] * 2, label=name)


def place(axis: Any) -> tuple[float, float]:
    """Lower right corner of a legend in parts of the axes."""
    axis.figure.draw_without_rendering()
    box = axis.get_legend().get_window_extent().transformed(axis.transAxes.inverted())
    return float(box.x1), float(box.y0)


def test_a_legend_above_is_a_row_or_rows_that_fit_and_a_title_makes_room_for_it() -> None:
    for width, names, columns in ((style.PAGE, ("a", "b", "c"), 3), (style.COLUMN, ("a", "b", "c"), 3),
                                  (style.COLUMN, ("a long name of a line",) * 4, 2), (style.COLUMN, ("n" * 90, "b"), 1),
                                  (style.PAGE, ("a long name of a line",) * 4, 4)):
        with style.figure(width, 2.0) as drawn:
            axis = drawn.subplots()
            assert style.room_for_legend(axis) is None
            lines(axis, *names)
            style.legend_above(axis)
            legend = axis.get_legend()
            assert legend._ncols == columns
            assert [text.get_text() for text in legend.get_texts()] == list(names)
            assert {text.get_fontsize() for text in legend.get_texts()} == {7.5 if width == style.PAGE else 6.5}
            rows = math.ceil(len(names) / columns)
            assert style.room_for_legend(axis) == 16.0 + 10.0 * (rows - 1)
            if len(names) == 3:
                assert place(axis) == pytest.approx((1.0, 1.0), abs=0.05)
    with style.figure() as drawn:
        axis = drawn.subplots()
        style.legend_above(axis)
        assert axis.get_legend() is None
        lines(axis, "a")
        inside = style.legend(axis, loc="upper left", title="one\ntwo")
        assert style.room_for_legend(axis) is None  # It lies within the axes.
        assert style._rows_of(inside) == 3
        assert not style._crowded(axis, "x" * 500)


@pytest.mark.parametrize(("title", "crowded"), [("t", False), ("t" * 62, False), ("t" * 63, True)])
def test_a_title_goes_above_the_legend_where_both_do_not_fit(title: str, crowded: bool) -> None:
    """7.2 inches are 518.4 points, less 40; a letter of a title has 5.6 points, an entry 7.5 (2.6 + 0.58 a letter)."""
    with style.figure(style.PAGE, 2.0) as drawn:
        axis = drawn.subplots()
        lines(axis, "a" * 10, r"$\mu_k N$ b")
        style.legend_above(axis)
        room = 518.4 - 40.0 - 7.5 * (2.6 + 0.58 * 10) - 7.5 * (2.6 + 0.58 * 6)
        assert room == pytest.approx(5.6 * 67.4, abs=10.0)
        assert style._crowded(axis, title) == (5.6 * len(title) > room)
        style.panel_titles([axis], [title])
        axes = drawn.subplots(1, 2)
        lines(axes[0], "a" * 10)
        style.legend_above(axes[0])
        half = 259.2 - 40.0 - 7.5 * (2.6 + 5.8)
        assert [style._crowded(axes[0], "t" * n) for n in (int(half / 5.6), int(half / 5.6) + 1)] == [False, True]
    assert crowded in (True, False)


def test_letters_of_formulas_are_counted_as_they_are_drawn() -> None:
    assert [style._letters(text) for text in ("abc", r"$\mu_k N R$", r"$\omega$", "a_b", "{a}")] == [3, 6, 1, 2, 1]


def test_one_legend_below_names_everything_once_and_makes_room() -> None:
    for width, names, columns in ((style.PAGE, ("a", "b"), 2), (style.COLUMN, ("n" * 50, "b", "c"), 1),
                                  (style.PAGE, ("n" * 20,), 1),
                                  (style.PAGE, tuple(f"{'n' * 20}{k}" for k in range(9)), 4)):
        with style.figure(width, 2.0) as drawn:
            axes = drawn.subplots(1, 2)
            lines(axes[0], *names)
            lines(axes[1], names[0])
            style.legend_below(drawn, axes)
            legend, = drawn.legends
            assert [text.get_text() for text in legend.get_texts()] == list(names)
            assert legend._ncols == columns
            assert drawn.get_figheight() == pytest.approx(2.0 + 0.17 * math.ceil(len(names) / columns))
    with style.figure(style.PAGE, 2.0) as drawn:
        style.legend_below(drawn, [drawn.subplots()])
        assert (drawn.legends, drawn.get_figheight()) == ([], 2.0)


def test_a_legend_within_axes_leaves_them_where_it_would_cover_a_line() -> None:
    for crowd, count, within in ((False, 2, True), (True, 4, False), (True, 5, False)):
        with style.figure(style.COLUMN, 2.0) as drawn:
            axis = drawn.subplots()
            lines(axis, *"abcde"[:count])
            if crowd:
                x = np.linspace(0.0, 1.0, 400)
                axis.plot(x, 2.0 + 2.0 * np.sin(300.0 * x))
            style.legend_into(axis)
            legend = axis.get_legend()
            assert (legend._bbox_to_anchor is None) == within
            assert legend._ncols == (1 if count < 5 else 2)
    with style.figure() as drawn:
        axis = drawn.subplots()
        style.legend_into(axis)
        assert axis.get_legend() is None


def test_entries_of_keys_have_a_look_and_no_point() -> None:
    with style.figure() as drawn:
        axis = drawn.subplots()
        line = style.key(axis, "a", linestyle="none", marker="s")
        area = style.key(axis, "b", area=True, facecolor="red")
        assert (line.get_marker(), len(line.get_xdata())) == ("s", 0)
        assert to_hex(area.get_facecolor()) == "#ff0000"
        assert style.entries(axis) == ([line, area], ["a", "b"])
        assert line.get_gid() == area.get_gid() == style.KEY


def test_numbers_at_ticks_are_plain_and_files_are_named_by_their_suffix(tmp_path: Path) -> None:
    with style.figure(style.COLUMN, 2.0) as drawn:
        axis = drawn.subplots()
        axis.plot([-1.0, 1.0], [0.0, 1.0])
        assert style.save_both(drawn, tmp_path / "a") == (tmp_path / "a.png", tmp_path / "a.svg")
        assert style.save_both(drawn, tmp_path / "b.svg") == (tmp_path / "b.svg", tmp_path / "b.svg")
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "a.svg", "b.svg"]
        labels = [label.get_text() for label in axis.get_xticklabels()]
        assert not any("$" in label for label in labels)
        assert labels[0].startswith("\N{MINUS SIGN}1.")
        with pytest.raises(InputError, match=r"c.jpg must end in .png, .svg or .pdf"):
            style.save(drawn, tmp_path / "c.jpg")
    values = {"a": 1}
    assert style.json_values(values) is values
