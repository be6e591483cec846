"""Compiler of kernels: all functions that a kernel reaches are linked first, and optimised once.

Numba alone optimises each function with all its callees, and makes machine code and wrappers for Python and C of each.
Here a function stays unoptimised LLVM code until it is linked into a kernel, which halves the time. Numba's passes that
no kernel needs are left out. This is the only file that loads Numba, and the only one that uses names of it that are
not documented.

Python calls a kernel with the address of a block of words of 8 bytes: the number of calls, and for each of them the
numbers of its arguments one after the other, the addresses of the objects that are arrays and records, and room for the
results. Several calls of a block let other threads of Python run until the last one ends.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from functools import cache
from types import FunctionType
from typing import Any

import numba
from llvmlite import binding, ir
from numba import types
from numba.core import cgutils, compiler
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager
from numba.core.types.misc import unliteral
from numba.core.typing import signature
from numba.core.typing.templates import AbstractTemplate
from numba.extending import lower_builtin, typeof_impl
from numba.np.arrayobj import populate_array

from tcc_sim.compiling.kernel_cache import processor
from tcc_sim.compiling.unrolled import Name, Storage, Unrolled, items_of

NEEDED = {"TranslateByteCode", "FixupArgs", "IRProcessing", "RewriteSemanticConstants", "DeadBranchPrune",
          "GenericRewrites", "ReconstructSSA", "NopythonTypeInference", "PreLowerStripPhis", "IRLegalization",
          "NativeLowering", "NoPythonBackend"}
"""Numba's passes for code that makes no array: without closures, array expressions, contexts and annotations."""
WORD, REAL = ir.IntType(64), ir.DoubleType()
HEAD = object.__basicsize__
"""Bytes of a Python object before its own fields (`PyArrayObject` and `PyVoidScalarObject` of NumPy's headers)."""
OPTIMISATION = 1
"""LLVM's level: the kernels are as fast as at level 3, whose passes take a quarter longer."""


class LoweredLibrary(JITCodeLibrary):  # type: ignore[misc]
    """The unoptimised LLVM module of a function, without machine code, to be linked into kernels."""

    codegen = property(lambda self: self)

    def add_llvm_module(self, ll_module: Any) -> None:
        """Add LLVM code."""
        self._final_module.link_in(ll_module)

    def add_linking_library(self, library: Any) -> None:
        """Add a library that the function calls."""
        self._linking_libraries.append(library)

    def finalize(self) -> None:
        """Close the library."""
        self._raise_if_finalized()
        self._shared_module = self._final_module
        self._finalized = True

    def get_pointer_to_function(self, _name: str) -> int:
        """Return 0: there is no machine code, and Numba only stores the address."""
        self._ensure_finalized()
        return 0

    def set_env(self, _name: str, _env: Any) -> None:
        """Set no environment: no function uses Python objects."""


