"""Kernels called by kernels: optimised once, within the kernel that Python calls, not once each.

Numba by itself translates every compiled function to machine code of its own, with a wrapper for Python, and then
copies it into its callers, where all is optimised again: a program of 140 kernels was optimised and translated 190
times, which took three quarters of the time. Here, a kernel called from Python is an ordinary Numba function, cached on
disk. A kernel called from another kernel is a part: it is typed and lowered, no more, and linked into each program that
calls it.

A shared kernel is the exception: it is a program of its own, and kernels that call it call its machine code by address.
It costs its callers neither typing nor translating, and them and it one call over the boundary that LLVM cannot melt.

LLVM chooses the instructions as before; floating-point results keep their bits, because no option of the compilation
changes (docs/adr/0006-compiled-kernels.md tells which of Numba's internals this uses).
"""

# mypy: disable-error-code="no-untyped-call"
from __future__ import annotations

import copy
import hashlib
from collections.abc import Callable, Iterable
from typing import Any

import llvmlite.binding  # type: ignore[import-untyped]
from numba.core import sigutils, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering

__all__ = ["KernelDispatcher", "load_shared", "shared_of"]

_SHARED: dict[str, tuple[Any, tuple[Any, ...]]] = {}
"""Symbols of shared kernels that are loaded, with kernel and types of arguments."""
_SHARED_KERNELS: dict[str, Any] = {}
"""Shared kernels, by module and name."""
_SHARED_PREFIX = "cornerforge.shared."


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


class _SharedDispatcher(_PartDispatcher):
    """The part of a shared kernel: a declaration of the program that the kernel is."""

    def __init__(self, whole: KernelDispatcher, targetoptions: dict[str, Any]) -> None:
        super().__init__(whole.py_func, targetoptions=targetoptions)
        self._whole = whole

    def compile(self, sig: Any) -> Any:
        """Load or compile the program, make its address known to LLVM, and let kernels call it by a symbol."""
        args, _ = sigutils.normalize_signature(sig)
        args = tuple(args)
        if args not in self.overloads:
            self._whole.compile(args)
            result: Any = self._whole.overloads[args]
            types_hash = hashlib.sha256(str(args).encode()).hexdigest()[:16]
            symbol = f"{_SHARED_PREFIX}{_name_of(self._whole)}.{types_hash}"
            address = result.library.get_pointer_to_function(result.fndesc.llvm_func_name)
            llvmlite.binding.add_symbol(symbol, address)
            _SHARED[symbol] = self._whole, args
            declared = copy.copy(result.fndesc)
            declared.mangled_name, declared.inline = symbol, False
            key = object()
            self.targetctx.insert_user_function(key, declared)
            self.add_overload(result._replace(entry_point=key, fndesc=declared))
        found: Any = self.overloads[args]
        return found.entry_point


def _name_of(kernel: Any) -> str:
    return f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}"


def shared_of(library: Any) -> list[tuple[str, tuple[Any, ...]]]:
    """List the shared kernels that a program calls, by name, with the types of their arguments."""
    called = [one.name for one in library._final_module.functions if one.is_declaration and one.name in _SHARED]
    return [(_name_of(kernel), args) for kernel, args in (_SHARED[name] for name in called)]


def load_shared(wanted: Iterable[tuple[str, tuple[Any, ...]]]) -> None:
    """Load shared kernels, before a program is loaded that calls them.

    Raises:
        KeyError: There is none of that name.
    """
    for name, args in wanted:
        _SHARED_KERNELS[name]._part.compile(args)


class KernelDispatcher(CPUDispatcher):
    """The kernel, which Python calls; a kernel that calls it gets its part.

    Args:
        py_func: The function.
        targetoptions: As Numba takes them.
        shared: Its part is only a declaration.
    """

    def __init__(self, py_func: Callable[..., object], targetoptions: dict[str, Any], *, shared: bool = False) -> None:
        super().__init__(py_func, targetoptions=dict(targetoptions))
        only_within = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        self._part: Any
        if shared:
            self._part = _SharedDispatcher(self, {**targetoptions, **only_within})
            _SHARED_KERNELS[_name_of(self)] = self
            return
        self._part = _PartDispatcher(
            py_func, targetoptions={**targetoptions, **only_within}, pipeline_class=_PartCompiler
        )

    @property
    def _numba_type_(self) -> Any:
        return types.Dispatcher(self._part)
