"""Compiler of kernels: all functions that a kernel reaches are linked first, and optimised once.

Numba alone optimises each function with all its callees, and makes machine code and wrappers for Python and C of each.
Here a function stays unoptimised LLVM code until it is linked into a kernel. This lowered function is stored on disk
too, behind the machine code of the kernel, so that a kernel for another kind of scene lowers only the functions that
differ. Numba's passes that no kernel needs are left out.

Python calls a kernel with the address of one block of words of 8 bytes: the numbers of its arguments one after the
other, the addresses of the objects that are arrays and records, and room for the results.
"""

from __future__ import annotations

import gc
import hashlib
import operator
import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from types import FunctionType
from typing import Any, NamedTuple

import numba
from llvmlite import binding, ir
from numba import types
from numba.core import cgutils, compiler, environment
from numba.core import ir as numba_ir
from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import FunctionPass, PassManager, register_pass
from numba.core.ir_utils import get_definition, guard
from numba.np.arrayobj import populate_array

from tcc_sim.compiling import kernel_cache
from tcc_sim.compiling.numba_registration import registered
from tcc_sim.compiling.processor import processor

NEEDED = {"TranslateByteCode", "FixupArgs", "IRProcessing", "RewriteSemanticConstants", "DeadBranchPrune",
          "GenericRewrites", "ReconstructSSA", "NopythonTypeInference", "PreLowerStripPhis", "IRLegalization",
          "NativeLowering", "NoPythonBackend"}
"""Numba's passes for code that makes no array: without closures, array expressions, contexts and annotations."""
WORD, REAL = ir.IntType(64), ir.DoubleType()
HEAD = object.__basicsize__
"""Bytes of a Python object before its own fields (`PyArrayObject` and `PyVoidScalarObject` of NumPy's headers)."""
OPTIMISATION = 1
"""LLVM's level: the kernels are as fast as at level 3, whose passes take a quarter longer."""
WHICH = 16
"""Digits of the digest that tells a function for some types of arguments from all other code."""


def _record_in_names(kind: Any) -> tuple[str, tuple[int]]:
    """Return the part of a function's name in LLVM code that stands for a record: a digest of its fields.

    Numba takes the number of types made before in the process, so that another process would not find a lowered
    function.
    """
    return type(kind).__name__, (int(hashlib.sha256(kind.name.encode()).hexdigest()[:12], 16),)


types.Record.mangling_args = property(_record_in_names)


class LoweredLibrary(JITCodeLibrary):  # type: ignore[misc]
    """The unoptimised LLVM module of a function, without machine code, to be linked into kernels.

    key : its name on disk; None while it is not there
    """

    key: str | None = None
    codegen = property(lambda self: self)

    def add_llvm_module(self, ll_module: Any) -> None:
        """Add LLVM code."""
        self._final_module.link_in(ll_module)

    def add_linking_library(self, library: Any) -> None:
        """Add a library that the function calls."""
        self._linking_libraries.append(library)

    def finalize(self) -> None:
        """Close the library. Numba's own functions that it calls become internal ones of this module."""
        self._raise_if_finalized()
        called = dict.fromkeys(self._linking_libraries)
        others = [library for library in called if not isinstance(library, LoweredLibrary)]
        self._linking_libraries: list[Any] = [library for library in called if isinstance(library, LoweredLibrary)]
        for library in others:
            absent = {function.name for function in self._final_module.functions if function.is_declaration}
            module = library._get_module_for_linking()
            made = {function.name for function in module.functions if not function.is_declaration}
            if not absent.isdisjoint(made):
                self._final_module.link_in(module, preserve=True)
                for function in self._final_module.functions:
                    if function.name in made and not function.is_declaration:
                        function.linkage = "internal"
        self._shared_module = self._final_module
        self._finalized = True

    def get_pointer_to_function(self, _name: str) -> int:
        """Return 0: there is no machine code, and Numba only stores the address."""
        self._ensure_finalized()
        return 0

    def set_env(self, _name: str, _env: Any) -> None:
        """Set no environment: no function uses Python objects."""


