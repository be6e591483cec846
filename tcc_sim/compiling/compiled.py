"""Kernels: Python functions that are compiled once for each kind of arguments, and then called without the compiler.

Numba compiles (`linked`). The machine code is stored on disk (`kernel_cache`) and called through llvmlite and ctypes. A
process that finds its kernels there never loads Numba, which takes three quarters of the time of a short command.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
import re
import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import cache, cached_property
from pathlib import Path
from struct import Struct, pack_into
from types import FunctionType
from typing import Any, TypeVar, cast

import llvmlite
import numpy as np
from llvmlite import binding

from tcc_sim.background import awaited
from tcc_sim.compiling import kernel_cache
from tcc_sim.compiling.kernel_cache import LEVEL, processor
from tcc_sim.errors import MissingPackage, TccError

Function = TypeVar("Function", bound=Callable[..., object])
Kind = tuple[Any, ...]
Words = list[float]

SCALARS = {float: "d", np.float64: "d", int: "q", np.int64: "q", bool: "?", type(None): ""}
C_ORDER, FORTRAN_ORDER, WRITABLE = 0x1, 0x2, 0x400
"""NumPy's flags of an array that Numba compiles for; of an array in both orders it takes the first."""
TESTED = "0.62", "0.68"
"""First and last version of Numba that `linked` works with; other versions are refused."""
WORD = 8
"""Bytes of a number or an address in a block."""
_lock = threading.RLock()


class EntryPoint:
    """Compiled code, ready to call: that of `linked.machine_code`, for arguments with words like these.

    Raises TccError: the code needs a function that this process lacks.
    """

    def __init__(self, content: bytes, words: Words) -> None:
        outputs, names, code = content.split(b"\n", 2)
        binding.initialize_native_target()
        binding.initialize_native_asmprinter()
        self._engine = binding.create_mcjit_compiler(
            binding.parse_assembly(""), binding.Target.from_default_triple().create_target_machine(jit=True))
        for name in names.decode().split():
            if not binding.address_of_symbol(name):  # LLVM would end the process.
                raise TccError(f"{name} is missing")
        self._engine.add_object_file(binding.ObjectFileRef.from_data(code))
        self._engine.finalize_object()
        self._call = ctypes.CFUNCTYPE(ctypes.c_int32)(self._engine.get_function_address("kernel"))
        self._inputs = Struct("".join("d" if isinstance(word, float) else "q" for word in words))
        self._result, self._several = Struct(outputs.strip(b"()")), outputs.startswith(b"(")
        self._first, self._size = WORD + self._inputs.size, self._inputs.size + self._result.size

    def block(self, calls: Sequence[Words]) -> Any:
        """Return the number of calls and the calls, one after the other, given the words of each."""
        out = (ctypes.c_char * (WORD + self._size * len(calls)))()
        pack_into("q", out, 0, len(calls))
        for k, words in enumerate(calls):
            self._inputs.pack_into(out, WORD + self._size * k, *words)
        return out

    def run(self, block: Any) -> Any:
        """Make the calls of a block, which changes only their results in it; return the result of the first."""
        if self._call(block):
            raise ArithmeticError("a kernel has failed")
        return self._taken(block, self._first)

    def results(self, block: Any) -> list[Any]:
        """Make the calls of a block; return the result of each."""
        self.run(block)
        return [self._taken(block, place) for place in range(self._first, len(block), self._size)]

    def _taken(self, block: Any, place: int) -> Any:
        words = self._result.unpack_from(block, place)
        return words if self._several else words[0] if words else None


