"""How a kernel of many small functions is compiled: all of them together, and nothing that is not called.

Numba optimises each function that another one calls with all that it calls in turn, and makes machine code of it and
entries for Python and for C. A part of a kernel is called by neither, so that is thrown away, and half the time of a
first run with it. Here a part stays as it was written out; the kernel that is called takes in every part that it
reaches, and only then is optimised. The passes over the text that no kernel needs are left out as well.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numba import _dynfunc
from numba.core import compiler
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.funcdesc import PythonFunctionDescriptor
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering

OWN_TEXT = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()
"""Part of the key of compiled code."""
NEEDED = {"TranslateByteCode", "FixupArgs", "IRProcessing", "RewriteSemanticConstants", "DeadBranchPrune",
          "GenericRewrites", "ReconstructSSA", "NopythonTypeInference", "PreLowerStripPhis", "IRLegalization",
          "NativeLowering", "NoPythonBackend"}
"""Numba's passes for what makes no array: without closures, array expressions, context managers and annotations."""


class PartLibrary(JITCodeLibrary):  # type: ignore[misc]
    """A function that waits to be linked: neither optimised nor made machine code."""

    def add_llvm_module(self, ll_module: Any) -> None:
        """Take what the function was written out as."""
        self._final_module.link_in(ll_module)

    def add_linking_library(self, library: Any) -> None:
        """Remember what it calls."""
        self._linking_libraries.append(library)

    def parts(self) -> Iterator[Any]:
        """What it calls, directly or not."""
        for library in self._linking_libraries:
            yield library
            if isinstance(library, PartLibrary):
                yield from library.parts()

    def finalize(self) -> None:
        """Nothing can be added any more; whoever links it may inline it, or leave it out."""
        self._raise_if_finalized()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage.name == "external":
                function.linkage = "linkonce_odr"
        self._shared_module = self._final_module
        self._finalized = True


class WholeLibrary(JITCodeLibrary):  # type: ignore[misc]
    """A kernel that Python calls, with all the parts that it reaches."""

    def add_linking_library(self, library: Any) -> None:
        """Remember what it calls, and what that calls."""
        super().add_linking_library(library)
        if isinstance(library, PartLibrary):
            self._linking_libraries.extend(library.parts())

    def _optimize_final_module(self) -> None:
        """Optimise all together; nobody else calls the parts, so one that is called at one place is always inlined."""
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage.name == "linkonce_odr":
                function.linkage = "internal"
        passes, builder = self.codegen._module_pass_manager()  # Numba's first round is for what counts references.
        passes.run(self._final_module, builder)


@register_pass(mutates_CFG=True, analysis_only=False)
class PartLowering(NativeLowering):  # type: ignore[misc]
    """Write a part out."""

    _name = "part_lowering"

    def run_pass(self, state: Any) -> bool:
        """As Numba does, without an entry for Python, for C, or an address."""
        context, flags = state.targetctx, state.flags
        library = PartLibrary(context.codegen(), state.func_id.func_qualname)
        descriptor = PythonFunctionDescriptor.from_specialized_function(
            state.func_ir, state.typemap, state.return_type, state.calltypes, mangler=context.mangler,
            inline=flags.forceinline, noalias=flags.noalias, abi_tags=[flags.get_mangle_string()])
        with context.push_code_library(library):
            lower = Lower(context, library, descriptor, state.func_ir, metadata=state.metadata)
            lower.lower()
        library.finalize()
        nowhere = _dynfunc.make_function(descriptor.lookup_module(), state.func_id.func_name, "", 0, lower.env,
                                         (library,))
        context.insert_user_function(nowhere, descriptor, [library])
        state.library = library
        state["cr"] = compiler._LowerResult(descriptor, lower.call_helper, cfunc=nowhere, env=lower.env)
        return True


def passes(state: Any, lowering: type[NativeLowering]) -> list[PassManager]:
    """Numba's passes, those that are needed where nothing is allocated, with a way to write a function out."""
    out = PassManager("kernel")
    for step, description in compiler.DefaultPassBuilder.define_nopython_pipeline(state).passes:
        if state.flags.nrt or step.__name__ in NEEDED:
            out.add_pass(lowering if step is NativeLowering else step, description)
    out.finalize()
    return [out]


class PartCompiler(compiler.CompilerBase):  # type: ignore[misc]
    """Compiles a function as other compiled functions call it."""

    def define_pipelines(self) -> list[PassManager]:
        """The passes."""
        return passes(self.state, PartLowering)


class WholeCompiler(compiler.CompilerBase):  # type: ignore[misc]
    """Compiles a function as Python calls it."""

    def define_pipelines(self) -> list[PassManager]:
        """The passes."""
        self.state.library = WholeLibrary(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return passes(self.state, NativeLowering)
