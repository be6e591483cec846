"""Kernels and staged functions as the Python functions that they are compiled from, with all that they reach."""

from __future__ import annotations

from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.compiling.compiled import Kernel
from tcc_sim.compiling.unrolled import Unrolled

_known: dict[int, Any] = {}


class Rows(np.ndarray[Any, Any]):
    """An array that staged functions read and write by rows."""

    def row(self, *key: int, count: int = 0) -> NDArray[np.float64]:
        """Return `count` numbers from an entry on, or a whole row."""
        place = key[-1] if len(key) == self.ndim else 0
        whole = np.asarray(self[key[:self.ndim - 1]])
        return whole[place:place + count if count else None].copy()

    def set_row(self, value: Any, *key: int) -> None:
        """Write a row of numbers from an entry on."""
        place, value = key[-1] if len(key) == self.ndim else 0, np.asarray(value)
        np.asarray(self[key[:self.ndim - 1]])[place:place + len(value)] = value


class _Module:
    """A module whose kernels are Python functions."""

    def __init__(self, module: ModuleType) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        return plain(getattr(self._module, name))


def _names(code: CodeType) -> set[str]:
    """Names that a function and those in it look up."""
    return set(code.co_names).union(*(_names(each) for each in code.co_consts if isinstance(each, CodeType)))


def plain(value: Any) -> Any:
    """Return the Python function of a kernel, of a staged function, or of another one of the package; other objects as
    they are.
    """
    if isinstance(value, ModuleType) and value.__name__.startswith("tcc_sim"):
        return _Module(value)
    if isinstance(value, Unrolled):
        staged = plain(value.py_func)

        def run(order: int, *arguments: Any) -> None:
            given = [a.view(Rows) if isinstance(a, np.ndarray) else a for a in arguments]
            next((k for k in staged(*given) or () if order <= k), None)

        return run
    function = value.py_func if isinstance(value, Kernel) else value
    if not isinstance(function, FunctionType) or not function.__module__.startswith("tcc_sim"):
        return value
    if id(function) not in _known:
        names = dict(function.__globals__)
        _known[id(function)] = FunctionType(function.__code__, names, function.__name__, function.__defaults__,
                                            function.__closure__)
        names.update({name: plain(names[name]) for name in _names(function.__code__) & names.keys()})
    return _known[id(function)]
