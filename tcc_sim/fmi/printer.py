"""Print C99 from the Python source of a kernel: the functions that Numba compiles, and their callees.

An unknown construct is refused, so a kernel that cannot be printed fails the tests of the FMU. Operations are printed
in Python's order with parentheses, so that IEEE arithmetic without fused products gives the same bits. A term that may
be None is a flag at run time.
"""

from __future__ import annotations

import ast
import builtins
import importlib
import inspect
import math
import operator
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, reduce
from typing import Any, ClassVar

import numpy as np

from tcc_sim.fmi import c_types
from tcc_sim.fmi.c_types import DOUBLE, INT, Column, Items, Kind, Pointed, Static, Struct, Table, Tuple, check, only
from tcc_sim.model.friction import portable_exp

Text = tuple[str, Kind]
"""An expression in C and its type."""
FUNCTIONS: dict[Any, str] = {
    np.tanh: "tanh", np.sin: "sin", np.cos: "cos", np.exp: "exp", np.abs: "fabs", abs: "fabs", np.sign: "sign_of",
    np.maximum: "maximum", np.minimum: "minimum", np.sqrt: "sqrt", math.sqrt: "sqrt", math.sin: "sin",
    math.cos: "cos", math.floor: "floor", math.ceil: "ceil", math.exp: "exp", math.copysign: "copysign",
    math.log: "log", math.log1p: "log1p", math.expm1: "expm1", math.atanh: "atanh", portable_exp: "exp"}
"""C function of doubles by Python function; arrays are taken element by element."""
OPERATORS: dict[type[ast.AST], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Add: ("+", operator.add), ast.Sub: ("-", operator.sub), ast.Mult: ("*", operator.mul),
    ast.Div: ("/", operator.truediv), ast.Gt: (">", operator.gt), ast.GtE: (">=", operator.ge),
    ast.Lt: ("<", operator.lt), ast.LtE: ("<=", operator.le), ast.Eq: ("==", operator.eq),
    ast.NotEq: ("!=", operator.ne)}
"""Operator in C, and its function, for whole numbers that are known."""
TAKEN = {*FUNCTIONS.values(), "free", "double", "int", "float", "long", "short", "char", "void", "struct", "union",
         "auto", "static", "const", "register", "signed", "unsigned", "switch", "case", "default", "do", "goto",
         "enum", "extern", "inline", "restrict", "sizeof", "typedef", "volatile"}
"""Reserved words of C; local names that equal one get an underscore."""
PRELUDE = """\
static double sign_of(double x) { return x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : x; }
static double maximum(double a, double b) { return a != a ? a : b != b ? b : a > b ? a : b; }
static double minimum(double a, double b) { return a != a ? a : b != b ? b : a < b ? a : b; }
static double max_double(double a, double b) { return a > b ? a : b; }
static double min_double(double a, double b) { return a < b ? a : b; }
static int max_int(int a, int b) { return a > b ? a : b; }
static int min_int(int a, int b) { return a < b ? a : b; }
static int searched(const double *at, int stride, int n, double x) \
{ int low = 0; while (low < n) { int k = (low + n) / 2; if (at[k * stride] <= x) low = k + 1; else n = k; } \
return low; }"""
LARGE = 16384
"""Size of a variable, bytes, beyond which it is not on the stack, which TCC_LARGE says in C. No function calls itself.
"""


