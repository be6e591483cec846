"""FileColumns of a table's file: names and units of its columns, and their numbers on demand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from tcc_sim.trajectory import Floats

TIME = "t"
"""Name of the column of times."""

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
