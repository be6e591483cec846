"""Print expressions of a kernel's Python source in C, each with its type, in Python's order of evaluation.

Everything that is known beforehand is evaluated while printing: texts and lengths of lists of the scene, None, and
the branches that follow from them.
"""

from __future__ import annotations

import ast
import inspect
import math
import operator
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, ClassVar, Protocol

import numpy as np

from tcc_sim.fmi.c_types import (
    DOUBLE,
    INT,
    Items,
    Keys,
    Kind,
    Refused,
    Row,
    Scalar,
    Static,
    Struct,
    Table,
    Tuple,
    Vector,
    common_kind,
    kind_name,
)
from tcc_sim.model.friction import portable_exp

Text = tuple[str, Kind]
"""An expression in C and its type."""
FUNCTIONS: dict[Any, str] = {
    np.tanh: "tanh", np.sin: "sin", np.cos: "cos", np.exp: "exp", np.abs: "fabs", abs: "fabs", np.sign: "sign_of",
    np.maximum: "maximum", np.minimum: "minimum", np.sqrt: "sqrt", math.sqrt: "sqrt", math.sin: "sin",
    math.cos: "cos", math.floor: "floor", math.ceil: "ceil", math.exp: "exp", math.copysign: "copysign",
    math.log: "log", math.log1p: "log1p", math.expm1: "expm1", math.atanh: "atanh", portable_exp: "exp"}
"""C function of doubles by Python function; arrays are taken element by element."""
OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Gt: ">", ast.GtE: ">=", ast.Lt: "<", ast.LtE: "<=",
    ast.Eq: "==", ast.NotEq: "!="}
WHOLE: dict[type[ast.AST], Callable[[int, int], int]] = {ast.Add: operator.add, ast.Sub: operator.sub,
                                                         ast.Mult: operator.mul}
"""Arithmetic of whole numbers that are known."""
COMPARISONS: dict[type[ast.AST], Callable[[int, int], bool]] = {
    ast.Gt: operator.gt, ast.GtE: operator.ge, ast.Lt: operator.lt, ast.LtE: operator.le, ast.Eq: operator.eq,
    ast.NotEq: operator.ne}
TAKEN = {*FUNCTIONS.values(), "free", "double", "int", "float", "long", "short", "char", "void", "struct", "union",
         "auto", "static", "const", "register", "signed", "unsigned", "switch", "case", "default", "do", "goto",
         "enum", "extern", "inline", "restrict", "sizeof", "typedef", "volatile"}
"""Reserved words of C; local names that equal one get an underscore."""


class Callees(Protocol):
    """Printer of the functions and structures that expressions use."""

    def function(self, source: Any, kinds: tuple[Kind, ...]) -> Text:
        """Return name and result type of a function for arguments of these types."""

    def declared(self, kind: Kind) -> str:
        """Declare the structure of a type and return the type's name."""

    def structure(self, source: type[Any]) -> Struct:
        """Return the structure of a NamedTuple."""

    data: frozenset[str]
    absent: dict[type[Any], set[str]]