class Library:
    """Functions printed so far, each after those that it calls, and the structures that they need.

    data : properties `Class.name` of scenes that Python evaluates, since C cannot: their values are printed
    given : functions that others stand for, or that are printed elsewhere, with name and type of the result
    structures : types of NamedTuples; those whose arrays have sizes are put in
    absent : fields of NamedTuples that are None wherever one is made
    """

    def __init__(self, data: frozenset[str] = frozenset(), given: dict[Any, Any] | None = None) -> None:
        self.texts: list[str] = []
        self.structures: dict[type[Any], Struct] = {}
        self.absent: dict[type[Any], set[str]] = {}
        self.data, self._given = data, given or {}
        self._declarations: dict[str, str] = {}
        self._done: dict[tuple[Any, tuple[Kind, ...]], Text] = {}
        self._names: set[str] = set()

    def function(self, source: Any, kinds: tuple[Kind, ...]) -> Text:
        """Return name and result type of a function for arguments of these types, and print it at the first call.

        A result that is known, such as None, has its own text in place of a name.

        Raises Refused: its source has a construct without a form in C.
        """
        plain = inspect.unwrap(getattr(source, "py_func", source))
        if isinstance(given := self._given.get(plain, plain), tuple):
            return given
        plain = given
        key = plain, kinds
        if key not in self._done:
            name = f"py_{plain.__name__.strip('_')}"
            while name in self._names:
                name += "_"
            self._names.add(name)
            result: Kind | None = None
            for _ in range(2):  # The first time finds the type that holds every result.
                printed = Function(self, plain, name, kinds, result)
                result = printed.result
            if isinstance(result, (Static, Items)):
                self._done[key] = printed.text, result
            else:
                self._done[key] = name, printed.result
                self.texts.append(printed.lines)
        return self._done[key]

    def entry(self, name: str, source: Any, *kinds: Kind) -> None:
        """Print a function that other C calls by a name of its own."""
        printed, result = self.function(source, kinds)
        check(not isinstance(result, (Static, Items)))
        self.texts.append(f"#define {name} {printed}")

    def structure(self, source: type[Any]) -> Struct:
        """Return the structure of a NamedTuple."""
        if source not in self.structures:
            self.structures[source] = c_types.struct_of(source, {}, {})
        return self.structures[source]

    def declared(self, kind: Kind) -> str:
        """Declare the structure of a type and return the type's name."""
        if isinstance(kind, Struct):
            for _, part in kind.fields:
                if not isinstance(part, Static):
                    self.declared(part)
        if isinstance(kind, (Tuple, Table, Struct)):
            self._declarations.setdefault(kind.name, kind.declaration())
        return c_types.kind_name(kind)

    def text(self) -> str:
        """Return everything printed so far."""
        used = "\n".join(self.texts)
        prelude = [line for line in PRELUDE.splitlines() if line.split("(")[0].split()[-1] + "(" in used]
        return "\n\n".join(["\n".join(self._declarations.values()), "\n".join(prelude), *self.texts]) + "\n"


@cache
def _parsed(source: Callable[..., Any]) -> ast.stmt:
    """Return the definition of a function, which is only read; finding and parsing it takes longer than printing it."""
    return ast.parse(textwrap.dedent(inspect.getsource(source))).body[0]


