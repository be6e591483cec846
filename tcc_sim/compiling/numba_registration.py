"""Registration of kernels and staged functions with Numba, by its interface for extensions."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import FunctionType
from typing import Any

import numba
from numba import types
from numba.core.types.misc import unliteral
from numba.core.typing import signature
from numba.core.typing.templates import AbstractTemplate
from numba.extending import lower_builtin, typeof_impl

from tcc_sim.compiling.unrolled import Unrolled


def registered(function: FunctionType, options: dict[str, Any], **how: Any) -> Any:
    """Return Numba's dispatcher of a function, whose types do not depend on the values of literal numbers.

    Every option that a function would inherit from whoever calls it first is stated: its code is its own.
    """
    stated = {"nogil": True, "error_model": "numpy", "fastmath": False, "forceinline": False, **options}
    out = numba.njit(function, **how, **stated)
    template = out.get_call_template
    out.get_call_template = lambda kinds, names: template(
        tuple(map(unliteral, kinds)), {name: unliteral(kind) for name, kind in names.items()})
    return out


def address_for_c(function: Callable[..., None], signature: Any) -> tuple[int, object]:
    """Compile a function that C code calls; return its address, and an object that must live as long as it is used."""
    made = numba.cfunc(signature, nopython=True, error_model="numpy")(function)
    return int(made.address), made


@typeof_impl.register(Unrolled)  # type: ignore[untyped-decorator]
def _(staged: Unrolled, _context: Any) -> Any:
    return _typed(staged)


@cache
def _typed(staged: Unrolled) -> Any:
    """Return the type of a staged function, which runs while compiling."""
    class Template(AbstractTemplate):  # type: ignore[misc]
        key = staged

        def generic(self, kinds: Any, _names: Any) -> Any:
            return signature(types.void, *kinds)

    lower_builtin(staged, types.VarArg(types.Any))(staged.write)
    return types.Function(Template)
