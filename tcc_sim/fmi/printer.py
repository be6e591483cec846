"""Print C99 from the Python source of a kernel: the functions that Numba compiles, and their callees.

An unknown construct is refused, so a kernel that cannot be printed fails the tests of the FMU. Operations are printed
in Python's order with parentheses, so that IEEE arithmetic without fused products gives the same bits. A term that may
be None is a flag at run time.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import textwrap
from collections import Counter
from collections.abc import Callable
from typing import Any

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
    size_of,
    stored_name,
    struct_of,
)
from tcc_sim.fmi.expressions import Expressions, Text, enclosed, target_of, word

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
return low; }
static int unique(double *at, int n) \
{ int count = 0; for (int k = 0; k < n; k++) { double x = at[k]; int j = count; \
while (j > 0 && at[j - 1] > x) j--; if (j > 0 && at[j - 1] == x) continue; \
memmove(at + j + 1, at + j, (size_t)(count - j) * sizeof *at); at[j] = x; count++; } return count; }"""
LARGE = 16384
"""Size of a variable, bytes, beyond which it is not on the stack, which TCC_LARGE says in C. No function calls itself.
"""
Signature = tuple[Any, tuple[Kind, ...]]


class Library:
    """Functions printed so far, each after those that it calls, and the structures that they need.

    Parameters
    ----------
    data : properties `Class.name` of scenes that Python evaluates, since C cannot: their values are printed
    given : functions that others stand for, or that are printed elsewhere, with name and type of the result

    Attributes
    ----------
    structures : types of NamedTuples; those whose arrays have sizes are put in
    absent : fields of NamedTuples that are None wherever one is made
    """

    def __init__(self, data: frozenset[str] = frozenset(), given: dict[Any, Any] | None = None) -> None:
        self.texts: list[str] = []
        self.structures: dict[type[Any], Struct] = {}
        self.absent: dict[type[Any], set[str]] = {}
        self.data, self._given = data, given or {}
        self._declarations: dict[str, str] = {}
        self._done: dict[Signature, Text] = {}
        self._names: set[str] = set()

    def function(self, source: Any, kinds: tuple[Kind, ...]) -> Text:
        """Return name and result type of a function for arguments of these types, and print it at the first call.

        A result that is known, such as None, has its own text in place of a name.

        Raises
        ------
        Refused
            Its source has a construct without a form in C.
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

    def entry(self, name: str, source: Any, *kinds: Kind) -> Kind:
        """Print a function that other C calls by a name of its own, and return the type of its result."""
        printed, result = self.function(source, kinds)
        if isinstance(result, (Static, Items)):
            raise Refused(f"{name} has no result at run time")
        if printed != name:
            self.texts.append(f"#define {name} {printed}")
        return result

    def structure(self, source: type[Any]) -> Struct:
        """Return the structure of a NamedTuple."""
        if source not in self.structures:
            self.structures[source] = struct_of(source, {}, {})
        return self.structures[source]

    def declared(self, kind: Kind) -> str:
        """Declare the structure of a type and return the type's name."""
        if isinstance(kind, Struct):
            for _, part in kind.fields:
                if not isinstance(part, Static):
                    self.declared(part)
        if isinstance(kind, (Tuple, Table, Struct)):
            self._declarations.setdefault(kind.name, kind.declaration())
        return kind_name(kind)

    def text(self) -> str:
        """Return everything printed so far."""
        used = "\n".join(self.texts)
        prelude = [line for line in PRELUDE.splitlines() if line.split("(")[0].split()[-1] + "(" in used]
        return "\n\n".join(["\n".join(self._declarations.values()), "\n".join(prelude), *self.texts]) + "\n"


