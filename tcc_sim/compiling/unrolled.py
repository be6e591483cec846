"""Straight-line machine code from ordinary Python, which runs once while compiling, on names instead of numbers.

A recurrence to order 20 is a thousand products and sums. As loops they cost three times as much, for each waits for
indices and memory; written out as Python source they take many seconds to compile. Here a staged function is run by the
compiler: every operation on a `Name` leaves one instruction, loops and branches leave none. With plain numbers it
computes the same thing, which is how it is tested.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np
from llvmlite import ir

REAL = ir.DoubleType()
WHOLE, BYTE = ir.IntType(64), ir.IntType(8)
SHIFTER = 6755399441055744.0
"""1.5 * 2^52: a number added to it is rounded to an integer, which its last bits then hold."""
FUSED = ("contract",)
"""A product and a sum may become one instruction; nothing else is reordered."""


class Name:
    """A number, or a row of numbers in lanes, of the code that is being written."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    def _operand(self, other: Any) -> Any:
        """Return `other` as an operand of the same shape."""
        shape = self.value.type
        if not isinstance(other, Name):
            count = getattr(shape, "count", 0)
            numbers = other if isinstance(other, (Sequence, np.ndarray)) else [other] * max(count, 1)
            return ir.Constant(shape, [float(n) for n in numbers] if count else float(numbers[0]))
        if other.value.type == shape or not isinstance(shape, ir.VectorType):
            return other.value
        return _spread(self.builder, other.value, shape)

    def _with(self, operation: str, left: Any, right: Any) -> Name:
        return Name(self.builder, getattr(self.builder, operation)(left, right, flags=FUSED))

    def __add__(self, other: Any) -> Name:
        return self if is_constant(other, 0.0) else self._with("fadd", self.value, self._operand(other))

    def __sub__(self, other: Any) -> Name:
        return self if is_constant(other, 0.0) else self._with("fsub", self.value, self._operand(other))

    def __mul__(self, other: Any) -> Any:
        if not isinstance(self.value.type, ir.VectorType):
            if isinstance(other, Name) and isinstance(other.value.type, ir.VectorType):
                return other * self
            if isinstance(other, np.ndarray):
                shape = ir.VectorType(REAL, len(other))
                return Name(self.builder, _spread(self.builder, self.value, shape)) * other
        if is_constant(other, 0.0):
            return 0.0
        return self if is_constant(other, 1.0) else self._with("fmul", self.value, self._operand(other))

    def __truediv__(self, other: Any) -> Name:
        return self._with("fdiv", self.value, self._operand(other))

    def __rtruediv__(self, other: Any) -> Name:
        return self._with("fdiv", self._operand(other), self.value)

    def __rsub__(self, other: Any) -> Name:
        return -self if is_constant(other, 0.0) else self._with("fsub", self._operand(other), self.value)

    def __neg__(self) -> Name:
        return Name(self.builder, self.builder.fneg(self.value))

    def __getitem__(self, place: int) -> Name:
        """Return one number of a row."""
        return Name(self.builder, self.builder.extract_element(self.value, ir.Constant(ir.IntType(32), place)))

    __radd__ = __add__
    __rmul__ = __mul__


class Storage:
    """An array of floats with one or two dimensions; the code reads each entry once and writes it where it is set."""

    def __init__(self, builder: Any, data: Any, strides: Any, in_rows: bool, shape: tuple[int, ...]) -> None:
        self.builder = builder
        self.start = builder.bitcast(data, BYTE.as_pointer())
        self.strides = items_of(builder, strides)
        if in_rows:
            self.strides[-1] = ir.Constant(WHOLE, 8)
        self.shape, self.length = shape, shape[-1]
        self.entries: dict[Any, Name] = {}

    def _place(self, key: tuple[int, ...]) -> Any:
        offset = ir.Constant(WHOLE, 0)
        for index, stride in zip(key, self.strides):
            offset = self.builder.add(offset, self.builder.mul(ir.Constant(WHOLE, index), stride))
        return self.builder.bitcast(self.builder.gep(self.start, [offset]), REAL.as_pointer())

    def __getitem__(self, key: tuple[int, ...]) -> Name:
        if key not in self.entries:
            self.entries[key] = Name(self.builder, self.builder.load(self._place(key)))
        return self.entries[key]

    def __setitem__(self, key: tuple[int, ...], value: Any) -> None:
        self.entries[key] = value
        stored = value.value if isinstance(value, Name) else ir.Constant(REAL, float(value))
        self.builder.store(stored, self._place(key))

    def row(self, *key: int, count: int = 0) -> Name:
        """Read `count` numbers from an entry on, or a whole row."""
        place = self.builder.bitcast(self._place(key), ir.VectorType(REAL, count or self.length).as_pointer())
        return Name(self.builder, self.builder.load(place, align=8))

    def set_row(self, value: Name, *key: int) -> None:
        """Write a row of numbers from an entry on."""
        place = self.builder.bitcast(self._place(key), value.value.type.as_pointer())
        self.builder.store(value.value, place, align=8)


def magnitude(x: Any) -> Any:
    """|x|, lane by lane."""
    return _called("llvm.fabs", x) if isinstance(x, Name) else np.abs(x)


def limited(x: Any, low: float, high: float) -> Any:
    """Return x limited to [low, high], lane by lane."""
    if not isinstance(x, Name):
        return np.clip(x, low, high)
    return _called("llvm.maxnum", _called("llvm.minnum", x, high), low)


