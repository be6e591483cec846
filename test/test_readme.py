"""README and its pages agree with the code. `python test/test_readme.py` rewrites their tables."""

from __future__ import annotations

import ast
import contextlib
import dataclasses
import io
import re
import shlex
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from tcc_sim.cli import GROUPS, VERBS, build_parser, main
from tcc_sim.model.parameters import DEFAULTS, QUANTITIES
from tcc_sim.model.quantity import Options, Quantity
from tcc_sim.nodes.parameters import OPTIONS
from tcc_sim.scene import bundled_scenes, load_scene
from tcc_sim.solvers import SOLVERS
from tcc_sim.topics import TOPICS

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "README.md"
PAGES = [README, *(path for room in ("guide", "paper") for path in sorted((ROOT / ".github" / room).glob("*.md"))
                  if path.stem not in ("claims", "errata", "motions"))]
"""Pages written by hand, without the reports that commands write."""
NODES = ROOT / "tcc_sim" / "nodes"


def table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    return "\n".join("| " + " | ".join(row) + " |" for row in [head, ("---",) * len(head), *rows])


def test_the_readme_leads_to_every_page_and_help_has_every_verb_in_a_group() -> None:
    linked = set(re.findall(r"\(\.github/(\w+/\w+)\.md\)", README.read_text()))
    assert {f"{path.parent.name}/{path.stem}" for path in (ROOT / ".github").glob("*/*.md")} == linked
    assert sorted(name for names in GROUPS.values() for name in names.split()) == sorted(VERBS)


def parameter_row(key: str, meaning: Quantity, default: object) -> tuple[str, ...]:
    if isinstance(default, str) and not meaning.choices:
        allowed, shown = "", default or "empty"
    elif isinstance(default, bool):
        allowed, shown = "true or false", str(default).lower()
    else:
        allowed, shown = meaning.interval(), f"{default:.9g}" if isinstance(default, float) else str(default or "empty")
    return f"`{key}`", meaning.description, allowed, "0" if default == 0 and allowed != "true or false" else shown, \
        "yes" if meaning.live else ""


def calls(file: str, name: str) -> Iterator[list[ast.expr]]:
    """The arguments of every call of `name` in a node's source: what it declares, read without ROS."""
    for node in ast.walk(ast.parse((NODES / file).read_text())):
        if isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) == name:
            yield node.args


def literal(node: ast.expr, otherwise: str) -> str:
    return str(node.value) if isinstance(node, ast.Constant) else otherwise


def options(kind: type[Options]) -> Iterator[tuple[str, ...]]:
    defaults = {item.name: item.default for item in dataclasses.fields(kind)}
    for key, meaning in kind.quantities().items():
        yield parameter_row(key, meaning, "all in the table above" if key == "topics" else defaults[key])


def tables() -> dict[str, str]:
    head = ("key", "meaning", "allowed", "default", "changeable while running")
    return {
        "scene keys": table(head, [parameter_row(k, q, DEFAULTS[k]) for k, q in QUANTITIES.items()]),
        "node options": table(head, options(OPTIONS["driveline"])),
        "recorder parameters": table(head[:-1], (row[:-1] for row in options(OPTIONS["recorder"]))),
        "slip controller parameters": table(head[:-1], (row[:-1] for row in options(OPTIONS["slip_controller"]))),
        "topics": table(("topic", "type", "direction", "carries", "there when"), [
            (f"`{t.name}`", f"`{t.type}`", t.direction, t.carries + (f", {t.unit}" if t.unit else ""),
             f"`{t.switch}`" if t.switch else "always") for t in TOPICS]),
        "services": table(("service", "type"), [
            (f"`{literal(name, '')}`",
             f"`{'rcl_interfaces' if 'Parameters' in kind.id else 'std_srvs'}/srv/{kind.id}`") for kind, name,
            *_ in calls("driveline.py", "create_service")
            if isinstance(kind, ast.Name)]),
        "scenes": table(("scene", "what it shows"), [(f"`{n}`", load_scene(n).description) for n in bundled_scenes()]),
        "solvers": table(("solver", "what it is", "friction law", "setting"), [
            (f"`{n}`", s.description, " or ".join(s.laws), s.setting) for n, s in SOLVERS.items()]),
        "verdicts": counts_of_verdicts(),
    }


