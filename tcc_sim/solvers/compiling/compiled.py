"""The one place that compiles: Numba, with compiled code kept on disk under the text of what each kernel can call.

Numba's own cache looks only at the file of the function itself, so a change in a file that it calls would be missed.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba.core.types.misc import unliteral

from tcc_sim.model import course, equations, friction
from tcc_sim.solvers.compiling.kernel_cache import KernelCache

try:
    from tcc_sim.solvers.compiling.linked import OWN_TEXT, PartCompiler, WholeCompiler
except ImportError:  # Numba has moved what it calls its own.
    OWN_TEXT, PartCompiler, WholeCompiler = "", None, None  # type: ignore[assignment,misc]

if os.environ.get("TCC_SIM_COMMAND") and "scipy.linalg" not in sys.modules:
    # Numba loads SciPy's linear algebra where it is there: 0.2 s of every command, and no kernel multiplies matrices.
    sys.modules["scipy.linalg"] = None  # type: ignore[assignment]
    try:
        import numba.np.arraymath
    finally:
        del sys.modules["scipy.linalg"]

Function = TypeVar("Function", bound=Callable[..., object])

TESTED = (0, 57), (0, 68)
"""First and last version of Numba whose inner parts `linked` is known to fit; beyond, kernels are compiled as Numba
compiles any function, which takes about twice as long."""
LINKED = WholeCompiler is not None and TESTED[0] <= tuple(map(int, numba.__version__.split(".")[:2])) <= TESTED[1]


def compiled(function: Function, linked: bool = LINKED, **options: bool) -> Function:
    """Compile on first call for the argument types given; None arguments leave their branches out.

    The compiled code is kept on disk between processes (`kernel_cache`), releases the interpreter lock, and keeps IEEE
    arithmetic. Called from another compiled function it is a part of that (`linked`).
    """
    numba_options: dict[str, Any] = {"nogil": True, "error_model": "numpy", **options}
    how = {"pipeline_class": WholeCompiler} if linked else {}
    dispatcher = numba.njit(function, **how, **numba_options)
    if dispatcher is function:  # NUMBA_DISABLE_JIT gives the function back as it is.
        return function
    dispatcher._cache = KernelCache(function, options, OWN_TEXT if linked else "")  # type: ignore[arg-type]
    if linked:
        part = numba.njit(function, pipeline_class=PartCompiler, **numba_options)
        dispatcher.get_call_template = lambda kinds, names: part.get_call_template(
            tuple(map(unliteral, kinds)), {name: unliteral(kind) for name, kind in names.items()})
        dispatcher.get_overload = part.get_overload
    return cast(Function, dispatcher)


def compiled_without_allocation(function: Function) -> Function:
    """`compiled` for functions that create no array: their arguments are not reference-counted.

    Numba counts with atomic instructions at every call, a good part of the time of a kernel made of short functions.
    """
    return compiled(function, _nrt=False)


def fast(function: Function) -> Function:
    """`compiled_without_allocation`, with products and sums fused where the processor can."""
    return compiled(function, _nrt=False, fastmath={"contract"})  # type: ignore[arg-type]


smoothed = compiled(friction.smoothed)
smoothed_and_slope = compiled(friction.smoothed_and_slope)
sliding = compiled(friction.sliding)
engine_torque = compiled(equations.engine_torque)
saturation_torque = compiled(equations.saturation_torque)
accelerations = compiled(equations.accelerations)
interface_torque = compiled(equations.interface_torque)
reached = compiled(course.reached)