@register_pass(mutates_CFG=False, analysis_only=False)
class PresentArguments(FunctionPass):  # type: ignore[misc]
    """Replaces the comparison with None of an argument that is not None by a constant.

    Numba itself prunes the branches of arguments that are None only: it would type and lower the others' dead branches.
    """

    _name = "present_arguments"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Replace the comparisons in a function; return whether there were any."""
        changed = False
        for item in (item for block in state.func_ir.blocks.values() for item in block.find_insts(numba_ir.Assign)):
            value = item.value
            if isinstance(value, numba_ir.Expr) and value.op == "binop" and value.fn in (operator.is_, operator.is_not):
                left, right = (guard(get_definition, state.func_ir, side) for side in (value.lhs, value.rhs))
                if (isinstance(left, numba_ir.Arg) and isinstance(right, numba_ir.Const) and right.value is None
                        and not isinstance(state.args[left.index], (types.NoneType, types.Optional, types.Omitted))):
                    item.value = numba_ir.Const(value.fn is operator.is_not, value.loc)
                    changed = True
        return changed


class LoweringCompiler(compiler.CompilerBase):  # type: ignore[misc]
    """Numba's compiler for functions that compiled functions call.

    digest : of all code that the function can reach, with its options; each dispatcher has a class of its own
    """

    digest: str

    def define_pipelines(self) -> list[PassManager]:
        """Return Numba's pipeline, reduced to NEEDED; names in the code are the same in every process."""
        identity = self.state.func_id
        if (name := lowered_name(self.digest, self.state.args)) is not None:
            identity.unique_id = int(name[-WHICH:], 16)
            identity.unique_name = f"{identity.func_qualname}${identity.unique_id}"
        self.state.library = LoweredLibrary(self.state.targetctx.codegen(), identity.func_qualname)
        out = PassManager("kernel")
        for step, description in compiler.DefaultPassBuilder.define_nopython_pipeline(self.state).passes:
            if step.__name__ == "DeadBranchPrune":
                out.add_pass(PresentArguments, "constants for arguments that are not None")
            if step.__name__ in NEEDED:
                out.add_pass(step, description)
        out.finalize()
        return [out]


class LoweredFunction(NamedTuple):
    """A lowered function on disk: Numba's signature and descriptor, and the library."""

    signature: Any
    descriptor: Any
    library: LoweredLibrary


class LoweredStore(NullCache):  # type: ignore[misc]
    """The stored code of a function, in the place of Numba's own cache.

    in_use : whether functions are read and stored; not after stored ones did not fit together
    """

    in_use = True

    _functions: dict[str, LoweredFunction] = {}  # noqa: RUF012  Of the whole process, by their names on disk.

    def __init__(self, digest: str) -> None:
        self.digest = digest

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return Numba's result for these types of arguments from disk, or None."""
        name = lowered_name(self.digest, sig) if self.in_use else None
        lowered = None if name is None else self._function(name, target_context)
        if lowered is None:
            return None
        environment_of = environment.Environment.from_fndesc(lowered.descriptor)
        return compiler.compile_result(
            typing_context=target_context.typing_context, target_context=target_context, library=lowered.library,
            environment=environment_of, entry_point=target_context.get_executable(lowered.library, lowered.descriptor,
                                                                                  environment_of),
            fndesc=lowered.descriptor, signature=lowered.signature, objectmode=False, lifted=(), reload_init=[],
            referenced_envs=[])

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store Numba's result, unless it calls a function that is not stored, or has a type without a name."""
        name, lowered = lowered_name(self.digest, sig), LoweredFunction(data.signature, data.fndesc, data.library)
        called = [other.key for other in lowered.library._linking_libraries]
        if not self.in_use or name is None or None in called or lowered.descriptor.global_dict is not None:
            return
        lowered.descriptor.typemap = lowered.descriptor.calltypes = None
        try:
            head = pickle.dumps((lowered.signature, lowered.descriptor, called))
        except (pickle.PicklingError, AttributeError):
            return
        code: bytes = lowered.library._final_module.as_bitcode()
        kernel_cache.keep_function(name, len(head).to_bytes(8, "little") + head + code)
        lowered.library.key, self._functions[name] = name, lowered

    @classmethod
    def _function(cls, name: str, context: Any) -> LoweredFunction | None:
        """Return the function of this name, with all functions that it calls; None where one of them is not stored."""
        if name not in cls._functions:
            content = kernel_cache.stored_function(name)
            lowered = None if content is None else cls._read(content, context)
            if lowered is None:
                return None
            lowered.library.key, cls._functions[name] = name, lowered
        return cls._functions[name]

    @classmethod
    def _read(cls, content: bytes, context: Any) -> LoweredFunction | None:
        """Return a function, as `save_overload` stored it; None if it names a type that is not there."""
        size = 8 + int.from_bytes(content[:8], "little")
        try:
            signature, descriptor, called = pickle.loads(content[8:size])  # noqa: S301  As safe as the code behind it.
        except (ImportError, AttributeError):
            return None
        library = LoweredLibrary(context.codegen(), descriptor.qualname)
        for name in called:
            if (lowered := cls._function(name, context)) is None:
                return None
            library.add_linking_library(lowered.library)
        library._final_module = binding.parse_bitcode(content[size:])
        library.finalize()
        return LoweredFunction(signature, descriptor, library)


def lowered_name(digest: str, kinds: Any) -> str | None:
    """Return the name on disk of a function for types of arguments; None where one of them is a function. `digest` is
    that of all code that the function can reach.
    """
    try:
        types = repr([*map(_described, kinds)])
    except TypeError:
        return None
    return f"{digest[:kernel_cache.DIGITS]}-{hashlib.sha256((digest + types).encode()).hexdigest()[:WHICH]}"


def _described(kind: Any) -> object:
    """Return a description of a type that tells it from every other one; raise TypeError for a function's."""
    if isinstance(kind, types.BaseTuple):
        named = getattr(kind, "instance_class", tuple)
        return named.__module__, named.__qualname__, getattr(named, "_fields", ()), [*map(_described, kind)]
    if isinstance(kind, types.Callable):
        raise TypeError
    return repr(kind)


