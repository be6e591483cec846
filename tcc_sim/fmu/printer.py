"""Print C99 from the Python source of a kernel: the functions that Numba compiles, and their callees.

An unknown construct is refused, so a kernel that cannot be printed fails the tests of the FMU. Operations are printed
in Python's order with parentheses, so that IEEE arithmetic without fused products gives the same bits. A term that may
be None is a flag at run time: one text is valid for every scene, with the arithmetic of its compiled kernel.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Callable
from typing import Any

from tcc_sim.fmu.c_types import DOUBLE, INT, Kind, Refused, Scalar, Static, Struct, Table, Tuple, kind_name
from tcc_sim.fmu.expressions import Expressions, Text, word

PRELUDE = """\
static double sign_of(double x) { return x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : x; }
static double maximum(double a, double b) { return a != a ? a : b != b ? b : a > b ? a : b; }
static double max_double(double a, double b) { return a > b ? a : b; }
static double min_double(double a, double b) { return a < b ? a : b; }
static int max_int(int a, int b) { return a > b ? a : b; }
static int min_int(int a, int b) { return a < b ? a : b; }
static int searched(const double *at, int stride, int n, double x) \
{ int low = 0; while (low < n) { int k = (low + n) / 2; if (at[k * stride] <= x) low = k + 1; else n = k; } \
return low; }"""
Signature = tuple[Any, tuple[Kind, ...]]


class Library:
    """Functions printed so far, each after those that it calls, and the structures that they need."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.structures: dict[str, str] = {}
        self._done: dict[Signature, tuple[str, Kind]] = {}
        self._names: set[str] = set()

    def function(self, source: Any, kinds: tuple[Kind, ...]) -> tuple[str, Kind]:
        """Return name and result type of a function for arguments of these types, and print it at the first call.

        Raises
        ------
        Refused
            Its source has a construct without a form in C.
        """
        plain = getattr(source, "py_func", source)
        key = plain, kinds
        if key not in self._done:
            name = f"tcc_{plain.__name__.strip('_')}"
            while name in self._names:
                name += "_"
            self._names.add(name)
            printed = Function(self, plain, name, kinds)
            self._done[key] = name, printed.result
            self.texts.append(printed.lines)
        return self._done[key]

    def declared(self, kind: Kind) -> str:
        """Declare the structure of a type and return the type's name."""
        if isinstance(kind, Struct):
            for _, part in kind.fields:
                self.declared(part)
        if isinstance(kind, (Tuple, Table, Struct)):
            self.structures.setdefault(kind.name, kind.declaration())
        return kind_name(kind)

    def text(self) -> str:
        """Return everything printed so far."""
        used = "\n".join(self.texts)
        prelude = [line for line in PRELUDE.splitlines() if line.split("(")[0].split()[-1] + "(" in used]
        return "\n\n".join(["\n".join(self.structures.values()), "\n".join(prelude), *self.texts]) + "\n"


