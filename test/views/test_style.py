"""Sizes, settings, legends, titles and files of every picture: the rules of the style, by small figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pictures import check

from tcc_sim.cli import main
from tcc_sim.errors import InputError

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
import matplotlib

from tcc_sim.views import style
from tcc_sim.views.panels import Panel, compose

PROMISED = {"font.size": 8.0, "savefig.dpi": 200, "pdf.fonttype": 42, "ps.fonttype": 42}
"""Settings that the page on pictures promises, or that journals ask for."""


def test_settings_hold_within_a_picture_and_end_with_it() -> None:
    assert (style.width_of("column"), style.width_of("page")) == (3.5, 7.2)
    with pytest.raises(InputError):
        style.width_of("poster")
    before = dict(matplotlib.rcParams)
    with style.figure(3.5, 2.0, "t") as drawn:
        assert {name: matplotlib.rcParams[name] for name in PROMISED} == PROMISED
        assert (tuple(drawn.get_size_inches()), drawn.dpi) == ((3.5, 2.0), 200)
    assert dict(matplotlib.rcParams) == before
    assert len({style.colour_of(period) for period in range(17)}) == 17


@pytest.mark.parametrize(("text", "settings", "refused"), [
    ("# a\n\naxes.labelsize: 16 # large\nlines.linewidth : 2\n", {"axes.labelsize": 16.0, "lines.linewidth": 2.0}, ""),
    ("axes.edgecolor: '#ff0000'\n", {"axes.edgecolor": "#ff0000"}, ""), ("axes.labelsize: 4\n", {}, ""),
    ("lines.linewidth\n", {}, "line 1: lines.linewidth"), ("\nno.setting: 3\n", {}, "line 2: no.setting"),
    ("backend_fallback: True\n", {}, "line 1: backend_fallback"),
    ("lines.linewidth: wide\n", {}, "line 1: lines.linewidth"), (None, {}, "a.mplstyle")])
@pytest.mark.usefixtures("pictures")
def test_a_style_file_is_read_line_by_line(text: str | None, settings: dict[str, Any], refused: str, tmp_path: Path,
                                           monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Labels that are larger make a picture higher; smaller ones make none lower."""
    monkeypatch.chdir(tmp_path)
    Path("a.mplstyle").write_bytes(b"\xff\xfe" if text is None else text.encode())
    status = main(["explain", "slip", "--plot", "a.png", "--style", "a.mplstyle"])
    assert status == (2 if refused else 0)
    assert refused in capsys.readouterr().err
    assert Path("a.png").exists() == (not refused)
    if not refused:
        style.use_file(Path("a.mplstyle"))
        with style.figure(3.5, 2.0) as drawn:
            assert {name: matplotlib.rcParams[name] for name in settings} == settings
            assert (drawn.get_figheight() > 2.0) == (settings.get("axes.labelsize") == 16.0)
        style.use_file(None)


FEW, LONG, MANY, ONE = ["a", "b"], ["a long name of a line"] * 4, [f"{'n' * 20}{k}" for k in range(9)], ["n" * 38]
WORDS = "a title of a panel with a number of words in it"


@pytest.mark.parametrize(("names", "title", "below", "width"), [
    (FEW, "t", True, style.PAGE), (LONG, WORDS, False, style.PAGE), (LONG, "t", True, style.COLUMN),
    (MANY, WORDS, False, style.COLUMN), (ONE, WORDS, True, style.COLUMN)])
def test_legends_and_titles_have_room(names: list[str], title: str, below: bool, width: float, tmp_path: Path,
                                      laid_out: list[Any]) -> None:
    """Whatever their length, within the picture and beside each other."""
    def draw(axis: Any) -> None:
        for k, name in enumerate(names):
            axis.plot([0.0, 1.0], [k, k], label=f"{name} {k}")

    panel = Panel(title, draw, 4.0, style.TIME, style.AxisQuantity("a quantity with a name of many words", "rad/s"))
    compose(tmp_path / "a.png", [panel, panel], f"picture {title} {title}", width, below=below)
    drawn, = laid_out
    check(drawn)
    shown = drawn.legends if below else [axis.get_legend() for axis in drawn.axes]
    for legend in shown:
        assert [text.get_text() for text in legend.get_texts()] == [f"{name} {k}" for k, name in enumerate(names)]


def test_a_legend_names_only_what_is_drawn() -> None:
    with style.figure() as drawn:
        axis = drawn.subplots()
        axis.plot([1.0, 2.0], [float("nan"), 1.0], label="line")
        axis.plot([1.0], [float("nan")], label="no line")
        axis.fill_between([1.0, 2.0], [float("nan")] * 2, [1.0] * 2, label="no band")
        axis.axhline(float("nan"), label="no level")
        axis.axvspan(1.0, 2.0, label="span")
        style.key(axis, "mark", linestyle="none", marker="s")
        assert style.entries(axis)[1] == ["line", "span", "mark"]
        style.legend_above(drawn.add_subplot())


def test_every_format_has_the_same_bytes_every_time(tmp_path: Path) -> None:
    """Fonts of a PDF are TrueType; the digits that a layout leaves by chance are in no file."""
    starts = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    for name in "ab":
        with style.figure(style.COLUMN, 2.0) as drawn:
            drawn.add_subplot().plot([0.0, 2.0], [0.0, 1e7], clip_on=True, label=r"$\mu_k N R$")
            style.legend_above(drawn.axes[0])
            for suffix in starts:
                style.save(drawn, tmp_path / f"{name}.{suffix}")
            with pytest.raises(InputError):
                style.save(drawn, tmp_path / "c.jpg")
    for suffix, start in starts.items():
        one, two = ((tmp_path / f"{name}.{suffix}").read_bytes() for name in "ab")
        assert one.startswith(start)
        assert one == two
    assert b"/Type3" not in one
    assert b"/CIDFontType2" in one
    with style.figure(style.COLUMN, 2.0) as drawn:
        drawn.add_subplot().plot([-1.0, 1.0], [0.0, 1.0])
        assert style.save(drawn, tmp_path / "d") == tmp_path / "d.png"
    assert (tmp_path / "d.svg").is_file()
