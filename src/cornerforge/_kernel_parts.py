"""Kernels within kernels: compiled once per whole program that is called from Python, not once for each of them.

Numba by itself takes every compiled function to machine code of its own, with a door for Python, before it copies it
into its callers, where all is optimised again: a program of 140 kernels was optimised and translated 190 times, three
quarters of the time. Here a kernel has two faces. Called from Python it is an ordinary Numba function, cached on disk.
Called from another kernel it is a part: typed and lowered, nothing more, and handed to whatever program it ends up in.

Which instructions come out in the end is LLVM's choice as before; floating-point results keep their bits, because no
option of the compilation changes (docs/adr/0006-compiled-kernels.md tells what of Numba's inside this uses).
"""

# mypy: disable-error-code="no-untyped-call"
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering

__all__ = ["KernelDispatcher"]


class _PartLibrary(JITCodeLibrary):
    """Code of one part, to be linked into programs: never optimised as a whole, never translated."""

    def finalize(self) -> None:
        self._raise_if_finalized()
        self._finalized = True

    def closure(self) -> list[Any]:
        """This library and all that a program which contains it must link as well."""
        found: dict[Any, None] = {self: None}
        for library in self._linking_libraries:
            for each in library.closure() if isinstance(library, _PartLibrary) else (library,):
                found[each] = None
        return list(found)


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(NativeLowering):
    """Lower a function into a `_PartLibrary` and let other functions call it by the dispatcher's key."""

    _name = "part_lowering"

    def run_pass(self, state: Any) -> bool:
        state.library = _PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        library = state.library
        library._ensure_finalized()
        key = object()
        state.targetctx.insert_user_function(key, state.cr.fndesc, library.closure())
        state["cr"] = state.cr._replace(cfunc=key)
        return True


class _PartCompiler(CompilerBase):
    """Numba's own passes with another lowering."""

    def define_pipelines(self) -> list[Any]:
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.passes = [(_PartLowering if a is NativeLowering else a, text) for a, text in pipeline.passes]
        pipeline.finalize()
        return [pipeline]


class _PartDispatcher(CPUDispatcher):
    """What kernels call; a number written out in a call is a number like others, and asks for no version of its own."""

    def get_call_template(self, args: Any, kws: Any) -> Any:
        return super().get_call_template(
            tuple(map(types.unliteral, args)), {name: types.unliteral(kind) for name, kind in kws.items()}
        )

    def add_overload(self, cres: Any) -> None:
        self.overloads[tuple(cres.signature.args)] = cres


class KernelDispatcher(CPUDispatcher):
    """What Python calls; kernels that name it are led to its part."""

    def __init__(self, py_func: Callable[..., object], targetoptions: dict[str, Any]) -> None:
        super().__init__(py_func, targetoptions=dict(targetoptions))
        only_within = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        self._part = _PartDispatcher(
            py_func, targetoptions={**targetoptions, **only_within}, pipeline_class=_PartCompiler
        )

    @property
    def _numba_type_(self) -> Any:
        return types.Dispatcher(self._part)
