"""The processor that kernels are compiled for: a level of x86-64 that many processors share, else the present one."""

from __future__ import annotations

import os
from functools import cache
from typing import NamedTuple

from llvmlite import binding

LEVEL = "x86-64-v3"
NEEDED = "avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"
"""LLVM's names of the features of LEVEL that earlier levels lack (x86-64 psABI, Table 3.1)."""


class Processor(NamedTuple):
    """A target of the compiler.

    triple : LLVM's name of architecture and system
    name : LLVM's name of the processor
    features : further features, as LLVM takes them
    """

    triple: str
    name: str
    features: str


@cache
def processor() -> Processor:
    """Return LEVEL where the present processor has it, so that code serves other machines too: kernels are as fast as
    those for the very processor, and have the same bits. NUMBA_CPU_NAME and NUMBA_CPU_FEATURES choose another target.
    """
    triple, features = binding.get_process_triple(), binding.get_host_cpu_features()
    named, given_features = os.environ.get("NUMBA_CPU_NAME", ""), os.environ.get("NUMBA_CPU_FEATURES", "")
    if named or given_features:
        return Processor(triple, named or binding.get_host_cpu_name(), given_features)
    if triple.startswith("x86_64") and all(features.get(feature) for feature in NEEDED):
        return Processor(triple, LEVEL, "")
    return Processor(triple, binding.get_host_cpu_name(), features.flatten())
