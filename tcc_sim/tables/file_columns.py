"""Columns of a table's file: names, units with their factors to SI, and numbers on demand."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from tcc_sim.trajectory import Floats

TIME = "t"
"""Name of the column of times."""
RPM, HERTZ = math.pi / 30.0, 2.0 * math.pi
"""Factors from revolutions per minute and from hertz to rad/s."""
_SPEEDS = {"rad/s": 1.0, "rads-1": 1.0, "rad/sec": 1.0, "1/min": RPM, "min-1": RPM, "/min": RPM, "u/min": RPM,
           "r/min": RPM, "rev/min": RPM, "rpm": RPM, "hz": HERTZ, "rps": HERTZ, "rev/s": HERTZ, "u/s": HERTZ,
           "deg/s": math.pi / 180.0, "\N{DEGREE SIGN}/s": math.pi / 180.0}
_FACTORS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "ns": 1e-9,
          "min": 60.0, "h": 3600.0},
    "rad/s": _SPEEDS,
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0, "\N{DEGREE SIGN}": math.pi / 180.0, "rev": HERTZ},
    "N m": {"Nm": 1.0, "kNm": 1e3, "mNm": 1e-3, "MNm": 1e6, "Ncm": 1e-2, **dict.fromkeys(
        ("lbfft", "ftlbf", "lbft", "ftlb"), 1.3558179483314)},
    "Pa": {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "MPa": 1e6, "mPa": 1e-3, "bar": 1e5, "mbar": 1e2,
           "psi": 6894.757293168, "N/m2": 1.0, "N/mm2": 1e6},
    "": {"": 1.0, "-": 1.0, "1": 1.0, "%": 1e-2},
}
"""Factors to an SI unit by the other unit's name, without separators between its factors."""
_SEPARATORS = re.compile(r"[\s.*_\N{MIDDLE DOT}\N{DOT OPERATOR}-](?!\d)|[\s.*\N{MIDDLE DOT}\N{DOT OPERATOR}^]|-(?=\D)")
_SIGNS = str.maketrans({"\N{MICRO SIGN}": "u", "\N{GREEK SMALL LETTER MU}": "u", "\N{SUPERSCRIPT MINUS}": "-",
                        "\N{SUPERSCRIPT ONE}": "1", "\N{SUPERSCRIPT TWO}": "2"})


@dataclass(frozen=True)
class FileColumns:
    """Columns of a file.

    names, units : of each column; a unit is empty where the file states none
    numbers : function from the numbers of columns, the number of the column with the times (or None) and the largest
        number of rows to the (n,) columns, NaN where a cell is empty, and to words on how they were read
    read_as : words on how the file was read
    hold : interpolation of columns between rows that the file states
    """

    names: Sequence[str]
    units: Sequence[str]
    numbers: Callable[[Sequence[int], int | None, int], tuple[list[Floats], list[str]]]
    read_as: Sequence[str] = ()
    hold: Mapping[str, str] = field(default_factory=dict)


def unit_factor(unit: str, si: str) -> float | None:
    """Return the factor from a unit to the SI unit of a column; None for a unit that is not known for it.

    Letters count in either case, except where that would be ambiguous (mNm, MPa).

    Examples
    --------
    >>> unit_factor("bar", "Pa"), unit_factor("N*m", "N m"), unit_factor("bar", "N m")
    (100000.0, 1.0, None)
    """
    word = unit.strip().translate(_SIGNS)
    known = _FACTORS[si]
    bare = word if word in ("-", "") else _SEPARATORS.sub("", word)
    if bare in known:
        return known[bare]
    factors = {factor for name, factor in known.items() if name.lower() == bare.lower()}
    return factors.pop() if len(factors) == 1 else None


def is_unit(text: str) -> bool:
    """Return whether a text is a unit of any kind that is known here."""
    return any(unit_factor(text, si) is not None for si in _FACTORS)


def units_for(si: str) -> str:
    """Return the names of the units of a column, for messages."""
    shown = {"s": "s, ms, us, ns, min, h", "rad/s": "rad/s, rpm, hz, deg/s", "rad": "rad, deg, rev",
             "N m": "N m, kN m, lbf ft", "Pa": "Pa, kPa, MPa, bar, mbar, psi", "": "1, %"}
    return shown[si]
