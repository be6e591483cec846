"""Every construct that kernels are printed with gives Python's numbers in C, and any other is refused."""
# ruff: noqa: F634, F841, RET504, RUF046, RUF059, UP018

from __future__ import annotations

import ast
import ctypes
import inspect
import math
import re
import subprocess
import textwrap
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from tcc_sim.fmi import c_types
from tcc_sim.fmi.c_types import (
    DOUBLE,
    INT,
    Items,
    Refused,
    Row,
    Static,
    Struct,
    Table,
    Tuple,
    Vector,
    common_kind,
    size_of,
)
from tcc_sim.fmi.description import Variable, base_units, unit_name
from tcc_sim.fmi.export import compiler
from tcc_sim.fmi.expressions import enclosed, literal, target_of, word
from tcc_sim.fmi.printer import Library

INFINITY = math.inf
POINTS = [(0.0, 1.0), (1.0, 0.0), (-2.5, 3.25), (7.0, 7.0), (0.1, -0.3), (1e100, 1e-300), (-0.0, 2.0)]
NUMBERS = (3.0, -1.0, 3.0, 0.5, 8.0)
TABLE = np.array([[0.0, 10.0, 1.0], [1.0, 20.0, 2.0], [1.0, 30.0, 3.0], [4.0, 40.0, 4.0]])


class Pair(NamedTuple):
    """A structure of a kernel."""

    first: float
    second: float
    count: int = 3
    limits: tuple[float, float] = (-1.0, 1.0)


class Plain(NamedTuple):
    """A structure of numbers."""

    first: float
    second: float


class Kinds(NamedTuple):
    """A field of every type."""

    some: float | None
    many: tuple[float, ...]
    pair: tuple[float, float] | None
    inner: Plain
    array: NDArray[np.float64] | None


class Words(NamedTuple):
    """A field without a type in C."""

    word: str


def arithmetic(x: float, y: float) -> float:
    return (x + y) * (x - y) - -x + 2.0 * y / (3.0 + x**2) - 1e-3


def comparisons(x: float, y: float) -> float:
    return ((1.0 if x < y else 0.0) + (2.0 if x <= y else 0.0) + (4.0 if x > y else 0.0) + (8.0 if x >= y else 0.0)
            + (16.0 if x == y else 0.0) + (32.0 if x != y else 0.0) + (64.0 if -1.0 < x <= y else 0.0))


def logic(x: float, y: float) -> float:
    if (x > 0.0 and y > 0.0) or not (x < 1.0 or y < 1.0):
        return 1.0
    elif x > y and True:
        return 2.0
    return 3.0 if False or y > 2.0 else 4.0


def known(x: float, y: float) -> float:
    flag, name, nothing = True, "a", None
    total = 0.0
    if flag and nothing is None and name == "a":
        total += 1.0
    if name != "a" or not flag or nothing is not None:
        total += 2.0
    if name in ("b", "a") and name not in ("b", "c") and 2 < 3 and not 3 <= 2 and 2 * 3 - 1 == 5:
        total += 4.0
    if ():
        total += 8.0
    if (x,):
        total += 16.0
    return total + (32.0 if flag else y)


def loops(x: float, y: float) -> float:
    total = x
    for k in range(4):
        total = total * 0.5 + k
    for weight, (one, two) in zip((1.0, 2.0), ((x, y), (y, 3.0))):
        total -= weight * one + two
    for k, each in enumerate((x, y), 2):
        total += k * each
    n = 0
    while n < 5 and total > 0.5:
        total = total - 1.0
        n += 1
    for k in range(n):
        if k == 3:
            break
        total += 10.0
    return total + n


def assigned(x: float, y: float) -> float:
    low: float = min(x, y)
    low, high = y, low
    low, high = high - 1.0, low + 1.0
    _, third = pair_of(low, high)
    if (difference := high - low) > 2.0:
        third += difference
    while low > high:
        low = low - 1.0
    values: list[float] = []
    values.append(x)
    values.append(y)
    values.append(low)
    whole = int(2)
    third += chosen(x, True) - chosen(y, False)
    return third + values[2] + len(values) + whole + float(low) * sum_of(*values, 1.0)


def pair_of(a: float, b: float = 2.0) -> tuple[float, float]:
    return a, a * b


