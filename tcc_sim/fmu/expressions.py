"""Print expressions of a kernel's Python source in C, each with its type, in Python's order of evaluation."""

from __future__ import annotations

import ast
import inspect
import math
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from tcc_sim.fmu.c_types import DOUBLE, INT, Kind, Refused, Row, Scalar, Static, Struct, Table, Tuple, kind_name

Text = tuple[str, Kind]
"""An expression in C and its type."""
FUNCTIONS: dict[Any, str] = {
    np.tanh: "tanh", np.sin: "sin", np.cos: "cos", np.exp: "exp", np.abs: "fabs", abs: "fabs", np.sign: "sign_of",
    np.maximum: "maximum", np.minimum: "minimum", np.sqrt: "sqrt", math.sqrt: "sqrt", math.sin: "sin",
    math.cos: "cos", math.floor: "floor", math.exp: "exp", math.copysign: "copysign"}
"""C function of doubles by Python function."""
OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Gt: ">", ast.GtE: ">=", ast.Lt: "<", ast.LtE: "<=",
    ast.Eq: "==", ast.NotEq: "!=", ast.And: "&&", ast.Or: "||"}
TAKEN = {*FUNCTIONS.values(), "free", "double", "int", "float", "long", "short", "char", "void", "struct", "union",
         "auto", "static", "const", "register", "signed", "unsigned", "switch", "case", "default", "do", "goto",
         "enum", "extern", "inline", "restrict", "sizeof", "typedef", "volatile"}
"""Reserved words of C; local names that equal one get an underscore."""


class Callees(Protocol):
    """Printer of the functions and structures that expressions use."""

    def function(self, source: Any, kinds: tuple[Kind, ...]) -> tuple[str, Kind]:
        """Return name and result type of a function for arguments of these types."""

    def declared(self, kind: Kind) -> str:
        """Declare the structure of a type and return the type's name."""


