"""Ranges of parameters as pages of the guide state them, and what a parameter answers at and beyond their ends."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from tcc_sim.errors import InputError
from tcc_sim.model.quantity import Options

GUIDE = Path(__file__).resolve().parent.parent / ".github" / "guide"
NUMBER = r"(-?\d[\d.]*(?:e[+-]\d+)?)"
RANGE = re.compile(rf"(?:{NUMBER} or )?(above )?{NUMBER}(?: to {NUMBER}| or more)?(?: (?!to |or ).+)?")


class Stated(NamedTuple):
    """Range and default of a key, as texts of a page."""

    allowed: str
    default: str


def of_page(page: str) -> dict[str, Stated]:
    """The keys in every table of a page that has a column of allowed values."""
    text = (GUIDE / f"{page}.md").read_text()
    tables = re.findall(r"^\| key \| meaning \| allowed .*\n\|.*\n((?:\|.*\n)+)", text, re.MULTILINE)
    rows = [[cell.strip() for cell in line.split("|")[1:]] for table in tables for line in table.splitlines()]
    return {key.strip("`"): Stated(allowed, default) for key, _, allowed, default, *_ in rows}


def trials(allowed: str, kind: type) -> Iterator[tuple[Any, bool]]:
    """Values at, beside and beyond the ends of a stated range, and whether they are allowed; none for any text."""
    if kind is bool:
        assert allowed == "true or false"
        yield from ((True, True), (False, True), (1, False), ("yes", False))
    elif (found := RANGE.fullmatch(allowed)) is not None:
        single, above, low, high = found[1] and float(found[1]), found[2], float(found[3]), float(found[4] or math.inf)
        for end, into in ((low, 1), (high, -1)):
            if end < math.inf:
                step = max(1, round(math.ulp(end))) if kind is int else math.ulp(end)
                values = [kind(end) + step * side if kind is int else math.nextafter(end, side * math.inf)
                          for side in (into, -into)]
                yield kind(end), not (above and into == 1)
                yield values[0], True
                yield values[1], values[1] == single
        yield from ((value, False) for value in (math.nan, math.inf, -math.inf) if kind is float)
        if single is not None:
            yield kind(single), True
    elif allowed:
        yield from ((choice, True) for choice in allowed.split(" or "))
        yield from ((value, False) for value in ("", "neither", allowed))


def check(key: str, allowed: str, kind: type, make: Callable[[Any], object]) -> None:
    """Give a parameter all trials of its stated range: `make` takes those that are allowed, unless another parameter is
    against it, and refuses the others by a sentence with key, value and range.
    """
    every = list(trials(allowed, kind))
    for value, right in every:
        try:
            make(value)
        except InputError as error:
            sentence = str(error)
        else:
            assert right, f"{key} takes {value!r}; {allowed}"
            continue
        if right:
            assert not (sentence.startswith(f"{key} ") and sentence.endswith(f" {allowed}")), sentence
            continue
        found = re.match(rf"{re.escape(key)} is ([^ ;]+).*[^-\w]{re.escape(allowed)}(;|$)", sentence)
        assert found is not None, sentence
        said = found[1]
        if kind in (float, int) and math.isfinite(value):   # The printed value is beyond the end, too.
            assert (float(said), True) not in every, sentence
        else:
            assert repr(value).startswith(said), sentence



def check_options(stated: Mapping[str, Stated], options: type[Options]) -> None:
    """Check options by their stated ranges and defaults."""
    types = {item.name: str(item.type) for item in dataclasses.fields(options)}
    for key, (allowed, default) in stated.items():
        kind = next(kind for kind in (bool, int, float, str) if kind.__name__ in types[key])

        def make(value: Any, key: str = key) -> Options:
            return options(**{key: (value,) if types[key].startswith("tuple") else value})

        check(key, allowed, kind, make)
        if key != "topics":
            assert shown(getattr(options(), key)) == default, key


def shown(default: Any) -> str:
    """A default as the pages print it."""
    if isinstance(default, bool):
        return str(default).lower()
    return "0" if default == 0 and not isinstance(default, (str, tuple)) else (
        f"{default:.9g}" if isinstance(default, float) else str(default or "empty"))