class Function:
    """Function for arguments of given types, printed as `lines`, with the type of its result.

    All that is known beforehand is evaluated while printing: texts and lengths of lists of the scene, None, and the
    branches that follow from them.

    kinds : types of the arguments
    result : type that holds every result; None: the first one's, or what holds all if they differ
    text : the result, if it is known when the C is printed
    """

    def __init__(self, library: Library, source: Callable[..., Any], name: str, kinds: tuple[Kind, ...],
                 result: Kind | None = None) -> None:
        self._library, self._title = library, source.__name__
        self._globals = {**vars(builtins), **source.__globals__}
        self._locals: dict[str, Kind] = {}
        self._written: list[str] = []
        self._depth, self._fresh = 0, 0
        tree = only(_parsed(source), ast.FunctionDef)
        parameters = [argument.arg for argument in tree.args.args]
        more = range(len(kinds) - len(parameters)) if tree.args.vararg else ()
        further = [f"{tree.args.vararg.arg}_{k}" for k in more]  # type: ignore[union-attr]
        given = list(zip([*parameters, *further], kinds))
        self._kinds: dict[str, Kind] = dict(given)
        """Types of parameters and, later, of assigned names."""
        self._names: dict[str, Text] = {name: (str(int(bool(kind.value))), kind) for name, kind in given
                                        if isinstance(kind, Static)}
        """Local names that stand for an expression, with it."""
        if tree.args.vararg:
            self._names[tree.args.vararg.arg] = "", Items(tuple((word(one), self._kinds[one]) for one in further))
        self.text, self._wanted, self._returned = "", result, list[Kind]()
        self._stores = Counter(part.id for part in ast.walk(tree) if isinstance(part, ast.Name)
                               and isinstance(part.ctx, ast.Store))
        self._block(tree.body)
        self.result = whole = reduce(c_types.common_kind, self._returned)
        if isinstance(whole, (Static, Items)):
            return
        library.declared(whole)
        head = [f"{library.declared(kind)} {word(parameter)}".replace("* ", "*") for parameter, kind in given
                if not isinstance(kind, Static)]
        pointed = isinstance(whole, Pointed)
        head += [f"{c_types.stored_name(whole)} *made"] if pointed else []
        used = set(re.findall(r"\w+", " ".join(self._written)))
        unused = [f"    (void){word(parameter)};" for parameter, kind in given
                  if not isinstance(kind, Static) and word(parameter) not in used]
        declarations: dict[str, list[str]] = {}
        for local, kind in self._locals.items():
            library.declared(kind)
            stored = isinstance(kind, c_types.Row)
            large = "TCC_LARGE " if c_types.size_of(kind) > LARGE else ""
            declarations.setdefault(large + ("double" if stored else c_types.stored_name(kind)), []).append(
                word(local) + (f"[{kind.length}]" if isinstance(kind, c_types.Row) else ""))
        written = [textwrap.fill(f"{kind} {', '.join(names)};".replace("* ", "*"), 110, initial_indent="    ",
                                 subsequent_indent="        ") for kind, names in declarations.items()]
        self.lines: str = "\n".join([
            f"static {'void' if pointed else c_types.stored_name(whole)} {name}({', '.join(head)})", "{", *written,
            *unused, *self._written, "}"])

    def _block(self, body: list[ast.stmt]) -> bool:
        """Print statements up to a return, and return whether there was one."""
        for node in body:
            try:
                if self._statement(node):
                    return True
            except (c_types.Refused, KeyError) as error:
                raise c_types.Refused(f"{self._title}: {ast.unparse(node)[:200]}") from error
        return False

    @contextmanager
    def _nested(self, head: str) -> Iterator[None]:
        self._put(f"{head} {{")
        self._depth += 1
        yield
        self._depth -= 1
        self._put("}")

    def _statement(self, node: ast.stmt) -> bool:
        """Print a statement of any kind; return whether it is a return."""
        match node:
            case ast.Assert() | ast.Pass() | ast.Expr(value=ast.Constant()):
                return False
            case ast.Assign(targets=[target], value=value) | ast.AnnAssign(target=target, value=ast.expr() as value):
                self._assign(target, value)
            case ast.AugAssign(target=target, op=sign, value=value):
                self._assign(target, ast.BinOp(ast.parse(ast.unparse(target), mode="eval").body, sign, value))
            case ast.If():
                return self._if(node)
            case ast.While(orelse=[]):
                with self._nested(f"while ({_bare(self._number(node.test)[0])})"):
                    self._block(node.body)
            case ast.For():
                self._for(node)
            case ast.Break():
                self._put("break;")
            case ast.ImportFrom():
                module = importlib.import_module(str(node.module))
                self._globals |= {alias.asname or alias.name: getattr(module, alias.name) for alias in node.names}
            case ast.Return(value=ast.expr() as value):
                self._return(value)
                return True
            case _:
                raise c_types.Refused
        return False

    def _return(self, value: ast.expr) -> None:
        text, kind = self._stored(*self._expression(value))
        self._returned.append(kind)
        wanted = self._wanted if self._wanted is not None else kind
        self.text = text
        if isinstance(wanted, Pointed):
            self._assign_to("*made", (text, kind), wanted)
            self._put("return;")
        else:
            self._put(f"return {self._as((text, kind), wanted)};")

    def _for(self, node: ast.For) -> None:
        """Print a loop: unrolled if its items are known, and over whole numbers otherwise."""
        item = only(node.target, ast.Name).id
        leaves = any(isinstance(part, ast.Break) for part in ast.walk(node))
        ends = node.iter.args if isinstance(node.iter, ast.Call) else []
        if not ends or (not leaves and all(self._known(end) is not None for end in ends)):
            for part in self._items(node.iter):
                self._names[item] = part
                self._block(node.body)
            return
        check(self._resolved(only(node.iter, ast.Call).func) is range and len(ends) == 1)
        end, name = self._place(ends[0]), word(item)
        self._declare(item, INT)
        with self._nested(f"for ({name} = 0; {name} < {end}; {name}++)"):
            self._block(node.body)

    def _if(self, node: ast.If) -> bool:
        """Print a condition; only one branch if it is known. Return whether that one ends the function."""
        test, kind = self._test(node.test)
        if isinstance(kind, Static):
            return self._block(node.body if kind.value else node.orelse)
        with self._apart() as lines:
            self._block(node.body)
        with self._apart() as others:
            self._block(node.orelse)
        if lines or others:
            self._put(f"if ({_bare(test)}) {{")
            self._written += lines
            if others:
                self._put("} else {")
                self._written += others
            self._put("}")
        return False

    def _assign(self, target: ast.expr, value: ast.expr) -> None:
        """Print an assignment; for several names all values are computed first."""
        if not isinstance(target, ast.Tuple):
            self._store(target, *self._expression(value))
            return
        if isinstance(value, ast.Tuple):
            stored = {name.id for name in ast.walk(target) if isinstance(name, ast.Name)}
            read = {name.id for name in ast.walk(value) if isinstance(name, ast.Name)}
            elements = [self._expression(part) for part in value.elts]
            parts = [self._kept(*part) for part in elements] if stored & read else elements
        else:
            text, kind = self._expression(value)
            if not isinstance(value, ast.Name):
                text, kind = self._kept(text, kind)
            parts = [(f"{text}._{place}", part) for place, part in enumerate(only(kind, Tuple).parts)]
        check(len(parts) == len(target.elts))
        for name, (text, kind) in zip(target.elts, parts):
            if not (isinstance(name, ast.Name) and name.id == "_"):
                self._store(name, text, kind)

    def _store(self, target: ast.expr, text: str, kind: Kind) -> None:
        """Store a value in a variable or an array; a name stands for what is known or points somewhere."""
        text, kind = self._stored(text, kind)
        if isinstance(target, ast.Name) and isinstance(kind, Static) and isinstance(kind.value, bool) \
                and self._stores[target.id] > 1:
            kind = INT
        if isinstance(target, ast.Name) and isinstance(kind, (
                Static, Items, c_types.Keys, c_types.Row, Column, Table, Struct)):
            check(not self._depth)
            self._names[target.id] = text, kind
        elif isinstance(target, ast.Name):
            self._declare(target.id, kind)
            self._put(f"{word(target.id)} = {_bare(text)};")
        elif isinstance(target, ast.Subscript) and any(isinstance(part, ast.Slice) for part in ast.walk(target.slice)):
            self._fill(target, text, kind)
        else:
            check(isinstance(kind, c_types.Scalar))
            self._put(f"{self._subscript(only(target, ast.Subscript))[0]} = {text};")

    def _fill(self, target: ast.Subscript, text: str, kind: Kind) -> None:
        column = only(self._subscript(target)[1], Column)
        check(isinstance(kind, (c_types.Scalar, Column)))
        with self._loop(column.length) as k:
            self._put(f"{column.at(k)} = {kind.at(k) if isinstance(kind, Column) else text};")

    def _put(self, text: str) -> None:
        self._written.append("    " * (self._depth + 1) + text)

    def _variable(self, kind: Kind) -> str:
        self._fresh += 1
        name = f"part_{self._fresh}"
        self._locals[name] = self._kinds[name] = kind
        return name

    def _kept(self, text: str, kind: Kind) -> Text:
        name = self._variable(kind)
        pointed = isinstance(kind, Pointed)
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
        with self._nested(f"for ({k} = 0; {k} < {length}; {k}++)"):
            yield k

    def _expression(self, node: ast.expr) -> Text:
        return self._nodes[type(node)](self, node)

    def _number(self, node: ast.expr) -> Text:
        text, kind = self._expression(node)
        return text, only(kind, c_types.Scalar)

    def _test(self, node: ast.expr) -> Text:
        """Print a condition; a list or text that is known beforehand is true unless it is empty."""
        text, kind = self._expression(node)
        if isinstance(kind, Static):
            return str(int(bool(kind.value))), Static(bool(kind.value))
        if isinstance(kind, (Items, c_types.Row)):
            count = len(kind.parts) if isinstance(kind, Items) else kind.length
            return str(int(count > 0)), Static(count > 0)
        return text, only(kind, c_types.Scalar)

    def _constant(self, node: ast.Constant) -> Text:
        return self._value(node.value)

    def _value(self, value: Any) -> Text:
        """Print an object that is known: a number, a tuple, a NamedTuple; anything else has no text."""
        if value is None or isinstance(value, (bool, str)) or callable(value):
            return str(int(bool(value))), Static(value)
        if isinstance(value, tuple):
            parts = tuple(self._value(part) for part in value)
            if not hasattr(value, "_fields"):
                return "", Items(parts)
            kind = self._library.structure(type(value))
            self._library.declared(kind)
            return f"&({kind.title}){{{', '.join(text for text, _ in parts)}}}", kind
        if isinstance(value, (int, float)):
            return literal(value)
        return "", Static(value)

    def _name(self, node: ast.Name) -> Text:
        """Print a local name, or an object of the source's module."""
        if node.id in self._names:
            return self._names[node.id]
        if node.id in self._kinds:
            kind = self._kinds[node.id]
            stored = isinstance(kind, Pointed) and node.id in self._locals
            return f"{'&' if stored else ''}{word(node.id)}", kind
        return self._value(self._globals[node.id])

    def _attribute(self, node: ast.Attribute) -> Text:
        """Print a field of a NamedTuple, a scene key, data that are known, or an object of another module."""
        text, kind = self._expression(node.value)
        if isinstance(kind, c_types.Keys):
            return self._key(text, kind, node)
        if isinstance(kind, Static):
            return self._value(getattr(kind.value, node.attr))
        field = dict(only(kind, Struct).fields)[node.attr]
        if isinstance(field, Static):
            return self._value(field.value)
        place = f"{text[1:]}.{node.attr}" if text.startswith("&") else f"{text}->{node.attr}"
        return f"&{place}" if isinstance(field, Pointed) else place, field

    def _key(self, text: str, kind: c_types.Keys, node: ast.Attribute) -> Text:
        """Print a scene key of a group, one of its groups, or what a property of it computes."""
        title, group = f"{type(kind.value).__name__}.{node.attr}", type(kind.value)
        member = getattr(group, node.attr, None)
        if title not in self._library.data and (isinstance(member, property) or hasattr(member, "func")):
            name, result = self._library.function(getattr(member, "fget", None) or member.func, (kind,))  # type: ignore[union-attr]
            return (name, result) if isinstance(result, (Static, Items)) else self._result(f"{name}({text})", result)
        value = getattr(kind.value, node.attr)
        if not kind.group and node.attr in type(kind.value).__annotations__ and hasattr(value, "quantities"):
            return text, c_types.Keys(value, node.attr, kind.place)
        place = kind.place(f"{kind.group}.{node.attr}")
        if place is None:
            return self._value(value)
        if isinstance(value, tuple):
            return f"({text} + {place})", c_types.Row(length=len(value))
        return f"{text}[{place}]", DOUBLE

    def _result(self, text: str, kind: Kind) -> Text:
        """Return a call's text; a structure that it makes is stored in a new variable, its last argument."""
        if not isinstance(kind, Pointed):
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
        if isinstance(kind, Table) and isinstance(cut, ast.Slice):
            check((cut.lower, cut.step) == (None, None))
            text, _ = self._kept(text, kind)
            self._put(f"{text[1:]}.rows = {self._place(only(cut.upper, ast.expr))};")
            return text, kind
        if isinstance(kind, Table) and isinstance(places[0], ast.Slice):
            check(ast.unparse(places[0]) == ":")
            column = self._place(places[1])
            return "", Column(f"{at[:-2]}rows", lambda k: f"{at}[{k}][{column}]")
        if isinstance(kind, Table):
            row, *where = [f"[{self._place(place)}]" for place in places]
            return f"{at}{row}{''.join(where)}", DOUBLE if where else c_types.Row(length=kind.columns)
        if isinstance(kind, c_types.Row):
            return f"{text}[{self._place(node.slice)}]", DOUBLE
        if isinstance(kind, Column):
            return kind.at(self._place(node.slice)), DOUBLE
        place = only(self._known(node.slice), int)
        return f"{text}._{place}", only(kind, Tuple).parts[place]

    def _shape(self, node: ast.Subscript, array: ast.expr) -> Text:
        text, kind = self._expression(array)
        if isinstance(kind, Table) and self._known(node.slice) != 0:
            return str(kind.columns), INT
        return self._length(text, kind)

    def _length(self, text: str, kind: Kind) -> Text:
        """Print the number of rows of an array."""
        if isinstance(kind, Table):
            return f"{text[1:]}.rows" if text.startswith("&") else f"{text}->rows", INT
        length = only(kind, c_types.Row).length
        check(length >= 0)
        return str(length), INT

    def _known(self, node: ast.expr) -> int | None:
        """Return an integer that is known when printing; None for any other expression."""
        with self._apart() as lines:
            text, kind = self._expression(node)
        return int(text) if kind == INT and text.isdigit() and not lines else None

    def _place(self, node: ast.expr) -> str:
        text, kind = self._expression(node)
        check(kind == INT)
        return text

    def _each(self, function: Callable[..., Text], *parts: Text) -> Text:
        """Print an operation on numbers, or on columns number by number."""
        columns = [kind for _, kind in parts if isinstance(kind, Column)]
        if not columns:
            return function(*parts)
        return "", Column(columns[0].length, lambda k: function(*(
            (kind.at(k), DOUBLE) if isinstance(kind, Column) else (text, kind) for text, kind in parts))[0])

    def _binop(self, node: ast.BinOp) -> Text:
        def combined(one: Text, other: Text) -> Text:
            (left, first), (right, second), (sign, computed) = one, other, OPERATORS[type(node.op)]
            kind = INT if only(first, c_types.Scalar) == only(second, c_types.Scalar) == INT else DOUBLE
            check(not (isinstance(node.op, ast.Div) and kind == INT))
            if kind == INT and left.isdigit() and right.isdigit():
                return literal(computed(int(left), int(right)))
            return f"({left} {sign} {right})", kind
        return self._each(combined, self._expression(node.left), self._expression(node.right))

    def _unaryop(self, node: ast.UnaryOp) -> Text:
        if isinstance(node.op, ast.Not):
            text, kind = self._test(node.operand)
            return self._value(not kind.value) if isinstance(kind, Static) else (f"(!{text})", INT)
        check(isinstance(node.op, ast.USub))
        text, kind = self._number(node.operand)
        return f"(-{text})", kind

    def _boolop(self, node: ast.BoolOp) -> Text:
        deciding, sign = (False, "&&") if isinstance(node.op, ast.And) else (True, "||")
        texts = []
        for part in node.values:
            with self._apart() as lines:
                text, kind = self._test(part)
            if isinstance(kind, Static):
                if kind.value == deciding:
                    return str(int(deciding)), Static(deciding)
            else:
                check(not lines)
                texts.append(text)
        if not texts:
            return str(int(not deciding)), Static(not deciding)
        return texts[0] if len(texts) == 1 else f"({f' {sign} '.join(texts)})", INT

    def _namedexpr(self, node: ast.NamedExpr) -> Text:
        text, kind = self._number(node.value)
        self._declare(node.target.id, kind)
        return f"({word(node.target.id)} = {_bare(text)})", kind

    def _declare(self, name: str, kind: Kind) -> None:
        self._names.pop(name, None)
        check(not isinstance(kind, Static) and self._kinds.get(name, kind) == kind)
        if name not in self._kinds:
            self._locals[name] = kind
        self._kinds[name] = kind

    def _compare(self, node: ast.Compare) -> Text:
        if isinstance(node.ops[0], (ast.Is, ast.IsNot)):
            return self._absent(node.left, isinstance(node.ops[0], ast.Is))
        parts, left = list[Text](), node.left
        for sign, right in zip(node.ops, node.comparators):
            parts.append(self._compared(sign, self._expression(left), self._expression(right)))
            left = right.target if isinstance(right, ast.NamedExpr) else right
        if len(parts) == 1:
            return parts[0]
        return f"({' && '.join(text.removeprefix('(').removesuffix(')') for text, _ in parts)})", INT

    def _compared(self, sign: ast.cmpop, one: Text, other: Text) -> Text:
        (left, first), (right, second) = one, other
        if isinstance(first, Static) and isinstance(sign, (ast.In, ast.NotIn)) and isinstance(second, Items):
            return self._value((first in [kind for _, kind in second.parts]) == isinstance(sign, ast.In))
        if isinstance(first, Static) and isinstance(second, Static) and isinstance(sign, (ast.Eq, ast.NotEq)):
            return self._value((first == second) == isinstance(sign, ast.Eq))
        if isinstance(first, Struct) and first == second and isinstance(sign, ast.Eq) \
                and all(isinstance(kind, c_types.Scalar) for _, kind in first.fields):
            left = f"({left})" if left.startswith("&") else left
            return f"({' && '.join(f'{left}->{name} == ({right})->{name}' for name, _ in first.fields)})", INT
        if first == second == INT and left.isdigit() and right.isdigit():
            return self._value(OPERATORS[type(sign)][1](int(left), int(right)))
        check(isinstance(first, (c_types.Scalar, Column)) and isinstance(second, c_types.Scalar))
        return self._each(lambda each: (f"({each[0]} {OPERATORS[type(sign)][0]} {right})", INT), one)

    def _absent(self, node: ast.expr, absent: bool) -> Text:
        text, kind = self._expression(node)
        if isinstance(kind, Table) or (isinstance(kind, Tuple) and kind.optional):
            dot = "->" if isinstance(kind, Table) and not text.startswith("&") else "."
            return f"{'!' if absent else ''}{text.removeprefix('&')}{dot}has", INT
        return self._value((isinstance(kind, Static) and kind.value is None) == absent)

    def _ifexp(self, node: ast.IfExp) -> Text:
        """Print a conditional expression; only one branch if the condition is known."""
        test, static = self._test(node.test)
        if isinstance(static, Static):
            return self._expression(node.body if static.value else node.orelse)
        with self._apart() as lines:
            one = self._stored(*self._expression(node.body))
        with self._apart() as others:
            other = self._stored(*self._expression(node.orelse))
        kind = c_types.common_kind(one[1], other[1])
        if not (lines or others or isinstance(kind, Pointed)):
            return f"({test} ? {self._as(one, kind)} : {self._as(other, kind)})", kind
        name = self._variable(kind)
        for head, branch, part in ((f"if ({test}) {{", lines, one), ("} else {", others, other)):
            self._put(head)
            self._written += branch
            self._depth += 1
            self._assign_to(name, part, kind)
            self._depth -= 1
        self._put("}")
        return f"&{name}" if isinstance(kind, Pointed) else name, kind

    def _as(self, part: Text, wanted: Kind) -> str:
        """Print a number or a tuple as a value of another type."""
        text, kind = part
        if kind == wanted or (wanted == DOUBLE and kind == INT):
            return text
        if isinstance(wanted, c_types.Scalar) and isinstance(kind, Static) and (wanted == INT or kind.value is None):
            return text if wanted == INT else "0.0"
        if isinstance(wanted, Tuple) and wanted.optional:
            name = self._library.declared(wanted)
            if kind == Static(None):
                return f"({name}){{0{', 0.0' * len(wanted.parts)}}}"
            if isinstance(kind, Tuple) and kind.parts == wanted.parts and text.startswith("("):
                return f"({name}){{1, {text.partition('{')[2]}"
            if isinstance(kind, Tuple) and kind.parts == wanted.parts:
                return f"({name}){{1, {', '.join(f'{text}._{place}' for place in range(len(kind.parts)))}}}"
        raise c_types.Refused

    def _assign_to(self, place: str, part: Text, wanted: Kind) -> None:
        """Print the assignment of a value of a type, or of one that it holds, to a variable or field."""
        text, kind = self._stored(*part)
        if not isinstance(wanted, Pointed):
            self._put(f"{place} = {self._as((text, kind), wanted)};")
        elif kind == Static(None) and isinstance(wanted, Table):
            self._put(f"memset(&{place}, 0, sizeof {place});")
        else:
            check(kind == wanted)
            self._put(f"{place} = {target_of(text)};")

    def _tuple(self, node: ast.Tuple) -> Text:
        return "", Items(tuple(map(self._expression, node.elts)))

    def _items(self, node: ast.expr) -> list[Text]:
        """Return the parts of an expression that is a list or tuple, or a range."""
        if isinstance(node, ast.Call) and self._resolved(node.func) is range:
            bounds = [self._known(end) for end in node.args]
            return [(str(k), INT) for k in range(*(bound for bound in bounds if bound is not None))]
        return list(only(self._expression(node)[1], Items).parts)

    def _stored(self, text: str, kind: Kind) -> Text:
        """Return a value in the form in which C holds it: a tuple of numbers as a structure."""
        if isinstance(kind, Items) and kind.parts and all(isinstance(part, c_types.Scalar) for _, part in kind.parts):
            whole = Tuple(tuple(part for _, part in kind.parts))  # type: ignore[misc]
            return f"({self._library.declared(whole)}){{{', '.join(element for element, _ in kind.parts)}}}", whole
        return text, kind

    def _call(self, node: ast.Call) -> Text:
        """Print a call of a printed function, of C's own functions or of what arrays and NamedTuples have."""
        if isinstance(node.func, ast.Attribute):
            text, kind = self._expression(node.func.value)
            if not isinstance(kind, Static):
                return self._method(node, node.func.attr, text, kind)
        called = self._resolved(node.func)
        if called in self._arrays:
            return self._arrays[called](self, node)
        if isinstance(called, type) and hasattr(called, "_fields"):
            return self._built(node, self._library.structure(called), called)
        plain = inspect.unwrap(getattr(called, "py_func", called)) if callable(called) else called
        check(not node.keywords or inspect.isfunction(plain))
        if called in (int, float, bool, len):
            return self._converted(node, called)
        if called in (max, min, np.maximum) and len(node.args) > 1:
            printed, *others = map(self._number, node.args)
            for other in others:
                check(printed[1] == other[1])
                name = "maximum" if called is np.maximum and printed[1] == DOUBLE else (
                    f"{'min' if called is min else 'max'}_{c_types.kind_name(printed[1])}")
                printed = f"{name}({printed[0]}, {other[0]})", printed[1]
            return printed
        if called in FUNCTIONS:
            return self._each(lambda *parts: (f"{FUNCTIONS[called]}({', '.join(text for text, _ in parts)})", DOUBLE),
                              *map(self._expression, node.args))
        if called is math.isfinite:
            return f"isfinite({self._number(node.args[0])[0]})", INT
        if not inspect.isfunction(plain):
            raise c_types.Refused
        given = list[Text]()
        for argument in node.args:
            given += self._items(argument.value) if isinstance(argument, ast.Starred) else [
                self._stored(*self._expression(argument))]
        missing = [parameter for parameter in list(inspect.signature(plain).parameters.values())[len(given):]
                   if parameter.kind is not parameter.VAR_POSITIONAL]
        named = {word.arg: self._stored(*self._expression(word.value)) for word in node.keywords}
        given += [named.get(parameter.name) or self._value(parameter.default) for parameter in missing]
        return self._each(lambda *parts: self._called(plain, parts), *given)

    def _called(self, plain: Any, given: Sequence[Text]) -> Text:
        name, result = self._library.function(plain, tuple(kind for _, kind in given))
        if isinstance(result, (Static, Items)):
            return name, result
        return self._result(f"{name}({', '.join(text for text, kind in given if not isinstance(kind, Static))})",
                            result)

    def _method(self, node: ast.Call, name: str, text: str, kind: Kind) -> Text:
        """Print a call on a value: NamedTuple._replace, copy of an array, and max and min of a column."""
        if name == "_replace" and isinstance(kind, Struct):
            return self._built(node, kind, None, text)
        if name == "copy" and isinstance(kind, Table):
            return self._kept(text, kind)
        check(name in ("max", "min"))
        column = only(kind, Column)
        extreme, _ = self._kept(column.at("0"), DOUBLE)
        with self._loop(column.length) as k:
            self._put(f"{extreme} = {name}_double({extreme}, {column.at(k)});")
        return extreme, DOUBLE

    def _built(self, node: ast.Call, kind: Struct, called: type[Any] | None, copied: str = "") -> Text:
        """Print a new structure of a NamedTuple: from its parts, or a copy with other parts."""
        name, fields = self._variable(kind), dict(kind.fields)
        given = dict(zip(fields, map(self._expression, node.args)))
        given |= {str(word.arg): self._expression(word.value) for word in node.keywords}
        for field, value in (getattr(called, "_field_defaults", {}) if called else {}).items():
            given.setdefault(field, self._value(value))
        self._put(f"{name} = {target_of(copied)};" if copied else f"memset(&{name}, 0, sizeof {name});")
        if called:
            nothing = {field for field, part in given.items() if part[1] == Static(None)}
            self._library.absent[called] = self._library.absent.get(called, nothing) & nothing
        for field, part in given.items():
            if fields[field] == part[1] == Static(None):
                continue
            self._assign_to(f"{name}.{field}", part, fields[field])
        return f"&{name}", kind

    def _converted(self, node: ast.Call, called: Any) -> Text:
        """Print int and float of a number, and the length of a tuple or an array."""
        text, kind = self._expression(node.args[0])
        if called is not len:
            check(kind == (DOUBLE if called is float else INT))
            return text, kind
        return (str(len(kind.parts)), INT) if isinstance(kind, (Items, Tuple)) else self._length(text, kind)

    def _np_searchsorted(self, node: ast.Call) -> Text:
        """Print searchsorted(table[:, k], x, side="right")."""
        check([ast.unparse(keyword) for keyword in node.keywords] == ["side='right'"])
        table = only(self._expression(only(node.args[0], ast.Subscript).value)[1], Table)
        column = only(self._expression(node.args[0])[1], Column)
        return f"searched(&{column.at('0')}, {table.columns}, {column.length}, {self._number(node.args[1])[0]})", INT

    def _np_moveaxis(self, node: ast.Call) -> Text:
        text, kind = self._expression(node.args[0])
        check([ast.unparse(part) for part in node.args[1:]] == ["-1", "0"])
        return text, only(kind, c_types.Row)

    def _np_arange(self, node: ast.Call) -> Text:
        return "", Column(self._place(node.args[0]), lambda k: f"(double){k}")

    def _np_argmax(self, node: ast.Call) -> Text:
        kind = only(self._expression(node.args[0])[1], Column)
        index, _ = self._kept("0", INT)
        with self._loop(kind.length) as k:
            self._put(f"if {kind.at(k)} {{ {index} = {k}; break; }}")
        return index, INT

    def _np_zeros(self, node: ast.Call) -> Text:
        """Print a new array of zeros, (rows, columns), whose shape is known."""
        rows, columns = (only(self._known(side), int) for side in only(node.args[0], ast.Tuple).elts)
        name = self._variable(kind := Table(columns, rows))
        self._put(f"memset(&{name}, 0, sizeof {name});")
        self._put(f"{name}.has = 1;")
        self._put(f"{name}.rows = {rows};")
        return f"&{name}", kind

    def _resolved(self, node: ast.expr) -> Any:
        """Return the object that an expression names, or None."""
        kind = self._expression(node)[1]
        return kind.value if isinstance(kind, Static) else None

    _nodes: ClassVar[dict[type[ast.AST], Callable[[Function, Any], Text]]] = {
        ast.Constant: _constant, ast.Name: _name, ast.Attribute: _attribute, ast.Subscript: _subscript,
        ast.BinOp: _binop, ast.UnaryOp: _unaryop, ast.BoolOp: _boolop, ast.Compare: _compare, ast.IfExp: _ifexp,
        ast.NamedExpr: _namedexpr, ast.Tuple: _tuple, ast.Call: _call}
    _arrays: ClassVar[dict[Any, Callable[[Function, ast.Call], Text]]] = {
        np.searchsorted: _np_searchsorted, np.moveaxis: _np_moveaxis, np.zeros: _np_zeros,
        np.arange: _np_arange, np.argmax: _np_argmax}


def word(name: str) -> str:
    """Return a local name in C."""
    return f"{name}_" if name in TAKEN else name


def target_of(text: str) -> str:
    """Return the value at a pointer."""
    return text[1:] if text[0] in "&*" else f"*{text}"


def _bare(text: str) -> str:
    """Return a text without the one pair of parentheses that encloses it."""
    depth = 0
    for place, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return text[1:-1] if letter == ")" and place == len(text) - 1 else text
    return text


def literal(value: float) -> Text:
    """Return a number in C, exact to the last bit."""
    check(not math.isnan(value))
    if math.isinf(value):
        return ("INFINITY" if value > 0 else "(-INFINITY)"), DOUBLE
    text = repr(value)
    return (f"({text})" if value < 0 else text), INT if isinstance(value, int) else DOUBLE
