"""The one place that compiles: Numba with a disk cache keyed on the text of everything a kernel can call.

Numba's own cache looks only at the file of the function itself, so a change in a file that it calls would be missed.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TypeVar, cast

import numba
from numba.core import config

from tcc_sim.model import equations, friction

Function = TypeVar("Function", bound=Callable[..., object])


@cache
def _cache_directory() -> str:
    """Where kernels of exactly this source text are kept: a folder of the user's cache."""
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(numba.__version__.encode())
    for part in ("model", "solvers"):
        for file in sorted((package / part).rglob("*.py")):
            digest.update(file.name.encode())
            digest.update(file.read_bytes())
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return str(base / "tcc_sim" / digest.hexdigest()[:16])


def compiled(function: Function, **options: bool) -> Function:
    """Compile on first call for the argument types given; None arguments leave their branches out.

    The compiled code is cached on disk between processes, releases the interpreter lock, and keeps IEEE arithmetic.
    """
    before = config.CACHE_DIR
    if not before:
        config.CACHE_DIR = _cache_directory()
    try:
        return cast(Function, numba.njit(function, cache=True, nogil=True, error_model="numpy", **options))
    finally:
        config.CACHE_DIR = before


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