def chosen(x: float, double: bool) -> float:
    return (2.0 * x if double else x) + max(double, 0)


def sum_of(a: float, *more: float) -> float:
    total = a
    for each in more:
        total = total + 2.0 * each
    return total


def extremes(x: float, y: float) -> float:
    a, b = np.maximum(x, y), np.minimum(x, y)
    return a - 2.0 * b + max(x, y, 0.5) * min(x, y) + max(2, 3) + min(int(4), 5) + (1.0 if math.isfinite(x) else 0.0)


def functions(x: float, y: float) -> float:
    z = math.sqrt(abs(x)) + np.sqrt(np.abs(y)) + np.tanh(x) + np.sin(y) + np.cos(y) + math.sin(y) + math.cos(x)
    z += np.exp(-np.abs(x)) + math.exp(-abs(y)) + np.sign(x) + math.copysign(1.0, y)
    return z + math.floor(0.3 * y) + math.ceil(0.3 * y) if abs(x) < 1e9 else z


def structures(x: float, y: float) -> float:
    one = Pair(x, y)
    two = one._replace(second=2.0, count=5)
    low, high = two.limits
    same = (1.0 if Plain(x, y) == Plain(x, 2.0) else 0.0) + (2.0 if equal(Plain(x, y), 7.0) else 0.0)
    return one.second + 10.0 * two.second + two.count + 100.0 * low + 1000.0 * high + same + two.limits[1] + taken(two)


def equal(one: Plain, y: float) -> bool:
    return one == Plain(one.first, y)


def taken(pair: Pair) -> float:
    return pair.first * 3.0 if pair.count > 4 else INFINITY


def optional(x: float, y: float) -> float:
    some = (x, y) if x > y else None
    return of_optional(some) + of_optional(None) + of_optional((y, x))


def of_optional(part: tuple[float, float] | None) -> float:
    if part is None:
        return 100.0
    return part[0] - part[1]


DOUBLES: list[Callable[..., Any]] = [arithmetic, comparisons, logic, known, loops, assigned, extremes, functions,
                                     structures, optional]


def row_extremes(row: Any, x: float) -> float:
    over = 1.0 if any(row > 7.0) else 0.0
    return row.max() - 2.0 * row.min() + row[1] * x + len(row) + row.shape[0] + over


def row_sums(row: Any, x: float) -> float:
    total = np.cumsum(row * 2.0 + x)
    steps = np.diff(row)
    parts = steps[1:][1] + steps[:-1].max() + steps[2:].min()
    return total[4] + total[1] + steps[0] - 3.0 * steps[3] + parts + len(steps)


def row_places(row: Any, x: float) -> float:
    after = row[1::2]
    where = np.argmax(row > x)
    return where + 10.0 * after[0] + 100.0 * after[1] + 7.0 * len(after) + row[where]


def row_sets(row: Any, x: float) -> float:
    whole = np.unique(np.concatenate([row, [x, 3.0], np.arange(3)]))
    place = np.searchsorted(whole, x, side="right")
    return len(whole) + 10.0 * place + 100.0 * whole[place - 1] + whole.max()


ROWS: list[Callable[..., Any]] = [row_extremes, row_sums, row_places, row_sets]


def table_places(table: Any, x: float) -> float:
    k = np.searchsorted(table[:, 0], x, side="right")
    n = max(k, 1) - 1
    copy = table.copy()
    copy[:, 1] = table[:, 2] * 2.0
    copy[1:, 2] = 5.0
    copy[0, 0] = 9.0
    part = table[n]
    more = table[np.array([[0.0, 1.0]])[:, 0].max() > 0.5, 1] if False else 0.0
    return (k + 10.0 * table[n, 1] + part[2] + table.shape[0] + 10 * table.shape[1] + copy[:, 1].max() + copy[2, 1]
            + copy[:, 2].min() + copy[0, 0] + len(copy) + more)


def made(table: Any, x: float) -> Any:
    out = np.zeros((4, 2))
    out[:, 0] = table[:, 0] + x
    out[:, 1] = 1.0
    return out[:3]