class Function(Expressions):
    """Function for arguments of given types, printed as `lines`, with the type of its result."""

    def __init__(self, library: Library, source: Callable[..., Any], name: str, kinds: tuple[Kind, ...]) -> None:
        tree = ast.parse(textwrap.dedent(inspect.getsource(source))).body[0]
        if not isinstance(tree, ast.FunctionDef):
            raise Refused(f"{source.__name__} is no plain function")
        parameters = [argument.arg for argument in tree.args.args]
        super().__init__(library, source, dict(zip(parameters, kinds)))
        self._locals: dict[str, Kind] = {}
        self._written: list[str] = []
        self._depth, self._fresh = 0, 0
        self._result: Kind | None = None
        self._block(tree.body)
        if self._result is None:
            raise self._refused(tree)
        self.result: Kind = self._result
        head = ", ".join(f"{library.declared(kind)} {word(parameter)}" for parameter, kind in zip(parameters, kinds)
                         if not isinstance(kind, Static)).replace("* ", "*")
        used = set(re.findall(r"\w+", " ".join(self._written)))
        unused = [f"    (void){word(parameter)};" for parameter, kind in zip(parameters, kinds)
                  if not isinstance(kind, Static) and word(parameter) not in used]
        declarations: dict[str, list[str]] = {}
        for local, kind in self._locals.items():
            declarations.setdefault(library.declared(kind), []).append(word(local))
        written = [textwrap.fill(f"{kind} {', '.join(names)};".replace("* ", "*"), 110, initial_indent="    ",
                                 subsequent_indent="        ") for kind, names in declarations.items()]
        self.lines: str = "\n".join([f"static {library.declared(self.result)} {name}({head})", "{", *written,
                                     *unused, *self._written, "}"])

    def _block(self, body: list[ast.stmt]) -> None:
        """Print statements up to a return."""
        for node in body:
            self._statement(node)
            if isinstance(node, ast.Return):
                break

    def _nested(self, head: str, body: list[ast.stmt]) -> None:
        """Print a nested block."""
        self._put(head)
        self._depth += 1
        self._block(body)
        self._depth -= 1

    def _put(self, text: str) -> None:
        """Add a line."""
        self._written.append("    " * (self._depth + 1) + text)

    def _statement(self, node: ast.stmt) -> None:
        """Print a statement of any kind."""
        if isinstance(node, (ast.Assert, ast.Pass)) or (
                isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            return
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            self._assign(node.targets[0], node.value)
        elif isinstance(node, ast.AugAssign):
            target = ast.parse(ast.unparse(node.target), mode="eval").body
            self._assign(node.target, ast.BinOp(target, node.op, node.value))
        elif isinstance(node, ast.If):
            self._if(node)
        elif isinstance(node, ast.While) and not node.orelse:
            self._nested(f"while ({self._number(node.test)[0]}) {{", node.body)
            self._put("}")
        elif isinstance(node, ast.For) and isinstance(node.target, ast.Name) and isinstance(node.iter, ast.Call) \
                and None not in (bounds := [self._known(end) for end in node.iter.args]):
            for place in range(*(bound for bound in bounds if bound is not None)):
                self._kinds[node.target.id] = Static(place)
                self._block(node.body)
        elif isinstance(node, ast.For) and isinstance(node.target, ast.Name) and isinstance(node.iter, ast.Call) \
                and ast.unparse(node.iter.func) == "range" and len(node.iter.args) == 1:
            end, name = self._place(node.iter.args[0]), word(node.target.id)
            self._declare(node.target.id, INT, node)
            self._nested(f"for ({name} = 0; {name} < {end}; {name}++) {{", node.body)
            self._put("}")
        elif isinstance(node, ast.Break):
            self._put("break;")
        elif isinstance(node, ast.Return) and node.value is not None:
            text, kind = self._expression(node.value)
            if self._result not in (None, kind):
                raise self._refused(node)
            self._result = kind
            self._put(f"return {text};")
        else:
            raise self._refused(node)

    def _if(self, node: ast.If) -> None:
        """Print a condition; only one branch if it is known."""
        test, kind = self._expression(node.test)
        if isinstance(kind, Static):
            self._block(node.body if kind.value else node.orelse)
            return
        self._nested(f"if ({test.removeprefix('(').removesuffix(')') if _enclosed(test) else test}) {{", node.body)
        if node.orelse:
            self._nested("} else {", node.orelse)
        self._put("}")

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
            if not isinstance(kind, Tuple):
                raise self._refused(value)
            parts = [(f"{text}._{place}", part) for place, part in enumerate(kind.parts)]
        if len(parts) != len(target.elts):
            raise self._refused(target)
        for name, (text, kind) in zip(target.elts, parts):
            if not (isinstance(name, ast.Name) and name.id == "_"):
                self._store(name, text, kind)

    def _kept(self, text: str, kind: Kind) -> Text:
        """Store a value in a new variable."""
        if isinstance(kind, Static):
            return text, kind
        self._fresh += 1
        name = f"part_{self._fresh}"
        self._locals[name] = self._kinds[name] = kind
        self._put(f"{name} = {text};")
        return name, kind

    def _store(self, target: ast.expr, text: str, kind: Kind) -> None:
        """Store a value in a variable or an array."""
        if isinstance(kind, Static) and isinstance(kind.value, bool):
            kind = INT
        if isinstance(target, ast.Name):
            if kind == INT and self._kinds.get(target.id) == DOUBLE:
                kind = DOUBLE
            self._declare(target.id, kind, target)
            self._put(f"{word(target.id)} = {text[1:-1] if _enclosed(text) else text};")
        elif isinstance(target, ast.Subscript) and isinstance(kind, Scalar):
            self._put(f"{self._subscript(target)[0]} = {text};")
        else:
            raise self._refused(target)

    def _declare(self, name: str, kind: Kind, node: ast.AST) -> None:
        """Declare a variable, whose type cannot change."""
        if isinstance(kind, Static) or self._kinds.get(name, kind) != kind:
            raise self._refused(node)
        if name not in self._kinds:
            self._locals[name] = kind
        self._kinds[name] = kind


def _enclosed(text: str) -> bool:
    """Return whether one pair of parentheses encloses a text."""
    depth = 0
    for place, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return letter == ")" and place == len(text) - 1
    return False