class Kernel:
    """A function that Python calls compiled, and that is linked into other kernels that call it.

    name : of the kernel on disk, among those of the package
    entries : code that was loaded, by kind of arguments
    """

    def __init__(self, function: FunctionType, options: dict[str, Any], name: str = "") -> None:
        self.py_func, self.options = function, options
        self.name = name or f"{function.__module__.rpartition('.')[2]}.{function.__qualname__}"
        self.__name__, self.__doc__ = function.__name__, function.__doc__
        self.entries: dict[Kind, EntryPoint] = {}

    def __call__(self, *arguments: Any) -> Any:
        """Call with floats, integers, None, arrays, records, and tuples of these."""
        entry, block = self.laid_out(arguments)
        return entry.run(block)

    def laid_out(self, arguments: tuple[Any, ...]) -> tuple[EntryPoint, Any]:
        """Return the code for these arguments, and a block with one call."""
        words: Words = []
        entry = self.entry(_laid_out(arguments, words), arguments, words)
        return entry, entry.block([words])

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's dispatcher of the function."""
        from tcc_sim.compiling import linked

        return linked.dispatcher(self.py_func, self.options)

    @property
    def _numba_type_(self) -> Any:
        """The type that Numba gives it where another kernel calls it."""
        return self.dispatcher._numba_type_

    def entry(self, kind: Kind, arguments: tuple[Any, ...], words: Words) -> EntryPoint:
        """Return the code for arguments of a kind; one thread at a time loads or compiles it."""
        if kind in self.entries:
            return self.entries[kind]

        def make() -> bytes:
            code: bytes = awaited(lambda: self.dispatcher.machine_code(arguments))
            return code

        with _lock:
            if kind not in self.entries:  # No digest stands for the source of a kernel outside the package.
                own = self.py_func.__module__.startswith(f"{kernel_cache.PACKAGE.name}.")
                self.entries[kind] = EntryPoint(make(), words) if not own else kernel_cache.load_or_build(
                    self.file_name(kind), make, lambda content: EntryPoint(content, words))
            return self.entries[kind]

    def file_name(self, kind: Kind) -> str:
        """Return the name on disk of the code for arguments of a kind."""
        which = repr((_compiler(), kernel_cache.source_digest(), kind))
        return f"{self.name}-{hashlib.sha256(which.encode()).hexdigest()[:24]}"


def timed(kernel: Callable[..., object], *arguments: Any) -> tuple[Any, float]:
    """Return the result of a kernel, and the seconds that it ran, without those of compiling."""
    entry, block = cast(Kernel, kernel).laid_out(arguments)
    began = time.perf_counter()
    value = entry.run(block)
    return value, time.perf_counter() - began


class Call:
    """A repeated call: its arguments are laid out once, and only changing numbers are written anew, by one thread.

    first : position of the first argument that changes; those before it are numbers and arrays
    formats : `struct` formats of the changing arguments from there on: d for a float, q for an integer
    """

    def __init__(self, kernel: Callable[..., object], first: int, formats: str) -> None:
        self._kernel, self._write, self._place = cast(Kernel, kernel), Struct(formats).pack_into, WORD * (1 + first)

    def use(self, *arguments: Any) -> None:
        """Use these arguments from the next call on; arrays are not copied."""
        entry, self._block = self._kernel.laid_out(arguments)
        self._arguments, self._run = arguments, entry.run  # The arguments must live as long as their addresses.

    def __call__(self, *numbers: float) -> Any:
        """Call with these numbers in the place of those that change."""
        self._write(self._block, self._place, *numbers)
        return self._run(self._block)