def counts_of_verdicts() -> str:
    """The counts on the page that `tcc-sim claims` wrote."""
    page = (ROOT / ".github" / "paper" / "claims.md").read_text()
    return next(line for line in page.splitlines() if line.startswith("Of "))


def between(name: str) -> re.Pattern[str]:
    return re.compile(rf"(<!-- {name} -->\n)(.*?)(\n<!-- end -->)", re.DOTALL)


@pytest.mark.parametrize("name", tables())
def test_a_table_says_what_the_code_says(name: str) -> None:
    values = [match for page in PAGES if (match := between(name).search(page.read_text()))]
    assert len(values) == 1, f"{len(values)} pages have a table {name}"
    assert values[0].group(2) == tables()[name], "python test/test_readme.py writes the tables anew"


def test_every_verb_is_documented() -> None:
    text = "".join(page.read_text() for page in PAGES)
    assert [verb for verb in VERBS if f"tcc-sim {verb}" not in text] == []


@pytest.mark.parametrize("line", [line for page in PAGES for line in re.findall(
    r"^    (?:\S*/)?tcc-sim (.*)$", page.read_text(), re.MULTILINE)])
def test_every_command_is_one_that_the_program_takes(line: str) -> None:
    words = shlex.split(line.partition(" > ")[0], comments=True)
    assert words[0] in VERBS
    build_parser(words[0]).parse_args(words)


def test_choices_on_a_page_are_those_of_the_option() -> None:
    """Words with bars between them behind an option, such as `--hold previous|linear`."""
    choices: dict[str, set[frozenset[str]]] = {}
    for verb in VERBS:
        for option, words in re.findall(r"--([a-z-]+) \{([\w,]+)\}", help_of(verb)):
            choices.setdefault(option, set()).add(frozenset(words.split(",")))
    for page in PAGES:
        for option, words in re.findall(r"--([a-z-]+) (\w+(?:\|\w+)+)", page.read_text()):
            assert option not in choices or frozenset(words.split("|")) in choices[option], f"{page.name}: --{option}"


def help_of(verb: str) -> str:
    """What `tcc-sim VERB --help` prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main([verb, "--help"]) == 0
    return out.getvalue()


@pytest.mark.parametrize("page", [README, *sorted((ROOT / ".github").glob("*/*.md"))], ids=lambda page: page.stem)
def test_every_file_that_a_page_names_is_there(page: Path) -> None:
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", page.read_text()):
        absent = "pictures/" in target and not (ROOT / ".github" / "pictures").exists()  # A source distribution.
        assert absent or (page.parent / target).exists(), target


def test_the_run_times_of_the_readme_are_those_of_the_report() -> None:
    page = (ROOT / ".github" / "internals" / "precision.md").read_text()
    measured = [re.search(rf"^\| {name} \| (.+?) \|", page, re.MULTILINE) for name in ("numbalsoda", "XPPAUT cvode")]
    said = re.search(r"solved ([\d.]+ to [\d.]+) times as fast.*?XPPAUT takes\s+([\d.]+ to [\d.]+) times as long",
                     README.read_text(), re.DOTALL)
    assert said
    assert [row.group(1) for row in measured if row] == list(said.groups())


def test_the_numbers_of_the_findings_are_those_of_the_reports() -> None:
    folder = ROOT / ".github" / "paper"
    reports = "".join((folder / f"{name}.md").read_text() for name in ("claims", "errata", "motions"))
    text = (folder / "findings.md").read_text().partition("## What depends")[0]
    numbers = re.findall(r"(?<![\w.])\d+\.\d+", text)
    assert len(numbers) >= 8
    assert [number for number in numbers if not re.search(rf"(?<![\d.]){re.escape(number)}", reports)] == []


if __name__ == "__main__":
    for page in PAGES:
        text = page.read_text()
        for title, rows in tables().items():
            text = between(title).sub(lambda match, rows=rows: match.group(1) + rows + match.group(3), text)
        page.write_text(text)
