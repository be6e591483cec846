"""Options of a verb, derived from functions (names, types and defaults from signatures, help from docstrings), and
values and ranges of scene keys in words of a command line.

A verb is a function `run(arguments, ...)` with the options of its own as further parameters; `command` adds those of
library functions. All are read as text, so that no parser imports more than it needs.
"""

from __future__ import annotations

import argparse
import ast
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from tcc_sim.errors import InputError

KINDS = {"int": (int, "N"), "float": (float, "X"), "Path": (Path, "FILE"), "str": (str, "NAME")}
"""Types of values, by the words of an annotation, and the word that stands for a value."""
OTHERWISE = {"from_": "from", "inputs_scene": "scene", "every": "every_sample"}
"""Names of options that differ from those of keywords."""
PYTHON = "arguments set plan progress settings gates start head part samples_per_cycle flywheel_angle ready"
"""Keywords that a command has no option for, or adds itself."""
EXCLUSIVE = (("cycles", "duration"), ("jobs", "dask"), ("rrd", "spawn", "connect", "web"))
"""Options of which a command takes one."""
ROW = re.compile(r"^([a-z_]\w*(?:, [a-z_]\w*)*) : (.+(?:\n +.+)*)", re.MULTILINE)

Source = Callable[[Any], object]
"""Function that adds options to a parser or to a group of one."""
Verb = Callable[..., int | None]
"""Function of a verb: its exit status, or None for 0."""


class Form(NamedTuple):
    """How a command line writes a value that is no single number, word or file.

    metavar : the word that stands for the value
    read : reader of the word, as `type` of argparse
    repeated : whether the option is given once for each of several values
    optional : the value of an option without a word; None if it needs one
    several : whether the option takes one word or more
    required : whether a parameter without a default is an option, instead of an argument by its place
    """

    metavar: str
    read: Callable[[str], Any] = str
    repeated: bool = False
    optional: Any = None
    several: bool = False
    required: bool = False


def reader(read: Callable[[str], Any], what: str) -> Callable[[str], Any]:
    """Return an argparse type that reads a word by `read`; its error says what a word must be that `read` refuses."""
    def checked(text: str) -> Any:
        try:
            return read(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} must be {what}") from None

    return checked


def number(low: float, high: float, unit: str = "", kind: type[float] | type[int] = float) -> Callable[[str], Any]:
    """Return an argparse type for numbers from `low` to `high`; its error names the value, the unit and the range."""
    def inside(text: str) -> float:
        value = kind(text)
        if not low <= value <= high:
            raise ValueError
        return value

    span = f" from {low:g} to {high:g} {unit}".rstrip() if math.isfinite(high) else ""
    return reader(inside, f"a {'whole ' if kind is int else ''}number{span}")


def numbers_apart(text: str, by: str, count: int | None = None) -> tuple[float, ...]:
    """Return the numbers of a text, separated by `by`; ValueError for another `count` of them, where one is given."""
    values = tuple(float(word) for word in text.split(by) if text)
    if count not in (None, len(values)):
        raise ValueError
    return values


class Declared(NamedTuple):
    """A parameter of a function or a field of a dataclass: its annotation and default as text, and its meaning."""

    annotation: str
    default: str | None
    meaning: str


@cache
def syntax_of(function: str) -> Any:
    """Return the syntax tree of "module:function", "module:class.method" or "module:class"."""
    module, _, name = function.partition(":")
    spec = find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    found: Any = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
    for part in name.split("."):
        found = next(node for node in found.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))
                     and node.name == part)
    return found


def rows_of(docstring: str) -> dict[str, str]:
    """Return the meanings in a docstring by name."""
    return {word: " ".join(meaning.split()) for names, meaning in ROW.findall(docstring) for word in names.split(", ")}


