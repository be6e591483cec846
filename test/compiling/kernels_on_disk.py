"""Modules of kernels that are written, changed and imported again, with hits of the cache on disk."""

import importlib
import sys

from tcc_sim.compiling import kernel_cache, linked

CALLEE = """
'''A module that a kernel calls.'''
from tcc_sim.compiling.compiled import compiled
GAIN = 2.0
UNUSED = 1.0
@compiled
def scaled(x):
    '''x times the gain.'''
    return GAIN * x
@compiled
def other(x):
    return x + 1.0
"""
CALLER = """
import {callee} as callee
from tcc_sim.compiling.compiled import compiled
@compiled
def kernel(x):
    return callee.scaled(x) + 1.0
"""
numbers = iter(range(1000))
made = []


def forget():
    """Let this process look at the disk anew, as another one does."""
    for each in (kernel_cache.directory, kernel_cache.stored_functions, kernel_cache._read_once):
        each.cache_clear()
    kernel_cache.new_functions.clear()
    linked.LoweredStore._functions.clear()


def lowered_functions():
    """The lowered functions of this process, which a test puts back when it ends: code that is in memory knows them."""
    return dict(kernel_cache.new_functions), dict(linked.LoweredStore._functions)


def modules(folder, callee=CALLEE, caller=CALLER, name=""):
    """A kernel and its callees in fresh modules; an equal `name` gives the same names again."""
    name = name or f"kernels_{next(numbers)}"
    for suffix, text in (("callee", callee), ("caller", caller.format(callee=f"{name}_callee"))):
        (folder / f"{name}_{suffix}.py").write_text(text)
        sys.modules.pop(f"{name}_{suffix}", None)
    importlib.invalidate_caches()
    sys.dont_write_bytecode, before = True, sys.dont_write_bytecode
    try:
        return importlib.import_module(f"{name}_caller").kernel
    finally:
        sys.dont_write_bytecode = before


def hits(kernel):
    """Kinds of arguments for which a kernel's code was found."""
    return len(kernel.entries) - made.count(kernel.dispatcher)