class Function(Expressions):
    """Function for arguments of given types, printed as `lines`, with the type of its result.

    Parameters
    ----------
    result : type that holds every result; None: the first one's, or what holds all if they differ

    Attributes
    ----------
    text : the result, if it is known when the C is printed
    """

    def __init__(self, library: Library, source: Callable[..., Any], name: str, kinds: tuple[Kind, ...],
                 result: Kind | None = None) -> None:
        tree = ast.parse(textwrap.dedent(inspect.getsource(source))).body[0]
        if not isinstance(tree, ast.FunctionDef):
            raise Refused(f"{source.__name__} is no plain function")
        parameters = [argument.arg for argument in tree.args.args]
        more = range(len(kinds) - len(parameters)) if tree.args.vararg else ()
        further = [f"{tree.args.vararg.arg}_{k}" for k in more]  # type: ignore[union-attr]
        given = list(zip([*parameters, *further], kinds))
        super().__init__(library, source, {parameter: kind for parameter, kind in given if kind})
        for parameter, kind in given:
            if isinstance(kind, Static):
                self._names[parameter] = str(int(bool(kind.value))), kind
        if tree.args.vararg:
            self._names[tree.args.vararg.arg] = "", Items(tuple((word(one), self._kinds[one]) for one in further))
        self.text, self._wanted, self._returned = "", result, list[Kind]()
        self._stores = Counter(part.id for part in ast.walk(tree) if isinstance(part, ast.Name)
                               and isinstance(part.ctx, ast.Store))
        self._block(tree.body)
        if not self._returned:
            raise self._refused(tree)
        whole: Kind | None = self._returned[0]
        for kind in self._returned[1:]:
            whole = common_kind(whole, kind) if whole is not None else None
        if whole is None:
            raise Refused(f"{source.__name__}: its results are of several types")
        self.result: Kind = whole
        if isinstance(whole, (Static, Items)):
            return
        library.declared(whole)
        head = [f"{library.declared(kind)} {word(parameter)}".replace("* ", "*") for parameter, kind in given
                if not isinstance(kind, Static)]
        pointed = isinstance(whole, (Table, Struct))
        head += [f"{stored_name(whole)} *made"] if pointed else []
        used = set(re.findall(r"\w+", " ".join(self._written)))
        unused = [f"    (void){word(parameter)};" for parameter, kind in given
                  if not isinstance(kind, Static) and word(parameter) not in used]
        declarations: dict[str, list[str]] = {}
        for local, kind in self._locals.items():
            library.declared(kind)
            stored = isinstance(kind, Row)
            large = "TCC_LARGE " if size_of(kind) > LARGE else ""
            declarations.setdefault(large + ("double" if stored else stored_name(kind)), []).append(
                word(local) + (f"[{kind.length}]" if isinstance(kind, Row) else ""))
        written = [textwrap.fill(f"{kind} {', '.join(names)};".replace("* ", "*"), 110, initial_indent="    ",
                                 subsequent_indent="        ") for kind, names in declarations.items()]
        self.lines: str = "\n".join([
            f"static {'void' if pointed else stored_name(whole)} {name}({', '.join(head)})", "{", *written, *unused,
            *self._written, "}"])

    def _block(self, body: list[ast.stmt]) -> bool:
        """Print statements up to a return, and return whether there was one."""
        return any(self._statement(node) for node in body)

    def _nested(self, head: str, body: list[ast.stmt]) -> None:
        self._put(head)
        self._depth += 1
        self._block(body)
        self._depth -= 1

    def _statement(self, node: ast.stmt) -> bool:
        """Print a statement of any kind; return whether it is a return."""
        if isinstance(node, (ast.Assert, ast.Pass)) or (
                isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            return False
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            self._assign(node.targets[0], node.value)
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            self._assign(node.target, node.value)
        elif isinstance(node, ast.AugAssign):
            target = ast.parse(ast.unparse(node.target), mode="eval").body
            self._assign(node.target, ast.BinOp(target, node.op, node.value))
        elif isinstance(node, ast.If):
            return self._if(node)
        elif isinstance(node, ast.While) and not node.orelse:
            self._nested(f"while ({_bare(self._number(node.test)[0])}) {{", node.body)
            self._put("}")
        elif isinstance(node, ast.For):
            self._for(node)
        elif isinstance(node, ast.Break):
            self._put("break;")
        elif isinstance(node, ast.ImportFrom):
            module = importlib.import_module(str(node.module))
            self._globals |= {alias.asname or alias.name: getattr(module, alias.name) for alias in node.names}
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call) and isinstance(
                node.value.func, ast.Attribute) and node.value.func.attr == "append" and not self._depth:
            owner = node.value.func.value
            parts = (*self._items(owner), self._expression(node.value.args[0]))
            self._bind(owner, ("", Items(parts)))
        elif isinstance(node, ast.Return) and node.value is not None:
            self._return(node)
            return True
        else:
            raise self._refused(node)
        return False

    def _return(self, node: ast.Return) -> None:
        assert node.value is not None
        text, kind = self._stored(*self._expression(node.value))
        self._returned.append(kind)
        wanted = self._wanted if self._wanted is not None else kind
        self.text = text
        if isinstance(wanted, (Static, Items, Vector)) or (self._wanted is None and isinstance(kind, Static)):
            return
        if not isinstance(wanted, (Table, Struct)):
            text = self._as((text, kind), wanted, node)
        elif kind == wanted:
            self._put(f"*made = {target_of(text)};")
            text = ""
        else:
            raise self._refused(node)
        self._put(f"return {text};".replace(" ;", ";"))

    def _for(self, node: ast.For) -> None:
        """Print a loop: unrolled if its items are known, and over whole numbers otherwise."""
        leaves = any(isinstance(part, ast.Break) for part in ast.walk(node))
        is_range = isinstance(node.iter, ast.Call) and self._resolved(node.iter.func) is range
        if not is_range or (not leaves and isinstance(node.iter, ast.Call)
                            and all(self._known(end) is not None for end in node.iter.args)):
            for part in self._items(node.iter):
                self._bind(node.target, part)
                self._block(node.body)
            return
        if not isinstance(node.iter, ast.Call) or len(node.iter.args) != 1 or not isinstance(node.target, ast.Name):
            raise self._refused(node)
        end, name = self._place(node.iter.args[0]), word(node.target.id)
        self._declare(node.target.id, INT, node)
        self._nested(f"for ({name} = 0; {name} < {end}; {name}++) {{", node.body)
        self._put("}")

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
            if not isinstance(kind, Tuple):
                raise self._refused(value)
            parts = [(f"{text}._{place}", part) for place, part in enumerate(kind.parts)]
        if len(parts) != len(target.elts):
            raise self._refused(target)
        for name, (text, kind) in zip(target.elts, parts):
            if not (isinstance(name, ast.Name) and name.id == "_"):
                self._store(name, text, kind)

    def _store(self, target: ast.expr, text: str, kind: Kind) -> None:
        """Store a value in a variable or an array; a name stands for what is known or points somewhere."""
        text, kind = self._stored(text, kind)
        if isinstance(target, ast.Name) and isinstance(kind, Static) and isinstance(kind.value, bool) \
                and self._stores[target.id] > 1:
            kind = INT
        if isinstance(target, ast.Name) and isinstance(kind, (Static, Items, Keys, Row, Vector, Table, Struct)):
            if self._depth:
                raise self._refused(target)
            self._bind(target, (text, kind))
        elif isinstance(target, ast.Name):
            if kind == INT and self._kinds.get(target.id) == DOUBLE:
                kind = DOUBLE
            self._declare(target.id, kind, target)
            self._put(f"{word(target.id)} = {_bare(text)};")
        elif isinstance(target, ast.Subscript) and any(isinstance(part, ast.Slice) for part in ast.walk(target.slice)):
            self._fill(target, text, kind)
        elif isinstance(target, ast.Subscript) and isinstance(kind, Scalar):
            self._put(f"{self._subscript(target)[0]} = {text};")
        else:
            raise self._refused(target)

    def _fill(self, target: ast.Subscript, text: str, kind: Kind) -> None:
        """Store a number, or the numbers of an array, in a column."""
        column = self._subscript(target)[1]
        if not isinstance(column, Vector) or not isinstance(kind, (Scalar, Row, Vector)):
            raise self._refused(target)
        with self._loop(column.length) as k:
            self._put(f"{column.at(k)} = {text if isinstance(kind, Scalar) else self._vector(text, kind).at(k)};")


def _bare(text: str) -> str:
    """Return a text without parentheses around it."""
    return text[1:-1] if enclosed(text) else text