class LoweringCompiler(compiler.CompilerBase):  # type: ignore[misc]
    """Numba's compiler for functions that compiled functions call."""

    def define_pipelines(self) -> list[PassManager]:
        """Return Numba's pipeline, reduced to NEEDED."""
        self.state.library = LoweredLibrary(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        out = PassManager("kernel")
        for step, description in compiler.DefaultPassBuilder.define_nopython_pipeline(self.state).passes:
            if step.__name__ in NEEDED:
                out.add_pass(step, description)
        out.finalize()
        return [out]


def dispatcher(function: FunctionType, options: dict[str, Any]) -> Any:
    """Return Numba's dispatcher of a function, whose `machine_code` makes a kernel of it.

    Its types do not depend on the values of literal numbers. Every option that a function would inherit from whoever
    calls it first is stated: its code is its own.
    """
    stated = {"nogil": True, "error_model": "numpy", "fastmath": False, "forceinline": False, **options}
    out = numba.njit(function, pipeline_class=LoweringCompiler, no_cpython_wrapper=True, no_cfunc_wrapper=True,
                     **stated)
    template = out.get_call_template
    out.get_call_template = lambda kinds, names: template(
        tuple(map(unliteral, kinds)), {name: unliteral(kind) for name, kind in names.items()})
    out.machine_code = lambda arguments: machine_code(out, arguments)
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

    @lower_builtin(staged, types.VarArg(types.Any))  # type: ignore[untyped-decorator]
    def write(context: Any, builder: Any, given: Any, arguments: Any) -> Any:
        staged.write(builder, arguments[0],
                     [_named(context, builder, k, a) for k, a in zip(given.args[1:], arguments[1:])])
        return context.get_dummy_value()

    return types.Function(Template)


def _named(context: Any, builder: Any, kind: Any, argument: Any) -> Any:
    """Return the staged function's argument: None, a tuple or NamedTuple, a Storage or a Name."""
    if isinstance(kind, types.NoneType):
        return None
    if isinstance(kind, types.BaseTuple):
        items = [_named(context, builder, k, a) for k, a in zip(kind, items_of(builder, argument))]
        return kind.instance_class(*items) if isinstance(kind, types.BaseNamedTuple) else tuple(items)
    if hasattr(kind, "dtype"):
        array = context.make_array(kind)(context, builder, argument)
        return Storage(builder, array.data, array.strides, kind.layout == "C", getattr(kind, "shape", (0,)))
    return Name(builder, argument)


@cache
def _machine() -> Any:
    """Return LLVM's machine for `processor`; LLVM's loader takes no other code model, and on x86-64 no other
    relocations.
    """
    triple, name, features = processor()
    return binding.Target.from_triple(triple).create_target_machine(
        cpu=name, features=features, opt=OPTIMISATION, reloc="static" if triple.startswith("x86") else "default",
        codemodel="jitdefault", jit=True)


@global_compiler_lock  # type: ignore[untyped-decorator]
def machine_code(function: Any, arguments: tuple[Any, ...]) -> bytes:
    """Return the machine code of a kernel for arguments like these, behind two lines: the `struct` format of its result
    (in brackets for a tuple), and the names of the C functions that it needs.
    """
    kinds, collects = tuple(map(numba.typeof, arguments)), gc.isenabled()
    gc.disable()  # It would take a tenth of the time.
    try:
        function.compile(kinds)
    finally:
        if collects:
            gc.enable()
    made = function.overloads[kinds]
    codegen = made.target_context.codegen()
    module = codegen._create_empty_module("kernel")
    outputs = _write_entry(made.target_context, module, made.fndesc, kinds)
    whole = binding.parse_assembly(str(module))
    libraries = [made.library]
    for library in libraries:
        whole.link_in(library._get_module_for_linking(), preserve=True)
        libraries += [called for called in dict.fromkeys(library._linking_libraries) if called not in libraries]
    for part in whole.functions:
        if not part.is_declaration and part.name != "kernel":
            part.linkage = "internal"  # A function with a single caller is always inlined.
    builder = binding.create_pass_builder(_machine(), binding.create_pipeline_tuning_options(OPTIMISATION))
    builder.getModulePassManager().run(whole, builder)
    needed = [part for part in whole.functions if part.is_declaration and not part.name.startswith("llvm.")]
    for part in needed:
        part.name = part.name.removeprefix("numba_")  # Numba's names of C's frexp and ldexp.
    names = " ".join(part.name for part in needed)
    code: bytes = _machine().emit_object(whole)
    return f"{outputs}\n{names}\n".encode() + code


def _write_entry(context: Any, module: Any, descriptor: Any, kinds: tuple[Any, ...]) -> str:
    """Write the entry that Python calls: for each call of the block, it reads the arguments and stores the results
    behind them. It ends at a call that fails.
    """
    function = ir.Function(module, ir.FunctionType(ir.IntType(32), [WORD.as_pointer()]), "kernel")
    builder = ir.IRBuilder(function.append_basic_block())
    block, = function.args
    place = cgutils.alloca_once_value(builder, builder.gep(block, [ir.Constant(WORD, 1)]))
    returned = descriptor.restype
    several = isinstance(returned, types.BaseTuple)
    formats = ""
    with cgutils.for_range(builder, builder.load(block)):
        places = _places(builder, builder.load(place))
        arguments = [_taken(context, builder, places, kind) for kind in kinds]
        status, value = context.call_conv.call_function(builder, context.declare_function(module, descriptor), returned,
                                                        kinds, arguments)
        with builder.if_then(status.is_error, likely=False):
            builder.ret(status.code)
        values = cgutils.unpack_tuple(builder, value) if several else [value]
        for kind, item in zip(returned if several else [returned], values):
            if not isinstance(kind, types.NoneType):
                formats += FORMATS[types.unliteral(kind)]
                whole = item if item.type in (WORD, REAL) else builder.zext(item, WORD)
                builder.store(whole, builder.bitcast(next(places), whole.type.as_pointer()))
        builder.store(next(places), place)
    builder.ret(ir.Constant(ir.IntType(32), 0))
    return f"({formats})" if several else formats


FORMATS = {types.float64: "d", types.int64: "q", types.boolean: "?7x"}
"""Formats of a word in `struct`."""


def _places(builder: Any, block: Any) -> Iterator[Any]:
    while True:
        yield block
        block = builder.gep(block, [ir.Constant(WORD, 1)])


def _taken(context: Any, builder: Any, places: Iterator[Any], kind: Any) -> Any:
    """Read an argument from its words."""
    if isinstance(kind, types.NoneType):
        return context.get_dummy_value()
    if isinstance(kind, types.BaseTuple):
        return context.make_tuple(builder, kind, [_taken(context, builder, places, item) for item in kind])
    place = next(places)
    if kind == types.float64:
        return builder.load(builder.bitcast(place, REAL.as_pointer()))
    word = builder.load(place)
    if kind == types.boolean:
        return builder.trunc(word, ir.IntType(1))
    if isinstance(kind, types.Record):
        return builder.inttoptr(_field(builder, word, HEAD + 8), context.get_value_type(kind))
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder)
        shape, strides = (_field(builder, word, HEAD + place) for place in (16, 24))
        populate_array(array, builder.inttoptr(_field(builder, word, HEAD), array.data.type),
                       [_field(builder, shape, 8 * i) for i in range(kind.ndim)],
                       [_field(builder, strides, 8 * i) for i in range(kind.ndim)],
                       context.get_abi_sizeof(context.get_data_type(kind.dtype)), None)
        return array._getvalue()
    return word


def _field(builder: Any, start: Any, offset: int) -> Any:
    place = builder.add(start, ir.Constant(WORD, offset))
    return builder.load(builder.inttoptr(place, WORD.as_pointer()))