class Expressions:
    """Printer of the expressions of one function in C.

    Parameters
    ----------
    library : printer of called functions
    source : the function
    kinds : types of parameters and, later, of assigned names
    """

    def __init__(self, library: Callees, source: Callable[..., Any], kinds: dict[str, Kind]) -> None:
        self._library, self._globals, self._title = library, source.__globals__, source.__name__
        self._kinds = kinds

    def _refused(self, node: ast.AST) -> Refused:
        """Return the exception for a piece of source."""
        return Refused(f"{self._title}: {ast.unparse(node)[:200]}")

    def _expression(self, node: ast.expr) -> Text:
        """Print an expression of any kind."""
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise self._refused(node)
        text: Text = method(node)
        return text

    def _number(self, node: ast.expr) -> Text:
        """Print an expression that is a number."""
        text, kind = self._expression(node)
        if not isinstance(kind, Scalar):
            raise self._refused(node)
        return text, kind

    def _constant(self, node: ast.Constant) -> Text:
        """Print a number, None, True or False."""
        if node.value is None or isinstance(node.value, bool):
            return str(int(bool(node.value))), Static(node.value)
        return literal(node.value, self._refused(node))

    def _name(self, node: ast.Name) -> Text:
        """Print a local name, or a number of the source's module."""
        if node.id in self._kinds:
            return word(node.id), self._kinds[node.id]
        return literal(self._globals.get(node.id), self._refused(node))

    def _attribute(self, node: ast.Attribute) -> Text:
        """Print a field of a NamedTuple, or a number of another module."""
        if isinstance(node.value, ast.Name) and node.value.id not in self._kinds:
            return literal(self._resolved(node), self._refused(node))
        text, kind = self._expression(node.value)
        if isinstance(kind, Struct):
            for name, field in kind.fields:
                if name == node.attr:
                    place = f"{text}->{name}"
                    return f"(&{place})" if isinstance(field, (Table, Struct)) else place, field
        raise self._refused(node)

    def _subscript(self, node: ast.Subscript) -> Text:
        """Print a part of a tuple, an element or a row of an array, or its number of rows."""
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            text, kind = self._expression(node.value.value)
            if isinstance(node.slice, ast.Constant) and node.slice.value == 0:
                if isinstance(kind, Table):
                    return f"{text}->rows", INT
                if isinstance(kind, Row) and kind.length:
                    return str(kind.length), INT
            raise self._refused(node)
        text, kind = self._expression(node.value)
        text = f"({text})" if text.startswith("&") else text
        if isinstance(kind, Table):
            places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
            where = "".join(f"[{self._place(place)}]" for place in places)
            return f"{text}->at{where}", DOUBLE if len(places) == 2 else Row(length=kind.columns)
        if isinstance(kind, Row):
            return f"{text}[{self._place(node.slice)}]", DOUBLE
        place = self._known(node.slice)
        if isinstance(kind, Tuple) and isinstance(place, int):
            return f"{text}._{place}", kind.parts[place]
        raise self._refused(node)

    def _known(self, node: ast.expr) -> int | None:
        """Return an integer that is known when printing; None for any other expression."""
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
            left, right = self._known(node.left), self._known(node.right)
            return None if left is None or right is None else left + right
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "len" and isinstance(node.args[0], ast.Name):
            kind = self._kinds.get(node.args[0].id)
            return len(kind.parts) if isinstance(kind, Tuple) else None
        if isinstance(node, ast.Name):
            kind = self._kinds.get(node.id)
            return kind.value if isinstance(kind, Static) and isinstance(kind.value, int) else None
        value = getattr(node, "value", None)
        return value if isinstance(value, int) else None

    def _place(self, node: ast.expr) -> str:
        """Print an integer index."""
        text, kind = self._expression(node)
        if kind != INT:
            raise self._refused(node)
        return text

    def _binop(self, node: ast.BinOp) -> Text:
        """Print arithmetic on two numbers."""
        (left, one), (right, other) = self._number(node.left), self._number(node.right)
        kind = INT if one == other == INT else DOUBLE
        if isinstance(node.op, ast.Pow) and isinstance(node.right, ast.Constant) and node.right.value == 2:
            return f"({left} * {left})", one
        if type(node.op) not in OPERATORS or (isinstance(node.op, ast.Div) and kind == INT):
            raise self._refused(node)
        return f"({left} {OPERATORS[type(node.op)]} {right})", kind

    def _unaryop(self, node: ast.UnaryOp) -> Text:
        """Print minus or not."""
        text, kind = self._number(node.operand)
        if isinstance(node.op, ast.USub):
            return f"(-{text})", kind
        if isinstance(node.op, ast.Not):
            return f"(!{text})", INT
        raise self._refused(node)

    def _boolop(self, node: ast.BoolOp) -> Text:
        """Print and, or."""
        return f"({f' {OPERATORS[type(node.op)]} '.join(self._number(part)[0] for part in node.values)})", INT

    def _compare(self, node: ast.Compare) -> Text:
        """Print comparisons of numbers or with None."""
        if isinstance(node.ops[0], (ast.Is, ast.IsNot)):
            text, kind = self._expression(node.left)
            absent = isinstance(node.ops[0], ast.Is)
            if isinstance(kind, Table) or (isinstance(kind, Tuple) and kind.optional):
                dot = "->" if isinstance(kind, Table) else "."
                text = f"({text})" if text.startswith("&") else text
                return f"{'!' if absent else ''}{text}{dot}has", INT
            return "", Static((isinstance(kind, Static) and kind.value is None) == absent)
        parts, left = [], node.left
        for operator, right in zip(node.ops, node.comparators):
            if type(operator) not in OPERATORS:
                raise self._refused(node)
            parts.append(f"{self._number(left)[0]} {OPERATORS[type(operator)]} {self._number(right)[0]}")
            left = right
        return f"({' && '.join(parts)})", INT

    def _ifexp(self, node: ast.IfExp) -> Text:
        """Print a conditional expression; only one branch if the condition is known."""
        test, static = self._expression(node.test)
        if isinstance(static, Static):
            return self._expression(node.body if static.value else node.orelse)
        (one, kind), (other, second) = self._expression(node.body), self._expression(node.orelse)
        if kind != second:
            raise self._refused(node)
        return f"({test} ? {one} : {other})", kind

    def _tuple(self, node: ast.Tuple) -> Text:
        """Print a tuple of numbers."""
        elements = [self._number(part) for part in node.elts]
        kind = Tuple(tuple(part for _, part in elements))  # type: ignore[misc]
        return f"({self._library.declared(kind)}){{{', '.join(text for text, _ in elements)}}}", kind

    def _call(self, node: ast.Call) -> Text:
        """Print a call of a printed function or of C's own functions."""
        called = self._resolved(node.func)
        if called is np.searchsorted:
            return self._searched(node)
        if node.keywords:
            raise self._refused(node)
        if called in (int, float, len):
            return self._converted(node, called)
        if called in (max, min):
            arguments = [self._number(argument) for argument in node.args]
            kind = arguments[0][1]
            if any(other != kind for _, other in arguments):
                raise self._refused(node)
            text = arguments[0][0]
            for other, _ in arguments[1:]:
                text = f"{called.__name__}_{kind_name(kind)}({text}, {other})"
            return text, kind
        if called in FUNCTIONS:
            return f"{FUNCTIONS[called]}({', '.join(self._number(argument)[0] for argument in node.args)})", DOUBLE
        if not inspect.isfunction(getattr(called, "py_func", called)):
            raise self._refused(node)
        given = [self._expression(argument) for argument in node.args]
        missing = list(inspect.signature(getattr(called, "py_func", called)).parameters.values())[len(given):]
        given += [self._constant(ast.Constant(parameter.default)) for parameter in missing]
        name, result = self._library.function(called, tuple(kind for _, kind in given))
        return f"{name}({', '.join(text for text, kind in given if not isinstance(kind, Static))})", result

    def _searched(self, node: ast.Call) -> Text:
        """Print searchsorted(table[:, k], x, side="right")."""
        column, value = node.args
        if ast.unparse(node.keywords[0]) != "side='right'" or not isinstance(column, ast.Subscript) or not isinstance(
                column.slice, ast.Tuple) or ast.unparse(column.slice.elts[0]) != ":":
            raise self._refused(node)
        text, kind = self._expression(column.value)
        if not isinstance(kind, Table):
            raise self._refused(node)
        return (f"searched(&{text}->at[0][{self._place(column.slice.elts[1])}], {kind.columns}, {text}->rows, "
                f"{self._number(value)[0]})", INT)

    def _converted(self, node: ast.Call, called: Any) -> Text:
        """Print int and float of a value of that type, and the number of rows of an array."""
        text, kind = self._expression(node.args[0])
        if called is len and isinstance(kind, Table):
            return f"{text}->rows", INT
        if kind != (INT if called is int else DOUBLE):
            raise self._refused(node)
        return text, kind

    def _resolved(self, node: ast.expr) -> Any:
        """Return the object of a dotted name in the source's module, or None."""
        if isinstance(node, ast.Name):
            builtins = self._globals["__builtins__"]
            builtins = builtins if isinstance(builtins, dict) else vars(builtins)
            return self._globals.get(node.id, builtins.get(node.id))
        if isinstance(node, ast.Attribute):
            return getattr(self._resolved(node.value), node.attr, None)
        raise self._refused(node)


def word(name: str) -> str:
    """Return a local name in C."""
    return f"{name}_" if name in TAKEN else name


def literal(value: object, otherwise: Refused) -> Text:
    """Return a number in C, exact to the last bit."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise otherwise
    text = repr(value)
    return (f"({text})" if value < 0 else text), INT if isinstance(value, int) else DOUBLE
