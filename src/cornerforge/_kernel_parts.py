"""Kernels called by kernels: optimised once, within the kernel that Python calls, not once each.

Numba by itself translates every compiled function to machine code of its own, with a wrapper for Python, and then
copies it into its callers, where all is optimised again: a program of 140 kernels was optimised and translated 190
times, which took three quarters of the time. Here, a kernel called from Python is an ordinary Numba function, cached on
disk. A kernel called from another kernel is a part: it is typed and lowered, no more, and linked into each program that
calls it.

LLVM chooses the instructions as before; floating-point results keep their bits, because no option of the compilation
changes (docs/adr/0006-compiled-kernels.md tells which of Numba's internals this uses).
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
    """The code of one part, for linking into programs; it is not optimised or translated by itself."""

    def finalize(self) -> None:
        self._raise_if_finalized()
        self._finalized = True

    def closure(self) -> list[Any]:
        """List this library and all others that a program which contains it must link."""
        found: dict[Any, None] = {self: None}
        waiting = [self]
        while waiting:
            for library in waiting.pop()._linking_libraries:
                if library not in found:
                    found[library] = None
                    if isinstance(library, _PartLibrary):
                        waiting.append(library)
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
    """Numba's own passes, but with `_PartLowering`."""

    def define_pipelines(self) -> list[Any]:
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.passes = [(_PartLowering if a is NativeLowering else a, text) for a, text in pipeline.passes]
        pipeline.finalize()
        return [pipeline]


class _PartDispatcher(CPUDispatcher):
    """The part, which kernels call. A literal number in a call is typed as any number, without a version of its own."""

    def get_call_template(self, args: Any, kws: Any) -> Any:
        return super().get_call_template(
            tuple(map(types.unliteral, args)), {name: types.unliteral(kind) for name, kind in kws.items()}
        )

    def add_overload(self, cres: Any) -> None:
        self.overloads[tuple(cres.signature.args)] = cres


class KernelDispatcher(CPUDispatcher):
    """The kernel, which Python calls; a kernel that calls it gets its part."""

    def __init__(self, py_func: Callable[..., object], targetoptions: dict[str, Any]) -> None:
        super().__init__(py_func, targetoptions=dict(targetoptions))
        only_within = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        self._part = _PartDispatcher(
            py_func, targetoptions={**targetoptions, **only_within}, pipeline_class=_PartCompiler
        )

    @property
    def _numba_type_(self) -> Any:
        return types.Dispatcher(self._part)
