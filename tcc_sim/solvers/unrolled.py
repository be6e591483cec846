"""Straight-line machine code from ordinary Python, which runs once while compiling, on names instead of numbers.

A recurrence to order 20 is a thousand products and sums. As loops they cost three times as much, for each waits for
indices and memory; written out as Python source they take many seconds to compile. Here the Python text is run by the
compiler: every operation on a `Name` leaves one instruction, loops and branches leave none. With plain numbers the same
text computes the same thing, which is how it is tested.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

REAL = ir.DoubleType()
WHOLE = ir.IntType(64)
FUSED = ("contract",)
"""A product and a sum may become one instruction; nothing else is reordered."""


class Name:
    """A number, or a row of numbers, that the running code will know."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    def _operand(self, other: Any) -> Any:
        """`other` as an operand of the same shape."""
        shape = self.value.type
        if not isinstance(other, Name):
            count = getattr(shape, "count", 0)
            return ir.Constant(shape, [float(other)] * count if count else float(other))
        if other.value.type == shape or not isinstance(shape, ir.VectorType):
            return other.value
        return _spread(self.builder, other.value, shape)

    def _with(self, operation: str, left: Any, right: Any) -> Name:
        return Name(self.builder, getattr(self.builder, operation)(left, right, flags=FUSED))

    def __add__(self, other: Any) -> Name:
        return self if _is(other, 0.0) else self._with("fadd", self.value, self._operand(other))

    def __sub__(self, other: Any) -> Name:
        return self if _is(other, 0.0) else self._with("fsub", self.value, self._operand(other))

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, Name) and isinstance(other.value.type, ir.VectorType) > isinstance(self.value.type, ir.VectorType):
            return other * self
        if _is(other, 0.0):
            return 0.0
        return self if _is(other, 1.0) else self._with("fmul", self.value, self._operand(other))

    def __truediv__(self, other: Any) -> Name:
        return self._with("fdiv", self.value, self._operand(other))

    def __rtruediv__(self, other: Any) -> Name:
        return self._with("fdiv", self._operand(other), self.value)

    def __rsub__(self, other: Any) -> Name:
        return -self if _is(other, 0.0) else self._with("fsub", self._operand(other), self.value)

    def __neg__(self) -> Name:
        return Name(self.builder, self.builder.fneg(self.value))

    def __getitem__(self, place: int) -> Name:
        """One number of a row."""
        return Name(self.builder, self.builder.extract_element(self.value, ir.Constant(ir.IntType(32), place)))

    __radd__ = __add__
    __rmul__ = __mul__


class Memory:
    """An array of floats, one- or two-dimensional, whose entries are read once and written where they are set."""

    def __init__(self, context: Any, builder: Any, kind: Any, argument: Any) -> None:
        array = context.make_array(kind)(context, builder, argument)
        self.builder = builder
        self.start = builder.bitcast(array.data, REAL.as_pointer())
        self.strides = cgutils.unpack_tuple(builder, array.strides)
        self.length = kind.shape[-1] if hasattr(kind, "shape") else 0
        self.known: dict[Any, Name] = {}

    def _place(self, key: tuple[int, ...]) -> Any:
        offset = ir.Constant(WHOLE, 0)
        for index, stride in zip(key, self.strides):
            offset = self.builder.add(offset, self.builder.mul(ir.Constant(WHOLE, index), stride))
        return self.builder.gep(self.start, [self.builder.sdiv(offset, ir.Constant(WHOLE, 8))])

    def __getitem__(self, key: tuple[int, ...]) -> Name:
        if key not in self.known:
            self.known[key] = Name(self.builder, self.builder.load(self._place(key)))
        return self.known[key]

    def __setitem__(self, key: tuple[int, ...], value: Any) -> None:
        self.known[key] = value
        stored = value.value if isinstance(value, Name) else ir.Constant(REAL, float(value))
        self.builder.store(stored, self._place(key))

    def row(self, *key: int) -> Name:
        """A whole row of the array (the array itself where it has one dimension), as it is in memory now."""
        place = self.builder.bitcast(self._place(key), ir.VectorType(REAL, self.length).as_pointer())
        return Name(self.builder, self.builder.load(place, align=8))

    def set_row(self, value: Name, *key: int) -> None:
        """Write a whole row."""
        place = self.builder.bitcast(self._place(key), ir.VectorType(REAL, self.length).as_pointer())
        self.builder.store(value.value, place, align=8)


def _is(other: Any, number: float) -> bool:
    """Whether an operand is this very number, known while compiling."""
    return isinstance(other, (int, float)) and other == number


def _spread(builder: Any, value: Any, shape: Any) -> Any:
    """A row of equal numbers."""
    empty = ir.Constant(shape, ir.Undefined)
    first = builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, empty, ir.Constant(ir.VectorType(ir.IntType(32), shape.count), None))


def _named(context: Any, builder: Any, kind: Any, argument: Any) -> Any:
    """An argument as the staged text sees it: None, tuples and whole arrays keep their shape."""
    if isinstance(kind, types.NoneType):
        return None
    if isinstance(kind, types.BaseTuple):
        return tuple(_named(context, builder, k, a) for k, a in zip(kind, cgutils.unpack_tuple(builder, argument)))
    if isinstance(kind, types.Array):
        return Memory(context, builder, kind, argument)
    return Name(builder, argument)


def unrolled(text: Callable[..., Any]) -> Callable[..., None]:
    """The compiled form of `text`, to be called from compiled functions, with the order before its own arguments.

    Parameters
    ----------
    text : a generator function of floats, tuples, None and arrays, that yields k where coefficients up to order k are
        written: the code ends at the first yield with k at or above the order asked for. Or an ordinary function, whose
        order is ignored.
    """
    count = len(inspect.signature(text).parameters)

    def implement(_typing: Any, order: Any, *kinds: Any) -> Any:
        def write(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            names = [_named(context, builder, k, a) for k, a in zip(signature.args[1:], arguments[1:])]
            end = builder.append_basic_block("reached")
            for k in text(*names) or ():
                further = builder.append_basic_block(f"beyond_{k}")
                reached = builder.icmp_signed("<=", arguments[0], ir.Constant(arguments[0].type, k))
                builder.cbranch(reached, end, further)
                builder.position_at_end(further)
            builder.branch(end)
            builder.position_at_end(end)
            return context.get_dummy_value()

        return types.void(order, *kinds), write

    # An intrinsic's parameters are read from its signature: there is no *args.
    parameters = ", ".join(f"a{i}" for i in range(count))
    scope: dict[str, Any] = {"implement": implement}
    exec(f"def typed(typing, order, {parameters}):\n    return implement(typing, order, {parameters})\n", scope)
    made: Callable[..., None] = intrinsic(scope["typed"])
    return made