def dispatcher(function: FunctionType, options: dict[str, Any], digest: str) -> Any:
    """Return Numba's dispatcher of a function, whose `machine_code` makes a kernel of it; `digest` is that of all code
    that it can reach, and of the options.
    """
    pipeline = type("LoweringCompiler", (LoweringCompiler,), {"digest": digest})
    out = registered(function, options, pipeline_class=pipeline, no_cpython_wrapper=True, no_cfunc_wrapper=True)
    out._cache = LoweredStore(digest)
    out.machine_code = lambda arguments: machine_code(out, arguments)
    return out


@cache
def _machine() -> Any:
    """Return LLVM's machine for `processor`; LLVM's loader takes no other code model, and on x86-64 no other
    relocations.
    """
    triple, name, features = processor()
    return binding.Target.from_triple(triple).create_target_machine(
        cpu=name, features=features, opt=OPTIMISATION, reloc="static" if triple.startswith("x86") else "default",
        codemodel="jitdefault", jit=True)


@contextmanager
def _hurrying(context: Any) -> Iterator[None]:
    """Save an eighth of Numba's time: cache the types of functions, and pause Python's garbage collector."""
    resolve, collects = context.resolve_function_type, gc.isenabled()
    resolutions: dict[Any, Any] = {}

    def resolved(function: Any, arguments: Any, keywords: Any) -> Any:
        key = function, tuple(arguments), tuple(dict(keywords).items())
        try:
            if key not in resolutions:
                resolutions[key] = resolve(function, arguments, keywords)
            return resolutions[key]
        except TypeError:  # A slice among the arguments is not hashable.
            return resolve(function, arguments, keywords)

    context.resolve_function_type = resolved
    gc.disable()
    try:
        yield
    finally:
        del context.resolve_function_type
        if collects:
            gc.enable()


@global_compiler_lock  # type: ignore[untyped-decorator]
def machine_code(function: Any, arguments: tuple[Any, ...]) -> bytes:
    """Return the machine code of a kernel for arguments like these, behind two lines: the `struct` format of its result
    (in brackets for a tuple), and the names of the C functions that it needs.
    """
    kinds = tuple(map(numba.typeof, arguments))
    with _hurrying(function.typingctx):
        function.compile(kinds)
    made = function.overloads[kinds]
    codegen = made.target_context.codegen()
    module = codegen._create_empty_module("kernel")
    outputs = _write_entry(made.target_context, module, made.fndesc, kinds)
    whole = binding.parse_assembly(str(module))
    libraries = [made.library]
    for library in libraries:
        whole.link_in(library._get_module_for_linking(), preserve=True)
        libraries += [called for called in dict.fromkeys(library._linking_libraries) if called not in libraries]
    for function in whole.functions:
        if not function.is_declaration and function.name != "kernel":
            function.linkage = "internal"  # A function with a single caller is always inlined.
    builder = binding.create_pass_builder(_machine(), binding.create_pipeline_tuning_options(OPTIMISATION))
    builder.getModulePassManager().run(whole, builder)
    needed = [function for function in whole.functions
              if function.is_declaration and not function.name.startswith("llvm.")]
    for function in needed:
        function.name = function.name.removeprefix("numba_")  # Numba's names of C's frexp and ldexp.
    names = " ".join(function.name for function in needed)
    code: bytes = _machine().emit_object(whole)
    return f"{outputs}\n{names}\n".encode() + code


def _write_entry(context: Any, module: Any, descriptor: Any, kinds: tuple[Any, ...]) -> str:
    """Write the entry that Python calls: it reads the arguments from the block and stores the results behind them."""
    function = ir.Function(module, ir.FunctionType(ir.IntType(32), [WORD.as_pointer()]), "kernel")
    builder = ir.IRBuilder(function.append_basic_block())
    places = _places(builder, function.args[0])
    arguments = [_taken(context, builder, places, kind) for kind in kinds]
    returned = descriptor.restype
    status, value = context.call_conv.call_function(builder, context.declare_function(module, descriptor), returned,
                                                    kinds, arguments)
    several = isinstance(returned, types.BaseTuple)
    values = cgutils.unpack_tuple(builder, value) if several else [value]
    formats = ""
    for kind, item in zip(returned if several else [returned], values):
        if not isinstance(kind, types.NoneType):
            formats += FORMATS[types.unliteral(kind)]
            whole = item if item.type in (WORD, REAL) else builder.zext(item, WORD)
            builder.store(whole, builder.bitcast(next(places), whole.type.as_pointer()))
    builder.ret(status.code)
    return f"({formats})" if several else formats


FORMATS = {types.float64: "d", types.int64: "q", types.boolean: "?7x"}
"""Formats of a word in `struct`."""


def _places(builder: Any, block: Any) -> Iterator[Any]:
    """Yield the addresses of the words of a block."""
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
    """Read a word of a structure."""
    place = builder.add(start, ir.Constant(WORD, offset))
    return builder.load(builder.inttoptr(place, WORD.as_pointer()))
