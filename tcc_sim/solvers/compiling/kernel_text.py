"""What a kernel can reach, function by function: the key of its compiled code, and how much there is to compile.

Two kernels in one file have keys of their own, and a change in a file that a kernel calls nothing of leaves its
compiled code as it is. Comments, docstrings and the places of lines do not count.
"""

from __future__ import annotations

import hashlib
import re
import sys
from enum import Enum
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

_PACKAGE = __name__.partition(".")[0]
_ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")
_PLAIN = (int, float, complex, str, bytes, type(None), np.generic, np.dtype)


class Reach:
    """The functions, constants and options that a function can reach, walked once.

    digest : SHA-256 of all of it, as hexadecimal digits
    seen : functions and modules among it
    size : bytes of bytecode, which the time of compiling follows
    """

    def __init__(self, function: FunctionType, *context: object) -> None:
        self.size, self._hash, self.seen = 0, hashlib.sha256(), {}  # type: ignore[var-annotated]
        self._add(sys.version_info[:2], *context)
        self._take(function, set())
        self.digest = self._hash.hexdigest()

    def _add(self, *words: object) -> None:
        """Take words into the digest, each with its length."""
        for word in words:
            data = word if isinstance(word, bytes) else repr(word).encode()
            self._hash.update(len(data).to_bytes(8, "little") + data)

    def _take(self, value: Any, names: set[str]) -> None:
        """Take what a name stands for; `names` are those that the function looks up, in modules too."""
        if isinstance(getattr(value, "py_func", None), FunctionType):
            self._add(sorted(map(repr, getattr(value, "options", {}).items())))
            value = value.py_func
        self._add(type(value).__name__)
        if isinstance(value, FunctionType | type | BuiltinFunctionType):
            self._add(value.__module__, value.__qualname__)
        if isinstance(value, FunctionType | ModuleType):
            key = id(value), isinstance(value, ModuleType) and tuple(sorted(names))
            if key in self.seen:
                return
            self.seen[key] = value
        if isinstance(value, FunctionType):
            names = self._code(value.__code__, value.__doc__)
            named = {name: value.__globals__[name] for name in sorted(names) if name in value.__globals__}
            cells = [cell.cell_contents for cell in value.__closure__ or ()]
            for item in (*named.items(), value.__defaults__, *cells):
                self._take(item, names)
        elif isinstance(value, ModuleType):  # Of one outside this package only kernels and numbers.
            self._add(value.__name__)
            own = value.__name__.startswith(_PACKAGE)
            for name in sorted(names & vars(value).keys()):
                item = vars(value)[name]
                if item is not value and (own or hasattr(item, "py_func") or isinstance(item, _PLAIN)):
                    self._take((name, item), names)
        elif isinstance(value, tuple | list):
            self._add(len(value))
            for item in value:
                self._take(item, names)
        elif isinstance(value, np.ndarray):
            self._add(value.dtype, value.shape, value.tobytes())
        elif isinstance(value, type):
            self._add(list(value) if issubclass(value, Enum) else getattr(value, "_fields", ()))
        elif not isinstance(value, BuiltinFunctionType):
            self._add(value if isinstance(value, _PLAIN) else _ADDRESS.sub("", repr(value)))
            file = getattr(sys.modules.get(type(value).__module__), "__file__", None)
            if type(value).__module__.startswith(_PACKAGE) and file is not None:  # What its class does.
                self._add(Path(file).read_bytes())

    def _code(self, code: CodeType, documentation: str | None = None) -> set[str]:
        """Take the instructions and constants of a code object; the names that it looks up."""
        self.size += len(code.co_code)
        self._add(code.co_code, code.co_names, code.co_varnames, code.co_freevars)
        names = set(code.co_names)
        for number, constant in enumerate(code.co_consts):
            if isinstance(constant, CodeType):
                names |= self._code(constant)
            elif number or constant != documentation:
                self._add(constant)
        return names