@cache
def parameters_of(function: str) -> dict[str, Declared]:
    """Return the parameters of a function, or the fields of a class, named as for `syntax_of`."""
    found = syntax_of(function)
    text = rows_of(ast.get_docstring(found) or "")
    if isinstance(found, ast.ClassDef):
        rows = [(ast.unparse(node.target), node.annotation, node.value) for node in found.body
                if isinstance(node, ast.AnnAssign)]
    else:
        plain, given = [*found.args.posonlyargs, *found.args.args], found.args
        defaults = [*[None] * (len(plain) - len(given.defaults)), *given.defaults, *given.kw_defaults]
        rows = [(one.arg, one.annotation, default) for one, default in zip([*plain, *given.kwonlyargs], defaults)]
    return {name: Declared("" if kind is None else ast.unparse(kind), None if default is None else ast.unparse(default),
                           text.get(name, "")) for name, kind, default in rows}


def option_of(name: str) -> str:
    """Return the option of a keyword."""
    return f"--{OTHERWISE.get(name, name).replace('_', '-')}"


def options_in(function: str, without: str = "") -> list[str]:
    """Return the keywords of a function, or the fields of a class, that are options: all but PYTHON and `without`."""
    left_out = {*PYTHON.split(), *without.split()}
    return [name for name, declared in parameters_of(function).items()
            if name not in left_out and declared.default is not None]


def of(function: str, forms: Mapping[str, Form] | None = None, names: str | Iterable[str] = "",
       needed: str | Iterable[str] = "", without: str = "", **changed: Any) -> Source:
    """Return the source of options for these keywords of a function; all but `without` if `names` is empty.

    needed : names of parameters without a default, which are added before in this order
    forms : the values that a command line writes otherwise, by keyword
    changed : defaults that the command has in place of those of the function
    """
    def add(parser: Any) -> None:
        known, groups, shown = parameters_of(function), dict[tuple[str, ...], Any](), forms or {}
        for name in needed.split() if isinstance(needed, str) else needed:
            if shown[name].required:
                _add(parser, name, known[name], shown[name])
            else:
                parser.add_argument(name, metavar=shown[name].metavar, type=shown[name].read,
                                    help=known[name].meaning.replace("%", "%%"))
        chosen = names or options_in(function, without)
        for name in chosen.split() if isinstance(chosen, str) else chosen:
            together = next((each for each in EXCLUSIVE if name in each), None)
            if together is not None and together not in groups:
                groups[together] = parser.add_mutually_exclusive_group()
            declared = known[name]._replace(default=repr(changed[name])) if name in changed else known[name]
            _add(parser if together is None else groups[together], name, declared, shown.get(name))

    return add


def _add(where: Any, name: str, found: Declared, form: Form | None) -> None:
    option, choices = option_of(name), re.findall(r"'([^']+)'", found.annotation) if form is None else []
    if found.annotation == "bool":
        where.add_argument(option, dest=name, action="store_true", help=found.meaning)
        return
    kind, word = next((KINDS[part] for part in re.findall(r"\w+", found.annotation) if part in KINDS), (str, "NAME"))
    form = form or (Form("") if choices else Form(word, kind))
    try:
        default = ast.literal_eval(found.default or "None")
    except ValueError:
        default = argparse.SUPPRESS  # A constant of the function, which is then called without it.
    shown = f"{default:g}" if isinstance(default, float) else default
    stated = f" (default {shown})" if default not in (None, "", (), [], argparse.SUPPRESS, 0) else ""
    where.add_argument(
        option, dest=name, help=f"{found.meaning}{stated}{'; may be repeated' * form.repeated}".replace("%", "%%"),
        type=form.read, metavar=form.metavar or None, choices=choices or None, required=form.required,
        nargs="+" if form.several else None if form.optional is None else "?", const=form.optional,
        **({"action": "append", "default": []} if form.repeated else {"default": default}))


def keywords_of(arguments: argparse.Namespace, names: str | Iterable[str]) -> dict[str, Any]:
    """Return some arguments of a command, as far as it has them, as keywords of its function."""
    given = vars(arguments)
    return {name: given[name] for name in (names.split() if isinstance(names, str) else names) if name in given}


@dataclass(frozen=True)
class VerbFunction:
    """A verb: its function, further options, and forms of the words for its own parameters."""

    function: Verb
    sources: tuple[Source, ...] = ()
    forms: Mapping[str, Form] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Return the function as "module:name"."""
        return f"{self.function.__module__}:{self.function.__name__}"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the options of the sources, and those of the function's own parameters."""
        for source in self.sources:
            source(parser)
        of(self.name, self.forms, needed=[name for name, declared in parameters_of(self.name).items()
                                          if declared.default is None and name != "arguments"])(parser)

    def __call__(self, arguments: argparse.Namespace) -> int:
        """Run the verb and return the exit status."""
        return self.function(arguments, **keywords_of(arguments, parameters_of(self.name))) or 0