class Expressions:
    """Printer of the expressions of one function in C.

    Parameters
    ----------
    library : printer of called functions
    source : the function
    kinds : types of parameters and, later, of assigned names
    """

    def __init__(self, library: Callees, source: Callable[..., Any], kinds: dict[str, Kind]) -> None:
        self._library, self._globals, self._title = library, dict(source.__globals__), source.__name__
        self._kinds = kinds
        self._names: dict[str, Text] = {}
        """Local names that stand for an expression, with it."""
        self._locals: dict[str, Kind] = {}
        self._written: list[str] = []
        self._depth, self._fresh = 0, 0

    def _refused(self, node: ast.AST) -> Refused:
        """Return the exception for a piece of source."""
        return Refused(f"{self._title}: {ast.unparse(node)[:200]}")

    def _put(self, text: str) -> None:
        self._written.append("    " * (self._depth + 1) + text)

    def _variable(self, kind: Kind) -> str:
        """Declare a new variable and return its name."""
        self._fresh += 1
        name = f"part_{self._fresh}"
        self._locals[name] = self._kinds[name] = kind
        return name

    def _kept(self, text: str, kind: Kind) -> Text:
        """Store a value in a new variable."""
        if isinstance(kind, (Static, Items, Keys, Row, Vector)):
            return text, kind
        name = self._variable(kind)
        pointed = isinstance(kind, (Table, Struct))
        self._put(f"{name} = {target_of(text) if pointed else text};")
        return f"&{name}" if pointed else name, kind

    @contextmanager
    def _apart(self) -> Iterator[list[str]]:
        """Collect the lines that are written meanwhile, for a nested block."""
        before, self._written = self._written, []
        self._depth += 1
        try:
            yield self._written
        finally:
            self._depth -= 1
            self._written = before

    @contextmanager
    def _loop(self, length: str) -> Iterator[str]:
        k = self._variable(INT)
        self._put(f"for ({k} = 0; {k} < {length}; {k}++) {{")
        self._depth += 1
        yield k
        self._depth -= 1
        self._put("}")

    def _expression(self, node: ast.expr) -> Text:
        printed = self._nodes.get(type(node))
        if printed is None:
            raise self._refused(node)
        return printed(self, node)

    def _number(self, node: ast.expr) -> Text:
        text, kind = self._expression(node)
        if isinstance(kind, Static) and isinstance(kind.value, bool):
            return text, INT
        if not isinstance(kind, Scalar):
            raise self._refused(node)
        return text, kind

    def _test(self, node: ast.expr) -> Text:
        """Print a condition; a list or text that is known beforehand is true unless it is empty."""
        text, kind = self._expression(node)
        if isinstance(kind, Static):
            return str(int(bool(kind.value))), Static(bool(kind.value))
        if isinstance(kind, (Items, Row)):
            count = len(kind.parts) if isinstance(kind, Items) else kind.length
            return str(int(count > 0)), Static(count > 0)
        if not isinstance(kind, Scalar):
            raise self._refused(node)
        return text, kind

    def _constant(self, node: ast.Constant) -> Text:
        """Print a number, None, True, False or a text."""
        return self._value(node.value, node)

    def _value(self, value: Any, node: ast.AST) -> Text:
        """Print an object that is known: a number, a tuple, a NamedTuple; anything else has no text."""
        if value is None or isinstance(value, (bool, str)) or callable(value):
            return str(int(bool(value))), Static(value)
        if isinstance(value, tuple):
            parts = tuple(self._value(part, node) for part in value)
            if not hasattr(value, "_fields"):
                return "", Items(parts)
            kind = self._library.structure(type(value))
            self._library.declared(kind)
            return f"&({kind.title}){{{', '.join(text for text, _ in parts)}}}", kind
        if isinstance(value, (int, float)):
            return literal(value, self._refused(node))
        return "", Static(value)

    def _name(self, node: ast.Name) -> Text:
        """Print a local name, or an object of the source's module."""
        if node.id in self._names:
            return self._names[node.id]
        if node.id in self._kinds:
            kind = self._kinds[node.id]
            stored = isinstance(kind, (Table, Struct)) and node.id in self._locals
            return f"{'&' if stored else ''}{word(node.id)}", kind
        return self._value(self._resolved(node), node)

    def _attribute(self, node: ast.Attribute) -> Text:
        """Print a field of a NamedTuple, a scene key, data that are known, or an object of another module."""
        if isinstance(node.value, ast.Name) and node.value.id not in {*self._kinds, *self._names} \
                and not isinstance(self._resolved(node.value), tuple):
            return self._value(self._resolved(node), node)
        text, kind = self._expression(node.value)
        if isinstance(kind, Keys):
            return self._key(text, kind, node)
        if isinstance(kind, Static):
            return self._value(getattr(kind.value, node.attr), node)
        if isinstance(kind, Struct):
            for name, field in kind.fields:
                if name == node.attr and isinstance(field, Static):
                    return self._value(field.value, node)
                if name == node.attr:
                    place = f"{text[1:]}.{name}" if text.startswith("&") else f"{text}->{name}"
                    return f"&{place}" if isinstance(field, (Table, Struct)) else place, field
        raise self._refused(node)

    def _key(self, text: str, kind: Keys, node: ast.Attribute) -> Text:
        """Print a scene key of a group, one of its groups, or what a property of it computes."""
        title, group = f"{type(kind.value).__name__}.{node.attr}", type(kind.value)
        member = getattr(group, node.attr, None)
        if title not in self._library.data and (isinstance(member, property) or hasattr(member, "func")):
            name, result = self._library.function(getattr(member, "fget", None) or member.func, (kind,))  # type: ignore[union-attr]
            return (name, result) if isinstance(result, (Static, Items)) else self._result(f"{name}({text})", result)
        value = getattr(kind.value, node.attr)
        if not kind.group and node.attr in type(kind.value).__annotations__ and hasattr(value, "quantities"):
            return text, Keys(value, node.attr, kind.place)
        place = kind.place(f"{kind.group}.{node.attr}")
        if value == ():
            return "0", Static(())
        if place is None:
            return self._value(value, node)
        if isinstance(value, tuple):
            return f"({text} + {place})", Row(length=len(value))
        return f"{text}[{place}]", DOUBLE

    def _result(self, text: str, kind: Kind) -> Text:
        """Return a call's text; a structure that it makes is stored in a new variable, its last argument."""
        if not isinstance(kind, (Table, Struct)):
            return text, kind
        name = self._variable(kind)
        self._put(f"{text[:-1]}{'' if text.endswith('()') else ', '}&{name});")
        return f"&{name}", kind

    def _subscript(self, node: ast.Subscript) -> Text:
        """Print a part of a tuple, an element, a row or a slice of an array, or its shape."""
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            return self._shape(node, node.value.value)
        text, kind = self._expression(node.value)
        at = f"{text[1:]}.at" if text.startswith("&") else f"{text}->at"
        places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        cut = node.slice
        if isinstance(kind, Table) and isinstance(cut, ast.Slice) and cut.upper and not (cut.lower or cut.step):
            text, _ = self._kept(text, kind)
            self._put(f"{text[1:]}.rows = {self._place(cut.upper)};")
            return text, kind
        if isinstance(kind, Table) and isinstance(places[0], ast.Slice):
            first, length = self._rows(places[0], f"{at[:-2]}rows")
            column = self._place(places[1])
            return "", Vector(length, kind.most, lambda k: f"{at}[{_sum(k, first)}][{column}]", DOUBLE)
        if isinstance(kind, Table):
            one, other = self._expression(places[0]), [self._place(place) for place in places[1:]]
            where = "".join(f"[{place}]" for place in other)
            if isinstance(index := one[1], Vector):
                return "", Vector(index.length, index.most, lambda k: f"{at}[{index.at(k)}]{where}", DOUBLE)
            return f"{at}[{self._place(places[0])}]{where}", DOUBLE if where else Row(length=kind.columns)
        if isinstance(kind, Row):
            return self._of_row(text, kind, node)
        if isinstance(kind, Vector):
            if not isinstance(node.slice, ast.Slice):
                return kind.at(self._place(node.slice)), kind.kind
            first, length = self._rows(node.slice, kind.length)
            return "", Vector(length, kind.most, lambda k: kind.at(_sum(k, first)), kind.kind)
        place = self._known(node.slice)
        if isinstance(kind, Items) and place is not None:
            return kind.parts[place]
        if isinstance(kind, Tuple) and place is not None:
            return f"{text}._{place}", kind.parts[place]
        raise self._refused(node)

    def _shape(self, node: ast.Subscript, array: ast.expr) -> Text:
        """Print the number of rows or columns of an array."""
        text, kind = self._expression(array)
        place = self._known(node.slice)
        if isinstance(kind, Table):
            rows = f"{text[1:]}.rows" if text.startswith("&") else f"{text}->rows"
            return rows if place == 0 else str(kind.columns), INT
        if isinstance(kind, Row) and kind.length >= 0 and place == 0:
            return str(kind.length), INT
        raise self._refused(node)

    def _of_row(self, text: str, kind: Row, node: ast.Subscript) -> Text:
        """Print an element, or each n-th one, of a row of numbers."""
        stride = f" * {kind.stride}" if kind.stride > 1 else ""
        if not isinstance(node.slice, ast.Slice):
            return f"{text}[{self._place(node.slice)}{stride}]", DOUBLE
        if node.slice.lower is None or node.slice.upper is not None or node.slice.step is None or kind.stride > 1:
            raise self._refused(node)
        first, step = self._known(node.slice.lower), self._known(node.slice.step)
        if first is None or step is None:
            raise self._refused(node)
        return f"({text} + {first})", Row(length=len(range(first, kind.length, step)), stride=step)

    def _rows(self, node: ast.Slice, length: str) -> tuple[str, str]:
        """Return the first index and the number of elements of a slice, which may end one before the end."""
        if node.step is not None:
            raise self._refused(node)
        first = "0" if node.lower is None else self._place(node.lower)
        if not first.isdigit():
            first, _ = self._kept(first, INT)
        if node.upper is None:
            return first, length if first == "0" else f"({length} - {first})"
        if ast.unparse(node.upper) != "-1" or first != "0":
            raise self._refused(node)
        return first, f"({length} - 1)"

    def _known(self, node: ast.expr) -> int | None:
        """Return an integer that is known when printing; None for any other expression."""
        if not isinstance(node, (ast.Constant, ast.BinOp, ast.Name, ast.Attribute, ast.Subscript, ast.Call)):
            return None
        with self._apart() as lines:
            text, kind = self._expression(node)
        return int(text) if kind == INT and text.isdigit() and not lines else None

    def _place(self, node: ast.expr) -> str:
        """Print an integer index."""
        text, kind = self._expression(node)
        if kind != INT:
            raise self._refused(node)
        return text

    def _each(self, function: Callable[..., Text], *parts: Text) -> Text:
        """Print an operation on numbers, or on arrays element by element."""
        listed = [(text, self._vector(text, kind) if isinstance(kind, (Row, Vector)) else kind) for text, kind in parts]
        vectors = [kind for _, kind in listed if isinstance(kind, Vector)]
        if not vectors:
            return function(*parts)

        def at(k: str) -> Text:
            return function(*((kind.at(k), kind.kind) if isinstance(kind, Vector) else (text, kind)
                              for text, kind in listed))
        kind = at("0")[1]
        assert isinstance(kind, Scalar)
        return "", Vector(vectors[0].length, vectors[0].most, lambda k: at(k)[0], kind)

    def _vector(self, text: str, kind: Kind) -> Vector:
        """Return a row as the numbers in it."""
        if isinstance(kind, Vector):
            return kind
        assert isinstance(kind, Row)
        stride = f" * {kind.stride}" if kind.stride > 1 else ""
        return Vector(str(kind.length), kind.length, lambda k: f"{text}[{k}{stride}]", DOUBLE)

    def _binop(self, node: ast.BinOp) -> Text:
        squared = isinstance(node.op, ast.Pow) and isinstance(node.right, ast.Constant) and node.right.value == 2

        def combined(one: Text, other: Text) -> Text:
            (left, first), (right, second) = one, other
            if not (isinstance(first, Scalar) and isinstance(second, Scalar)):
                raise self._refused(node)
            if squared:
                return f"({left} * {left})", first
            kind = INT if first == second == INT else DOUBLE
            if type(node.op) not in OPERATORS or (isinstance(node.op, ast.Div) and kind == INT):
                raise self._refused(node)
            if kind == INT and left.isdigit() and right.isdigit() and type(node.op) in WHOLE:
                return literal(WHOLE[type(node.op)](int(left), int(right)), self._refused(node))
            return f"({left} {OPERATORS[type(node.op)]} {right})", kind
        return self._each(combined, self._expression(node.left), self._expression(node.right))

    def _unaryop(self, node: ast.UnaryOp) -> Text:
        if isinstance(node.op, ast.Not):
            text, kind = self._test(node.operand)
            return (f"(!{text})", INT) if kind == INT else self._value(not kind.value, node)  # type: ignore[union-attr]
        if isinstance(node.op, ast.USub):
            return self._each(lambda part: (f"(-{part[0]})", part[1]), self._expression(node.operand))
        raise self._refused(node)

    def _boolop(self, node: ast.BoolOp) -> Text:
        deciding, sign = (False, "&&") if isinstance(node.op, ast.And) else (True, "||")
        texts = []
        for part in node.values:
            with self._apart() as lines:
                text, kind = self._test(part)
            if isinstance(kind, Static):
                if kind.value == deciding:
                    return str(int(deciding)), Static(deciding)
            elif lines:
                raise self._refused(part)
            else:
                texts.append(text)
        if not texts:
            return str(int(not deciding)), Static(not deciding)
        return texts[0] if len(texts) == 1 else f"({f' {sign} '.join(texts)})", INT

    def _namedexpr(self, node: ast.NamedExpr) -> Text:
        text, kind = self._number(node.value)
        self._declare(node.target.id, kind, node)
        return f"({word(node.target.id)} = {text[1:-1] if enclosed(text) else text})", kind

    def _declare(self, name: str, kind: Kind, node: ast.AST) -> None:
        """Declare a variable, whose type cannot change."""
        self._names.pop(name, None)
        if isinstance(kind, Static) or self._kinds.get(name, kind) != kind:
            raise self._refused(node)
        if name not in self._kinds:
            self._locals[name] = kind
        self._kinds[name] = kind

    def _compare(self, node: ast.Compare) -> Text:
        if isinstance(node.ops[0], (ast.Is, ast.IsNot)):
            return self._absent(node.left, isinstance(node.ops[0], ast.Is))
        parts, left = list[Text](), node.left
        for sign, right in zip(node.ops, node.comparators):
            parts.append(self._compared(sign, self._expression(left), self._expression(right), node))
            left = right.target if isinstance(right, ast.NamedExpr) else right
        if len(parts) == 1:
            return parts[0]
        return f"({' && '.join(text.removeprefix('(').removesuffix(')') for text, _ in parts)})", INT

    def _compared(self, sign: ast.cmpop, one: Text, other: Text, node: ast.AST) -> Text:
        (left, first), (right, second) = one, other
        if isinstance(first, Static) and isinstance(sign, (ast.In, ast.NotIn)) and isinstance(second, Items):
            return self._value((first in [kind for _, kind in second.parts]) == isinstance(sign, ast.In), node)
        if isinstance(first, Static) and isinstance(second, Static) and isinstance(sign, (ast.Eq, ast.NotEq)):
            return self._value((first == second) == isinstance(sign, ast.Eq), node)
        if isinstance(first, Struct) and first == second and isinstance(sign, ast.Eq) \
                and all(isinstance(kind, Scalar) for _, kind in first.fields):
            left = f"({left})" if left.startswith("&") else left
            return f"({' && '.join(f'{left}->{name} == ({right})->{name}' for name, _ in first.fields)})", INT
        if type(sign) not in OPERATORS:
            raise self._refused(node)
        if first == second == INT and left.isdigit() and right.isdigit():
            return self._value(COMPARISONS[type(sign)](int(left), int(right)), node)

        def compared(one: Text, other: Text) -> Text:
            if not (isinstance(one[1], Scalar) and isinstance(other[1], Scalar)):
                raise self._refused(node)
            return f"({one[0]} {OPERATORS[type(sign)]} {other[0]})", INT
        return self._each(compared, one, other)

    def _absent(self, node: ast.expr, absent: bool) -> Text:
        """Print whether a value is None, or is not."""
        text, kind = self._expression(node)
        if isinstance(kind, Table) or (isinstance(kind, Tuple) and kind.optional):
            dot = "->" if isinstance(kind, Table) and not text.startswith("&") else "."
            return f"{'!' if absent else ''}{text.removeprefix('&')}{dot}has", INT
        return self._value((isinstance(kind, Static) and kind.value is None) == absent, node)

    def _ifexp(self, node: ast.IfExp) -> Text:
        """Print a conditional expression; only one branch if the condition is known."""
        test, static = self._test(node.test)
        if isinstance(static, Static):
            return self._expression(node.body if static.value else node.orelse)
        with self._apart() as lines:
            one = self._stored(*self._expression(node.body))
        with self._apart() as others:
            other = self._stored(*self._expression(node.orelse))
        kind = common_kind(one[1], other[1])
        if kind is None:
            raise self._refused(node)
        if not (lines or others or isinstance(kind, (Table, Struct))):
            return f"({test} ? {self._as(one, kind, node)} : {self._as(other, kind, node)})", kind
        name = self._variable(kind)
        for head, branch, part in ((f"if ({test}) {{", lines, one), ("} else {", others, other)):
            self._put(head)
            self._written += branch
            self._depth += 1
            self._assign_to(name, part, kind, node)
            self._depth -= 1
        self._put("}")
        return f"&{name}" if isinstance(kind, (Table, Struct)) else name, kind

    def _as(self, part: Text, wanted: Kind, node: ast.AST) -> str:
        """Print a number or a tuple as a value of another type."""
        text, kind = part
        if kind == wanted or (wanted == DOUBLE and kind == INT):
            return text
        if isinstance(wanted, Scalar) and isinstance(kind, Static) and (wanted == INT or kind.value is None):
            return text if wanted == INT else "0.0"
        if isinstance(wanted, Tuple) and wanted.optional:
            name = self._library.declared(wanted)
            if kind == Static(None):
                return f"({name}){{0{', 0.0' * len(wanted.parts)}}}"
            if isinstance(kind, Tuple) and kind.parts == wanted.parts and text.startswith("("):
                return f"({name}){{1, {text.partition('{')[2]}"
            if isinstance(kind, Tuple) and kind.parts == wanted.parts:
                return f"({name}){{1, {', '.join(f'{text}._{place}' for place in range(len(kind.parts)))}}}"
        raise self._refused(node)

    def _assign_to(self, place: str, part: Text, wanted: Kind, node: ast.AST) -> None:
        """Print the assignment of a value of a type, or of one that it holds, to a variable or field."""
        text, kind = self._stored(*part)
        if not isinstance(wanted, (Table, Struct)):
            self._put(f"{place} = {self._as((text, kind), wanted, node)};")
        elif kind == Static(None) and isinstance(wanted, Table):
            self._put(f"memset(&{place}, 0, sizeof {place});")
        elif kind == wanted:
            self._put(f"{place} = {target_of(text)};")
        else:
            raise self._refused(node)

    def _tuple(self, node: ast.Tuple | ast.List) -> Text:
        parts = list[Text]()
        for part in node.elts:
            if isinstance(part, ast.Starred):
                parts += self._items(part.value)
            else:
                parts.append(self._expression(part))
        return "", Items(tuple(parts))

    def _items(self, node: ast.expr) -> list[Text]:
        """Return the parts of an expression that is a list or tuple, a range, or lists side by side."""
        if isinstance(node, ast.Call) and (called := self._resolved(node.func)) in (range, zip, enumerate):
            if called is range:
                bounds = [self._known(end) for end in node.args]
                if None in bounds:
                    raise self._refused(node)
                return [(str(k), INT) for k in range(*(bound for bound in bounds if bound is not None))]
            rows = [self._items(part) for part in node.args[:1 if called is enumerate else None]]
            if called is enumerate:
                first = self._known(node.args[1]) if len(node.args) > 1 else 0
                rows = [[(str(k), INT) for k in range(first or 0, (first or 0) + len(rows[0]))], *rows]
            return [("", Items(row)) for row in zip(*rows)]
        _, kind = self._expression(node)
        if isinstance(kind, Items):
            return list(kind.parts)
        raise self._refused(node)

    def _generatorexp(self, node: ast.GeneratorExp | ast.ListComp) -> Text:
        """Print an expression for each part of a list."""
        if len(node.generators) != 1 or node.generators[0].ifs:
            raise self._refused(node)
        before, parts = dict(self._names), list[Text]()
        for part in self._items(node.generators[0].iter):
            self._bind(node.generators[0].target, part)
            parts.append(self._expression(node.elt))
        self._names = before
        return "", Items(tuple(parts))

    def _bind(self, target: ast.expr, part: Text) -> None:
        """Let names stand for an expression, or for its parts."""
        if isinstance(target, ast.Name):
            self._names[target.id] = part
        elif isinstance(target, ast.Tuple) and isinstance(part[1], Items):
            for name, value in zip(target.elts, part[1].parts):
                self._bind(name, value)
        else:
            raise self._refused(target)

    def _stored(self, text: str, kind: Kind) -> Text:
        """Return a value in the form in which C holds it: a tuple of numbers as a structure."""
        if isinstance(kind, Items) and kind.parts and all(isinstance(part, Scalar) for _, part in kind.parts):
            whole = Tuple(tuple(part for _, part in kind.parts))  # type: ignore[misc]
            return f"({self._library.declared(whole)}){{{', '.join(element for element, _ in kind.parts)}}}", whole
        return text, kind

    def _call(self, node: ast.Call) -> Text:
        """Print a call of a printed function, of C's own functions or of what arrays and NamedTuples have."""
        if isinstance(node.func, ast.Attribute) and self._of_value(node.func.value):
            return self._method(node, node.func)
        called = self._resolved(node.func)
        if called in self._arrays:
            return self._arrays[called](self, node)
        if isinstance(called, type) and hasattr(called, "_fields"):
            return self._built(node, self._library.structure(called), called)
        plain = inspect.unwrap(getattr(called, "py_func", called)) if callable(called) else called
        if node.keywords and not inspect.isfunction(plain):
            raise self._refused(node)
        if called in (int, float, bool, len):
            return self._converted(node, called)
        if called in (max, min, np.maximum) and len(node.args) > 1:
            printed = self._number(node.args[0]) if called in (max, min) else self._expression(node.args[0])
            others = [self._expression(argument) for argument in node.args[1:]]
            for other in others:
                printed = self._each(lambda one, two: self._larger(called, one, two, node), printed, other)
            return printed
        if called in FUNCTIONS:
            return self._each(lambda *parts: (f"{FUNCTIONS[called]}({', '.join(text for text, _ in parts)})", DOUBLE),
                              *(self._numbers(argument) for argument in node.args))
        if called is math.isfinite:
            return f"isfinite({self._number(node.args[0])[0]})", INT
        if not inspect.isfunction(plain):
            raise self._refused(node)
        given = list[Text]()
        for argument in node.args:
            given += self._items(argument.value) if isinstance(argument, ast.Starred) else [
                self._stored(*self._expression(argument))]
        missing = [parameter for parameter in list(inspect.signature(plain).parameters.values())[len(given):]
                   if parameter.kind is not parameter.VAR_POSITIONAL]
        named = {word.arg: self._stored(*self._expression(word.value)) for word in node.keywords}
        given += [named.get(parameter.name) or self._value(parameter.default, node) for parameter in missing]
        return self._each(lambda *parts: self._called(plain, parts), *given) if any(
            isinstance(kind, Vector) for _, kind in given) else self._called(plain, given)

    def _called(self, plain: Any, given: Any) -> Text:
        name, result = self._library.function(plain, tuple(kind for _, kind in given))
        if isinstance(result, (Static, Items)):
            return name, result
        return self._result(f"{name}({', '.join(text for text, kind in given if not isinstance(kind, Static))})",
                            result)

    def _numbers(self, node: ast.expr) -> Text:
        """Print a number or an array."""
        text, kind = self._expression(node)
        if not isinstance(kind, (Scalar, Vector, Row)):
            raise self._refused(node)
        return text, kind

    def _larger(self, called: Any, one: Text, other: Text, node: ast.AST) -> Text:
        """Print the larger or the smaller of two numbers of one type."""
        if one[1] != other[1]:
            raise self._refused(node)
        name = "maximum" if called is np.maximum and one[1] == DOUBLE else (
            f"{'min' if called is min else 'max'}_{kind_name(one[1])}")
        return f"{name}({one[0]}, {other[0]})", one[1]

    def _of_value(self, node: ast.expr) -> bool:
        """Return whether an expression is a value of the function, and no module or class."""
        while isinstance(node, ast.Attribute):
            node = node.value
        return not isinstance(node, ast.Name) or node.id in {*self._kinds, *self._names}

    def _method(self, node: ast.Call, method: ast.Attribute) -> Text:
        """Print a call on a value: NamedTuple._replace, and copy, max, min and any of an array."""
        text, kind = self._expression(method.value)
        if method.attr == "_replace" and isinstance(kind, Struct):
            return self._built(node, kind, None, text)
        if method.attr == "copy" and isinstance(kind, Table):
            return self._kept(text, kind)
        if method.attr in ("max", "min") and isinstance(kind, (Vector, Row)):
            vector = self._vector(text, kind)
            extreme, _ = self._kept(vector.at("0"), DOUBLE)
            with self._loop(vector.length) as k:
                value = f"{method.attr}_double({extreme}, {vector.at(k)})"
                self._put(f"{extreme} = {value};")
            return extreme, DOUBLE
        raise self._refused(node)

    def _built(self, node: ast.Call, kind: Struct, called: type[Any] | None, copied: str = "") -> Text:
        """Print a new structure of a NamedTuple: from its parts, or a copy with other parts."""
        name, fields = self._variable(kind), dict(kind.fields)
        given = dict(zip(fields, map(self._expression, node.args)))
        given |= {str(word.arg): self._expression(word.value) for word in node.keywords}
        for field, value in (getattr(called, "_field_defaults", {}) if called else {}).items():
            given.setdefault(field, self._value(value, node))
        self._put(f"{name} = {target_of(copied)};" if copied else f"memset(&{name}, 0, sizeof {name});")
        if called:
            nothing = {field for field, part in given.items() if part[1] == Static(None)}
            self._library.absent[called] = self._library.absent.get(called, nothing) & nothing
        for field, part in given.items():
            if fields[field] == part[1] == Static(None):
                continue
            self._assign_to(f"{name}.{field}", part, fields[field], node)
        return f"&{name}", kind

    def _converted(self, node: ast.Call, called: Any) -> Text:
        """Print int and float of a number, and the length of a tuple or an array."""
        text, kind = self._expression(node.args[0])
        if called is len:
            if isinstance(kind, (Items, Tuple)):
                return str(len(kind.parts)), INT
            if isinstance(kind, Table):
                return f"{text[1:]}.rows" if text.startswith("&") else f"{text}->rows", INT
            if isinstance(kind, (Row, Vector)) and self._vector(text, kind).length != "-1":
                return self._vector(text, kind).length, INT
        if kind != (DOUBLE if called is float else INT):
            raise self._refused(node)
        return text, kind

    def _np_searchsorted(self, node: ast.Call) -> Text:
        """Print searchsorted(table[:, k] or stored numbers, x, side="right")."""
        if [ast.unparse(keyword) for keyword in node.keywords] != ["side='right'"]:
            raise self._refused(node)
        text, kind = self._expression(node.args[0])
        if not isinstance(kind, (Vector, Row)):
            raise self._refused(node)
        vector = self._vector(text, kind)
        columns = 1
        column = node.args[0]
        if isinstance(column, ast.Subscript):
            owner = self._expression(column.value)[1]
            columns = owner.columns if isinstance(owner, Table) else 1
        return self._each(lambda value: (f"searched(&{vector.at('0')}, {columns}, {vector.length}, {value[0]})", INT),
                          self._numbers(node.args[1]))

    def _np_moveaxis(self, node: ast.Call) -> Text:
        """Print moveaxis(row, -1, 0) of a single row."""
        text, kind = self._expression(node.args[0])
        if not isinstance(kind, Row) or [ast.unparse(part) for part in node.args[1:]] != ["-1", "0"]:
            raise self._refused(node)
        return text, kind

    def _np_zeros(self, node: ast.Call) -> Text:
        """Print a new array of zeros, (rows, columns), with a number of columns that is known."""
        shape = node.args[0]
        if not isinstance(shape, ast.Tuple):
            raise self._refused(node)
        rows, columns = self._place(shape.elts[0]), self._known(shape.elts[1])
        most = int(rows) if rows.isdigit() else 0
        if not most and isinstance(call := shape.elts[0], ast.Call):
            kind = self._expression(call.args[0])[1]
            most = kind.most if isinstance(kind, Vector) else 0
        if not most or not columns:
            raise self._refused(node)
        return self._new(Table(columns, most), rows)

    def _new(self, kind: Table, rows: str) -> Text:
        name = self._variable(kind)
        self._put(f"memset(&{name}, 0, sizeof {name});")
        self._put(f"{name}.has = 1;")
        self._put(f"{name}.rows = {rows};")
        return f"&{name}", kind

    def _np_array(self, node: ast.Call) -> Text:
        rows = [kind.parts for _, kind in self._items(node.args[0]) if isinstance(kind, Items)]
        if len(set(map(len, rows))) != 1:
            raise self._refused(node)
        text, kind = self._new(Table(len(rows[0]), len(rows)), str(len(rows)))
        for k, row in enumerate(rows):
            for j, part in enumerate(row):
                self._put(f"{text[1:]}.at[{k}][{j}] = {self._as(part, DOUBLE, node)};")
        return text, kind

    def _np_diff(self, node: ast.Call) -> Text:
        vector = self._vector(*self._numbers(node.args[0]))
        return "", Vector(f"({vector.length} - 1)", vector.most,
                          lambda k: f"({vector.at(_sum(k, '1'))} - {vector.at(k)})", vector.kind)

    def _np_arange(self, node: ast.Call) -> Text:
        text = self._place(node.args[0])
        return "", Vector(text, int(text) if text.isdigit() else 0, lambda k: f"(double){k}", DOUBLE)

    def _np_concatenate(self, node: ast.Call) -> Text:
        parts = [(text, kind) for text, kind in self._items(node.args[0])]
        most = sum(len(kind.parts) if isinstance(kind, Items) else self._vector(text, kind).most
                   for text, kind in parts)
        name, count = self._variable(Row(writable=True, length=most)), self._variable(INT)
        self._put(f"{count} = 0;")
        for text, kind in parts:
            if isinstance(kind, Items):
                for number_text, number in kind.parts:
                    self._put(f"{name}[{count}++] = {self._as((number_text, number), DOUBLE, node)};")
            else:
                vector = self._vector(text, kind)
                with self._loop(vector.length) as k:
                    self._put(f"{name}[{count}++] = {vector.at(k)};")
        return "", Vector(count, most, lambda k: f"{name}[{k}]", DOUBLE)

    def _np_unique(self, node: ast.Call) -> Text:
        """Print the numbers of a stored array in order, each once; they take its place."""
        text, kind = self._expression(node.args[0])
        if not isinstance(kind, Vector) or not isinstance(node.args[0], ast.Call):
            raise self._refused(node)
        self._put(f"{kind.length} = unique(&{kind.at('0')}, {kind.length});")
        return text, kind

    def _np_cumsum(self, node: ast.Call) -> Text:
        vector = self._vector(*self._numbers(node.args[0]))
        name, total = self._variable(Row(writable=True, length=vector.most)), self._variable(DOUBLE)
        self._put(f"{total} = 0.0;")
        with self._loop(vector.length) as k:
            self._put(f"{name}[{k}] = {total} = {total} + {vector.at(k)};")
        return "", Vector(vector.length, vector.most, lambda k: f"{name}[{k}]", DOUBLE)

    def _np_argmax(self, node: ast.Call) -> Text:
        """Print the index of the first number of an array that is not 0; 0 if all are."""
        vector = self._vector(*self._numbers(node.args[0]))
        if vector.kind != INT:
            raise self._refused(node)
        index, _ = self._kept("0", INT)
        with self._loop(vector.length) as k:
            self._put(f"if {vector.at(k)} {{ {index} = {k}; break; }}")
        return index, INT

    def _np_any(self, node: ast.Call) -> Text:
        vector = self._vector(*self._numbers(node.args[0]))
        nonzero, _ = self._kept("0", INT)
        with self._loop(vector.length) as k:
            self._put(f"{nonzero} = {nonzero} || {vector.at(k)} != 0.0;")
        return nonzero, INT

    def _resolved(self, node: ast.expr) -> Any:
        """Return the object of a dotted name in the source's module, or None."""
        if isinstance(node, ast.Name):
            if node.id in self._names or node.id in self._kinds:
                kind = self._names[node.id][1] if node.id in self._names else self._kinds[node.id]
                return kind.value if isinstance(kind, Static) else None
            builtins = self._globals["__builtins__"]
            builtins = builtins if isinstance(builtins, dict) else vars(builtins)
            return self._globals.get(node.id, builtins.get(node.id))
        if isinstance(node, ast.Attribute):
            return getattr(self._resolved(node.value), node.attr, None)
        raise self._refused(node)

    _nodes: ClassVar[dict[type[ast.expr], Callable[[Expressions, Any], Text]]] = {
        ast.Constant: _constant, ast.Name: _name, ast.Attribute: _attribute, ast.Subscript: _subscript,
        ast.BinOp: _binop, ast.UnaryOp: _unaryop, ast.BoolOp: _boolop, ast.Compare: _compare, ast.IfExp: _ifexp,
        ast.NamedExpr: _namedexpr, ast.Tuple: _tuple, ast.List: _tuple, ast.GeneratorExp: _generatorexp,
        ast.ListComp: _generatorexp, ast.Call: _call}
    _arrays: ClassVar[dict[Any, Callable[[Expressions, ast.Call], Text]]] = {
        np.searchsorted: _np_searchsorted, np.moveaxis: _np_moveaxis, np.zeros: _np_zeros, np.array: _np_array,
        np.diff: _np_diff, np.arange: _np_arange, np.concatenate: _np_concatenate, np.unique: _np_unique,
        np.cumsum: _np_cumsum, np.argmax: _np_argmax, any: _np_any}
    """Functions of arrays that are printed as loops."""


def word(name: str) -> str:
    """Return a local name in C."""
    return f"{name}_" if name in TAKEN else name


def target_of(text: str) -> str:
    """Return the value at a pointer."""
    return text[1:] if text[0] in "&*" else f"*{text}"


def _sum(k: str, first: str) -> str:
    if k.isdigit() and first.isdigit():
        return str(int(k) + int(first))
    return k if first == "0" else f"{k} + {first}"


def enclosed(text: str) -> bool:
    """Return whether one pair of parentheses encloses a text."""
    depth = 0
    for place, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return letter == ")" and place == len(text) - 1
    return False


def literal(value: object, otherwise: Refused) -> Text:
    """Return a number in C, exact to the last bit."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or math.isnan(value):
        raise otherwise
    if math.isinf(value):
        return ("INFINITY" if value > 0 else "(-INFINITY)"), DOUBLE
    text = repr(value)
    return (f"({text})" if value < 0 else text), INT if isinstance(value, int) else DOUBLE