class Calls:
    """Calls of a kernel one after the other by machine code, which other threads do not wait for.

    slots : of each call the last arguments, which stay the same and are laid out once; arrays are not copied
    """

    def __init__(self, kernel: Callable[..., object], slots: Sequence[tuple[Any, ...]]) -> None:
        self._kernel, self._slots = cast(Kernel, kernel), list[tuple[tuple[Any, ...], Kind, Words]]()
        for last in slots:
            words = Words()
            self._slots.append((last, _laid_out(last, words), words))

    def __call__(self, numbers: Sequence[tuple[float, ...]], changing: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Return the results of calls with these numbers, then these arguments, in front of those of the slots."""
        results, waiting = list[Any](), list[Words]()
        entry = before = None
        for first, changed, (last, kind, words) in zip(numbers, changing, self._slots):
            laid = Words(first)
            mine = _laid_out(changed, laid)
            laid += words
            if entry is None or mine != before:
                if entry is not None:
                    results += entry.results(entry.block(waiting))
                entry = self._kernel.entry(_laid_out(first, Words()) + mine + kind, first + changed + last, laid)
                waiting, before = [], mine
            waiting.append(laid)
        return results + entry.results(entry.block(waiting)) if entry is not None else results


def _laid_out(values: tuple[Any, ...], words: Words) -> Kind:
    """Append the numbers of arguments, and the addresses of arrays, to `words`; return the kind of the arguments."""
    kind: list[Any] = [*map(SCALARS.get, map(type, values))]
    if None not in kind:
        words += values if "" not in kind else [value for value in values if value is not None]
        return tuple(kind)
    for k, value in enumerate(values):
        if kind[k] is not None:
            words += () if value is None else (value,)
        elif isinstance(value, tuple):
            kind[k] = type(value), _laid_out(value, words)
        else:
            if type(value) is np.ndarray:
                flags = value.flags.num
                order = C_ORDER if flags & C_ORDER else FORTRAN_ORDER
                kind[k] = value.dtype, value.ndim, flags & (order | WRITABLE)
            elif isinstance(value, np.void):
                kind[k] = value.dtype
            else:
                raise TypeError(f"a kernel is given {value!r}; it takes floats, integers, arrays and tuples of these")
            words.append(id(value))
    return tuple(kind)


@cache
def _numba() -> str:
    """Return the text of Numba's version module, without loading Numba; raise MissingPackage for an untested version.
    """
    spec = importlib.util.find_spec("numba")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("No module named 'numba'", name="numba")
    text = Path(spec.origin).with_name("_version.py").read_text()
    present = str(re.search(r'"version": "([^"]*)"', text)[1])  # type: ignore[index]
    first, last, version = (tuple(map(int, re.findall(r"\d+", name)[:2])) for name in (*TESTED, present))
    if not first <= version <= last:
        raise MissingPackage(f"Numba {present} is installed, and kernels need {' to '.join(TESTED)}; python3 -m pip "
                             "install 'numba>=0.62,<0.69' brings one")
    return text


@cache
def _compiler() -> tuple[object, ...]:
    """Return the versions of the compiler and the processor, without loading Numba."""
    return _numba(), llvmlite.__version__, sys.version_info[:2], *processor()


def not_to_ship() -> str:
    """Return why code that is compiled here does not go with the package; empty if it does."""
    try:
        _numba()
    except MissingPackage as error:
        return str(error)
    return "" if processor()[1] == LEVEL else f"the build's processor is not {LEVEL}"


def compiled(function: Function, name: str = "", **options: Any) -> Function:
    """Compile on the first call with arguments of a kind; the branches of an argument that is None are left out.

    The compiled code creates no array, releases the interpreter lock, and keeps IEEE arithmetic. `name` tells kernels
    apart that one function makes.
    """
    return cast(Function, Kernel(function, {"_nrt": False, **options}, name))  # type: ignore[arg-type]


def fast(function: Function, name: str = "") -> Function:
    """Like `compiled`, with products and sums fused where the processor can."""
    return compiled(function, name, fastmath={"contract"})


def rebound(text: Callable[..., Any], **names: Any) -> Callable[..., Any]:
    """Return the Python function of a text, kernel or not, with other objects for some of the names in it.

    So the model has one text of its equations: as it stands it runs in Python; with kernels for its names it is
    compiled; with functions of `unrolled`, `changing` or `solvers.law` it runs on rows, derivatives and series.
    """
    plain = cast(FunctionType, getattr(text, "py_func", text))
    return FunctionType(plain.__code__, {**plain.__globals__, **names}, argdefs=plain.__defaults__)