def command(*sources: Source, forms: Mapping[str, Form] | None = None) -> Callable[[Verb], VerbFunction]:
    """Return the decorator that makes a verb of a function.

    sources : functions that add options beside those of the function's own parameters, in this order
    forms : the values that a command line writes otherwise, by name
    """
    return lambda function: VerbFunction(function, sources, forms or {})


def values_of_range(text: str, option: str = "--over", even: bool = False) -> tuple[str, list[float]]:
    """Return the key and the values of KEY=START:STOP:COUNT[:log] or KEY=VALUE,VALUE,...

    A range includes both ends; `:log` spaces its values evenly in logarithm. `even` allows KEY=START:STOP:COUNT only.
    """
    key, equals, numbers = text.partition("=")
    wrong = InputError(f"{option} is {text!r}; it must be KEY=START:STOP:COUNT"
                       + ("" if even else ", KEY=START:STOP:COUNT:log or KEY=VALUE,VALUE,..."))
    if not equals:
        raise wrong
    if not even and "," in numbers and ":" not in numbers:
        return key, _numbers(numbers.split(","), wrong, key)
    plain = numbers if even else numbers.removesuffix(":log")
    return key, spaced(plain, option, plain != numbers, wrong, key)


def spaced(text: str, option: str, logarithmic: bool = True, wrong: InputError | None = None,
           key: str = "") -> list[float]:
    """Return the values of START:STOP:COUNT, both ends included, spaced evenly or evenly in logarithm.

    For a text of another form, the error is `wrong`, if given.
    """
    wrong = wrong or InputError(f"{option} is {text!r}; it must be START:STOP:COUNT, two numbers and a whole number")
    parts = text.split(":")
    if len(parts) != 3:
        raise wrong
    start, stop = _numbers(parts[:2], wrong, key)
    try:
        count = int(parts[2])
    except ValueError:
        raise wrong from None
    from tcc_sim.model.quantity import MOST_VALUES

    if not 1 <= count <= MOST_VALUES:
        raise InputError(f"{option} has a count of {count}; it must be 1 to {MOST_VALUES}")
    if logarithmic and not start * stop > 0.0:
        raise InputError(f"{option} goes from {start:g} to {stop:g}; values spaced evenly in logarithm must all "
                         "be above 0, or all below 0")
    import numpy as np

    return [float(x) for x in (np.geomspace if logarithmic else np.linspace)(start, stop, count)]


def bounds_of_range(text: str, option: str, names: str = "START:STOP") -> tuple[str, float, float]:
    """Return the key and the two numbers of KEY=LOW:HIGH, the smaller one first."""
    key, equals, numbers = text.partition("=")
    wrong = InputError(f"{option} is {text!r}; it must be KEY={names}")
    parts = numbers.split(":")
    if not equals or len(parts) != 2:
        raise wrong
    low, high = sorted(_numbers(parts, wrong, key))
    if low == high:
        raise InputError(f"{option} is {text!r}; the two values must differ")
    return key, low, high


def _numbers(words: Sequence[str], wrong: InputError, key: str) -> list[float]:
    """Return the words as finite numbers, those of speeds with a unit too; raise `wrong` if one of them is none.

    key : scene key that they are for; empty for frequencies, rad/s
    """
    from tcc_sim.model.parameters import DERIVED, QUANTITIES, refuse_rpm
    from tcc_sim.model.quantity import SPEED_UNIT, number_in

    refuse_rpm(key, list(words))
    meant = {**QUANTITIES, **DERIVED}.get(key)
    unit = meant.unit if meant is not None else "" if key else SPEED_UNIT
    try:
        numbers = [number_in(word, unit) for word in words]
    except TypeError:
        raise wrong from None
    if not all(map(math.isfinite, numbers)):
        raise wrong
    return numbers