def of_made(table: Any, x: float) -> float:
    part = made(table, x)
    fixed = np.array([[x, 2.0], [3.0, 4.0]])
    return part[2, 0] + part.shape[0] + part[:, 1].max() + fixed[0, 0] + fixed[1, 1]


def either(table: Any, x: float) -> Any:
    small = np.zeros((2, 3))
    small[:, 1] = x
    if x > 1.0:
        return small
    return table


def of_either(table: Any, x: float) -> float:
    part = either(table, x)
    return part[1, 1] + 10.0 * part[0, 2] + 100.0 * part.shape[0] + part[:, 1].max()


def larger(table: Any, x: float) -> Any:
    large = np.zeros((6, 3))
    large[:, 1] = x
    if x > 1.0:
        return large
    return table


def of_larger(table: Any, x: float) -> float:
    part = larger(table, x)
    return part[1, 1] + 10.0 * part[0, 2] + 100.0 * part.shape[0] + part[:, 1].max()


TABLES: list[Callable[..., Any]] = [table_places, of_made, of_either, of_larger]


class Stored(ctypes.Structure):
    """The structure of a table in C."""

    _fields_ = [("has", ctypes.c_int), ("rows", ctypes.c_int), ("at", ctypes.c_double * 12)]


@pytest.mark.skipif(compiler() is None, reason="there is no C compiler")
def test_printed_functions_give_the_bits_of_python(tmp_path: Path) -> None:
    library, table = Library(), Table(3, 4)
    for sources, kinds in ((DOUBLES, (DOUBLE, DOUBLE)), (ROWS, (Row(length=5), DOUBLE)), (TABLES, (table, DOUBLE))):
        for source in sources:
            library.entry(f"c_{source.__name__}", source, *kinds)
    opened = [f"double open_{source.__name__}({first}, double b) {{ return c_{source.__name__}(a, b); }}"
              for sources, first in ((DOUBLES, "double a"), (ROWS, "const double *a"),
                                     (TABLES, f"const {table.title} *a")) for source in sources]
    head = "#include <math.h>\n#include <string.h>\n#define TCC_LARGE\n"
    (tmp_path / "all.c").write_text(head + library.text() + "\n".join(opened) + "\n")
    words = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O0", "-fPIC", "-shared", "all.c", "-o", "all.so", "-lm"]
    ended = subprocess.run([str(compiler()), *words], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    built = ctypes.CDLL(str(tmp_path / "all.so"))

    def c(source: Callable[..., Any], first: Any, x: float) -> float:
        function = getattr(built, f"open_{source.__name__}")
        function.restype, function.argtypes = ctypes.c_double, [type(first), ctypes.c_double]
        return float(function(first, x))

    # C has the functions of libm, as `math`; those of NumPy may differ in the last bit.
    libm = SimpleNamespace(**vars(np) | {name: getattr(math, name) for name in ("exp", "tanh", "sin", "cos")})
    known = FunctionType(functions.__code__, globals() | {"np": libm})
    differ = [(source.__name__, x, y) for source in DOUBLES for x, y in POINTS
              if np.float64(c(source, ctypes.c_double(x), y)).tobytes()
              != np.float64((known if source is functions else source)(x, y)).tobytes()]
    numbers = (ctypes.c_double * 5)(*NUMBERS)
    stored = Stored(1, 4, (ctypes.c_double * 12)(*TABLE.ravel()))
    for sources, given, array in ((ROWS, numbers, np.array(NUMBERS)), (TABLES, stored, TABLE)):
        for source in sources:
            for x in (-2.0, 0.0, 0.5, 1.0, 3.0, 7.5):
                found = c(source, ctypes.cast(ctypes.pointer(given), ctypes.c_void_p), x)
                if found != float(source(array, x)):
                    differ.append((source.__name__, x, found))
    assert differ == []


def refused_sources() -> list[tuple[Callable[..., Any], tuple[Any, ...]]]:
    """Functions with a construct that has no form in C, and the types of their arguments."""
    number, two, row, table = (DOUBLE,), (DOUBLE, DOUBLE), (Row(length=5), DOUBLE), (Table(3, 4), DOUBLE)

    def power(x: float) -> float:
        return x**3

    def long(x: float) -> float:
        return sum([x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x,
                    x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x])

    def divided(n: int) -> float:
        return n / n

    def remainder(x: float) -> float:
        return x % 2.0

    def inverted(n: int) -> int:
        return ~n

    def called_by_name(x: float) -> float:
        return math.sqrt(x=x)  # type: ignore[call-arg]

    def not_a_number(x: float) -> float:
        return x + math.nan

    def several_types(x: float) -> Any:
        return (x, x) if x > 0.0 else x

    def changed_type(n: int) -> Any:
        m = n
        m = 2.0  # type: ignore[assignment]
        return m

    def tested_tuple(x: float, y: float) -> float:
        pair = pair_of(x, y)
        return 1.0 if pair else 0.0

    def filtered(x: float) -> float:
        return max(*[k for k in (x, 1.0) if True])

    def nested_loops(x: float) -> float:
        return sum_of(*[k + j for k in (x, 1.0) for j in (x, 2.0)])

    def two_bounds(n: int) -> int:
        for k in range(1, n):
            if k == 2:
                break
        return n

    def in_branch(x: float) -> float:
        if x > 0.0:
            values = [x, "a"]
        return 1.0

    def otherwise(n: int) -> int:
        while n > 0:
            n = n - 1
        else:
            n = 3
        return n

    def unpacked(x: float, y: float) -> float:
        a, b, c = pair_of(x, y)  # type: ignore[misc]
        return a

    def unequal(x: float) -> float:
        a, b = x, x, x  # type: ignore[misc]
        return a

    def nothing(x: float) -> None:
        x = 1.0

    def whole(x: float) -> int:
        return int(x)

    def length(x: float) -> int:
        return len(x)  # type: ignore[arg-type]

    def mixed(n: int, x: float) -> float:
        return max(n, x)

    def lower_side(values: Any, x: float) -> int:
        return np.searchsorted(values, x)  # type: ignore[return-value]

    def stepped(values: Any, x: float) -> float:
        return values[:-1].max()

    def third_axis(values: Any, x: float) -> float:
        return values.shape[1]

    def before_last(values: Any, x: float) -> float:
        return np.diff(values)[:-2].max()

    def by_number(values: Any, x: float) -> float:
        return values[x]

    def of_numbers(values: Any, x: float) -> int:
        return np.argmax(values)  # type: ignore[return-value]

    def unknown_size(values: Any, x: float) -> float:
        return np.zeros((int(values.shape[0]), 2))[0, 0]

    def turned(values: Any, x: float) -> float:
        return np.moveaxis(values, 0, 1)[0]  # type: ignore[no-any-return]

    def ragged(x: float) -> float:
        return np.array([[x, 1.0], [2.0]])[0, 0]

    def attribute(x: float) -> float:
        return x.real

    return [*((one, number) for one in (power, long, remainder, called_by_name, not_a_number, several_types, filtered,
                                        nested_loops, in_branch, unequal, nothing, whole, length, ragged, attribute)),
            *((one, (INT,)) for one in (divided, inverted, changed_type, two_bounds, otherwise)),
            *((one, two) for one in (tested_tuple, unpacked)), (mixed, (INT, DOUBLE)),
            *((one, row) for one in (lower_side, stepped, third_axis, before_last, by_number, of_numbers,
                                     turned)),
            (unknown_size, table)]


@pytest.mark.parametrize(("source", "kinds"), refused_sources(), ids=lambda one: getattr(one, "__name__", ""))
def test_any_other_construct_is_refused_by_the_name_of_its_function(source: Callable[..., Any],
                                                                    kinds: tuple[Any, ...]) -> None:
    """And by up to 200 letters of what it refuses, here without spaces and parentheses."""
    with pytest.raises(Refused) as caught:
        Library().function(source, kinds)
    name, _, piece = str(caught.value).partition(": ")
    text = ast.unparse(ast.parse(textwrap.dedent(inspect.getsource(source))))
    assert name == source.__name__
    assert re.sub(r"[\s()]", "", piece) in re.sub(r"[\s()]", "", text)
    assert len(piece) == (200 if source.__name__ == "long" else min(len(piece), 199))


def test_types_have_names_declarations_and_a_common_type() -> None:
    pair, some, table, longer = Tuple((DOUBLE, INT)), Tuple((DOUBLE, INT), True), Table(3, 4), Table(3, 7)
    assert (pair.name, some.name, table.name, table.title) == ("tuple_di", "optional_di", "const table_4x3 *",
                                                               "table_4x3")
    assert pair.declaration() == "typedef struct { double _0; int _1; } tuple_di;"
    assert some.declaration() == "typedef struct { int has; double _0; int _1; } optional_di;"
    assert table.declaration() == "typedef struct { int has; int rows; double at[4][3]; } table_4x3;"
    assert (Row().name, Row(writable=True).name, Row().length, Row().stride) == ("const double *", "double *", -1, 1)
    struct = Struct("Both", (("pair", pair), ("table", table)))
    assert struct.declaration() == "typedef struct {\n    tuple_di pair;\n    table_4x3 table;\n} Both;"
    assert (struct.name, size_of(struct), size_of(Row(length=5)), size_of(DOUBLE)) == ("const Both *", 8 + 96, 40, 8)
    none, yes = Static(None), Static(True)
    for one, other, common in ((DOUBLE, DOUBLE, DOUBLE), (DOUBLE, INT, None), (none, pair, some), (none, some, some),
                               (none, table, table), (pair, some, some), (table, longer, longer),
                               (table, Table(2, 4), None), (pair, Tuple((DOUBLE, DOUBLE)), None),
                               (INT, yes, INT), (Static(False), yes, INT),
                               (none, DOUBLE, None), (DOUBLE, yes, None), (Static(1.5), INT, None)):
        assert common_kind(one, other) == common_kind(other, one) == common
    for kind in (none, Items(()), Vector("3", 3, str, DOUBLE)):
        with pytest.raises(Refused, match="has no type in C"):
            c_types.kind_name(kind)
    assert c_types.struct_of(Pair, {}, {}).fields == (
        ("first", DOUBLE), ("second", DOUBLE), ("count", INT), ("limits", Tuple((DOUBLE, DOUBLE))))


def test_a_structure_has_the_types_of_its_annotations() -> None:
    found = c_types.struct_of(Kinds, {"array": Table(3, 4)}, {"many": 3})
    assert (found.name, found.fields) == ("const Kinds *", (
        ("some", DOUBLE), ("many", Tuple((DOUBLE,) * 3)), ("pair", Tuple((DOUBLE, DOUBLE), True)),
        ("inner", Struct("Plain", (("first", DOUBLE), ("second", DOUBLE)))), ("array", Table(3, 4))))
    for kind, why in ((Kinds, r"(?i)^array: .*ndarray"), (Words, r"^word: <class 'str'>$")):
        with pytest.raises(Refused, match=why):
            c_types.struct_of(kind, {}, {"many": 3})


def test_texts_of_numbers_names_and_places() -> None:
    refused = Refused("it")
    assert [literal(value, refused) for value in (1, -1, 0.1, -0.5, math.inf, -math.inf)] == [
        ("1", INT), ("(-1)", INT), ("0.1", DOUBLE), ("(-0.5)", DOUBLE), ("INFINITY", DOUBLE), ("(-INFINITY)", DOUBLE)]
    for value in (True, math.nan, "a", None):
        with pytest.raises(Refused, match="it"):
            literal(value, refused)
    assert [enclosed(text) for text in ("(a)", "((a) + (b))", "(a) + (b)", "a", "(a", "", "a(b)")] == [
        True, True, False, False, False, False, False]
    assert [target_of(text) for text in ("&a", "*a", "a")] == ["a", "a", "*a"]
    assert [word(name) for name in ("slip", "double", "tanh", "free")] == ["slip", "double_", "tanh_", "free_"]
    assert [base_units(unit) for unit in ("N m s/rad", "kg m^2", "rad/s", "", "Pa/s")] == [
        {"kg": 1, "m": 2, "s": -1, "rad": -1}, {"kg": 1, "m": 2}, {"rad": 1, "s": -1}, {},
        {"kg": 1, "m": -1, "s": -3}]
    assert unit_name("kg m^2") == "kg.m^2"
    assert [Variable(name, "", "", "", "").word for name in ("a.b", "a.b[1]", "a.b[2]", "a.b[11]")] == [
        "at_a_b", "at_a_b", "at_a_b_2", "at_a_b_11"]