def row_of(numbers: Sequence[Any]) -> Any:
    """Return a row of single numbers."""
    builder = next((n.builder for n in numbers if isinstance(n, Name)), None)
    if builder is None:
        return np.array(numbers)
    out = ir.Constant(ir.VectorType(REAL, len(numbers)), ir.Undefined)
    for i, number in enumerate(numbers):
        value = number.value if isinstance(number, Name) else ir.Constant(REAL, number)
        out = builder.insert_element(out, value, ir.Constant(ir.IntType(32), i))
    return Name(builder, out)


def with_sign(x: Any, of: Any) -> Any:
    """Return |x| with the sign of `of`, lane by lane."""
    return _called("llvm.copysign", x, of) if isinstance(x, Name) else np.copysign(x, of)


def exp(x: Any) -> Any:
    """Return e^x to a unit in the last place, lane by lane; |x| is limited to 700.

    x = n log 2 + y with log 2 in two parts, |y| <= 0.35; e^y to order 13; n goes into the exponent's bits.
    """
    if not isinstance(x, Name):
        return np.exp(np.clip(x, -700.0, 700.0))
    builder = x.builder
    x = limited(x, -700.0, 700.0)
    shifted = x * 1.4426950408889634 + SHIFTER
    turns = Name(builder, builder.fsub(shifted.value, shifted._operand(SHIFTER)))
    y = (x - turns * 0.6931471803691238) - turns * 1.9082149292705877e-10
    out: Any = 1.0 + y * (1.0 / 13.0)
    for k in range(12, 0, -1):
        out = 1.0 + y * (1.0 / k) * out
    count = getattr(x.value.type, "count", 0)
    bits = ir.VectorType(WHOLE, count) if count else WHOLE
    places = ir.Constant(bits, [52] * count if count else 52)
    exponent = builder.shl(builder.bitcast(shifted.value, bits), places)
    return Name(builder, builder.bitcast(builder.add(builder.bitcast(out.value, bits), exponent), x.value.type))


def largest_size(x: Any) -> Any:
    """Return the largest size of the numbers of a row; nan where all are nan."""
    return folded(lambda a, b: _called("llvm.maxnum", a, b) if isinstance(a, Name) else max(a, b), magnitude(x))


def where(x: Any, relation: str, y: Any, chosen: Any, other: Any) -> Any:
    """Return `chosen` in the lanes where x is above (">") or below ("<") y, `other` elsewhere."""
    if not isinstance(x, Name):
        return np.where(np.greater(x, y) if relation == ">" else np.less(x, y), chosen, other)
    test = x.builder.fcmp_ordered(relation, x.value, x._operand(y))
    return Name(x.builder, x.builder.select(test, x._operand(chosen), x._operand(other)))


def greater(x: Any, y: Any) -> Any:
    """Return the larger of the two, lane by lane; y where one of them is nan."""
    return where(x, ">", y, x, y)


def lesser(x: Any, y: Any) -> Any:
    """Return the smaller of the two, lane by lane; y where one of them is nan."""
    return where(x, "<", y, x, y)


def folded(operation: Callable[[Any, Any], Any], x: Any) -> Any:
    """Reduce a row, whose length is a power of two, to one number, half by half."""
    if not isinstance(x, Name):
        return functools.reduce(operation, x)
    while x.value.type.count > 1:
        half = x.value.type.count // 2
        parts = [ir.Constant(ir.VectorType(ir.IntType(32), half), list(range(i, i + half))) for i in (0, half)]
        x = operation(*(Name(x.builder, x.builder.shuffle_vector(x.value, x.value, part)) for part in parts))
    return x[0]


def _called(function: str, x: Name, *others: Any) -> Name:
    """Call an LLVM intrinsic of one or two rows."""
    shape = x.value.type
    count = getattr(shape, "count", 0)
    operands = [x.value, *(x._operand(o) for o in others)]
    name, module = f"{function}.{f'v{count}' if count else ''}f64", x.builder.module
    made = module.globals.get(name) or ir.Function(module, ir.FunctionType(shape, [shape] * len(operands)), name)
    return Name(x.builder, x.builder.call(made, operands))


def is_constant(other: Any, number: float) -> bool:
    """Return whether an operand is this constant; an array of constants is not."""
    return isinstance(other, (int, float)) and other == number


def _spread(builder: Any, value: Any, shape: Any) -> Any:
    empty = ir.Constant(shape, ir.Undefined)
    first = builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, empty, ir.Constant(ir.VectorType(ir.IntType(32), shape.count), None))


def items_of(builder: Any, value: Any) -> list[Any]:
    """Return the items of a tuple or a fixed array."""
    return [builder.extract_value(value, i) for i in range(len(value.type))]


class Unrolled:
    """A staged function, as compiled functions call it."""

    def __init__(self, staged: Callable[..., Any]) -> None:
        self.py_func = staged

    def write(self, builder: Any, order: Any, names: list[Any]) -> None:
        """Run the staged function, which writes the code."""
        end = builder.append_basic_block("reached")
        for k in self.py_func(*names) or ():
            further = builder.append_basic_block(f"beyond_{k}")
            reached = builder.icmp_signed("<=", order, ir.Constant(order.type, k))
            builder.cbranch(reached, end, further)
            builder.position_at_end(further)
        builder.branch(end)
        builder.position_at_end(end)


def unrolled(staged: Callable[..., Any]) -> Callable[..., None]:
    """Return `staged` for calls from compiled functions, with the order before its own arguments.

    staged : a generator function of floats, tuples, None and arrays, that yields k once the coefficients up to order k
        are written: the code ends at the first yield with k at or above the order. Or an ordinary function, which
        ignores the order.
    """
    return cast(Callable[..., None], Unrolled(staged))
