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
    size : bytes of bytecode, which the time of compiling follows
    """

    def __init__(self, function: FunctionType, *context: object) -> None:
        self.size = 0
        self._hash = hashlib.sha256()
        self._seen: dict[object, object] = {}
        self._add(sys.version_info[:2], *context)
        self._function(function)
        self.digest = self._hash.hexdigest()

    def _add(self, *words: object) -> None:
        """Take words into the digest, each with its length."""
        for word in words:
            data = word if isinstance(word, bytes) else repr(word).encode()
            self._hash.update(len(data).to_bytes(8, "little") + data)

    def _function(self, function: FunctionType) -> None:
        """Take a function with everything that its names mean."""
        self._add(function.__module__, function.__qualname__)
        if id(function) in self._seen:
            return
        self._seen[id(function)] = function
        names = sorted(self._code(function.__code__, function.__doc__))
        self._value("defaults", function.__defaults__, names)
        for name in names:
            if name in function.__globals__:
                self._value(name, function.__globals__[name], names)
        for name, cell in zip(function.__code__.co_freevars, function.__closure__ or ()):
            self._value(name, cell.cell_contents, names)

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

    def _value(self, name: str, value: Any, names: list[str]) -> None:
        """Take what a name stands for."""
        self._add(name)
        function = getattr(value, "py_func", None) or getattr(value, "_defn", None)
        if isinstance(function, FunctionType):
            self._add(sorted(map(repr, getattr(value, "targetoptions", {}).items())))
            self._function(function)
        elif isinstance(value, FunctionType):
            self._function(value)
        elif isinstance(value, ModuleType):
            self._module(value, names)
        elif isinstance(value, _PLAIN):
            self._add(type(value).__name__, value)
        elif isinstance(value, tuple | list):
            self._add(type(value).__name__, len(value))
            for item in value:
                self._value("", item, names)
        elif isinstance(value, np.ndarray):
            self._add(value.dtype, value.shape, value.tobytes())
        elif isinstance(value, type):
            fields = list(value) if issubclass(value, Enum) else getattr(value, "_fields", ())
            self._add(value.__module__, value.__qualname__, fields)
        elif isinstance(value, BuiltinFunctionType):
            self._add(value.__module__, value.__qualname__)
        else:
            self._add(type(value).__qualname__, _ADDRESS.sub("", repr(value)))
            self._file(type(value).__module__)

    def _module(self, module: ModuleType, names: list[str]) -> None:
        """Take what the names mean in a module; of one outside this package only kernels and numbers."""
        key = module.__name__, tuple(names)
        self._add(module.__name__)
        if key in self._seen:
            return
        self._seen[key] = module
        own = module.__name__.startswith(_PACKAGE)
        for name in names:
            value = vars(module).get(name, module)
            if value is not module and (own or hasattr(value, "py_func") or isinstance(value, _PLAIN)):
                self._value(name, value, names)

    def _file(self, module: str) -> None:
        """Take the whole text of a module of this package, where an object of another kind comes from it."""
        file = getattr(sys.modules.get(module), "__file__", None)
        if module.startswith(_PACKAGE) and file is not None:
            self._add(Path(file).read_bytes())
