"""Kernels called by kernels: optimised once, within the kernel that Python calls, not once each.

Numba by itself translates every compiled function to machine code of its own, with a wrapper for Python, and then
copies it into its callers, where all is optimised again: a program of 140 kernels was optimised and translated 190
times, which took three quarters of the time. Here, a kernel called from Python is an ordinary Numba function, cached on
disk. A kernel called from another kernel is a part: it is typed and lowered, no more, and linked into each program that
calls it. Parts are kept on disk too, each by itself: after an edit, or in another process, the other parts of a program
need not be typed and lowered again, which takes longer than all that LLVM does with them.

A shared kernel is the exception: it is a program of its own, and kernels that call it call its machine code by address.
It costs its callers neither typing nor translating, and them and it one call over the boundary that LLVM cannot melt.

LLVM chooses the instructions as before; floating-point results keep their bits, because no option of the compilation
changes (docs/adr/0006-compiled-kernels.md tells which of Numba's internals this uses).
"""

# mypy: disable-error-code="no-untyped-call"
from __future__ import annotations

import copy
import functools
import hashlib
from collections.abc import Callable, Iterable
from typing import Any, Protocol

import llvmlite.binding  # type: ignore[import-untyped]
import numba
from numba.core import sigutils, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, compile_result
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering

from cornerforge._kernel_content import content_hash, functions_reached

__all__ = ["KernelDispatcher", "load_shared", "shared_of"]

_SHARED: dict[str, tuple[Any, tuple[Any, ...]]] = {}
"""Symbols of shared kernels that are loaded, with kernel and types of arguments."""
_SHARED_KERNELS: dict[str, Any] = {}
"""Shared kernels, by module and name."""
_SHARED_PREFIX = "cornerforge.shared."
_OWNERS: dict[Any, Any] = {}
"""Kernel of each function that is a part."""


def _named_by_content(record: Any) -> tuple[str, tuple[int]]:
    """Give what stands for a type of records in names; Numba takes the number of the type, another in each process."""
    return "Record", (int(hashlib.sha256(str(record).encode()).hexdigest()[:12], 16),)


types.Record.mangling_args = property(_named_by_content)  # type: ignore[assignment,method-assign]


@functools.cache
def _function_passes() -> tuple[Any, Any]:
    """Make the passes of LLVM that parts undergo, and their builder."""
    target = llvmlite.binding.Target.from_triple(llvmlite.binding.get_process_triple())
    builder = llvmlite.binding.create_pass_builder(
        target.create_target_machine(cpu="generic", features=""),
        llvmlite.binding.create_pipeline_tuning_options(speed_level=int(numba.config.OPT)),  # type: ignore[attr-defined]
    )
    return builder.getFunctionPassManager(), builder


class _PartLibrary(JITCodeLibrary):
    """The code of one part, for linking into programs; it is not optimised or translated by itself."""

    part: tuple[Any, tuple[Any, ...]] | None = None
    """The dispatcher and the types of arguments that it is for."""

    def _optimize_functions(self, ll_module: Any) -> None:
        """Optimise for no processor in particular, so that programs for every processor can link the part."""
        ll_module.data_layout = self._codegen._data_layout
        passes, builder = _function_passes()
        for function in ll_module.functions:
            passes.run(function, builder)

    def take_in_helpers(self) -> None:
        """Give the part copies of Numba's own functions that it calls, `min` for example, which no other module sees.

        Numba names them by a count of what a process compiled, so two processes give one name to different functions.
        """
        helpers = [one for one in self._linking_libraries if not isinstance(one, _PartLibrary)]
        self._linking_libraries = [one for one in self._linking_libraries if isinstance(one, _PartLibrary)]
        module = self._final_module
        for helper in helpers:
            other = helper._get_module_for_linking()
            named = {one.name for one in other.functions if not one.is_declaration}
            if named & {one.name for one in module.functions if one.is_declaration}:
                module.link_in(other, preserve=True)
                for one in module.functions:
                    if one.name in named and not one.is_declaration:
                        one.linkage = "internal"

    def called(self) -> list[_PartLibrary]:
        """List the parts that it calls itself, without the parts that they call."""
        further = {one for other in self._linking_libraries for one in other.closure() if one is not other}
        return [one for one in dict.fromkeys(self._linking_libraries) if one not in further]

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
                    waiting.append(library)
        return list(found)


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(NativeLowering):
    """Lower a function into a `_PartLibrary` and let other functions call it by the dispatcher's key."""

    _name = "part_lowering"

    def run_pass(self, state: Any) -> bool:
        identity = state.func_id
        state.library = _PartLibrary(state.targetctx.codegen(), identity.func_qualname)
        state.flags.no_compile = True
        # Numba tells functions of one name apart by counting, differently in each process.
        identity.unique_id = int(content_hash(_OWNERS[identity.func])[:12], 16)
        identity.unique_name = f"{identity.func_qualname}${identity.unique_id}"
        super().run_pass(state)
        library = state.library
        library.take_in_helpers()
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


class _PartStore(Protocol):
    """Where a part is kept: `_kernel_cache.PartStore`."""

    def load(self, args: tuple[Any, ...]) -> Any:
        """Read what `save` was given and rebuild it with the part's `thaw`; None if it is absent or damaged."""

    def save(self, args: tuple[Any, ...], frozen: Any) -> None:
        """Keep something that can be pickled."""


class _PartDispatcher(CPUDispatcher):
    """The part, which kernels call. A literal number in a call is typed as any number, without a version of its own."""

    store: _PartStore | None = None
    _owner: KernelDispatcher

    def compile(self, sig: Any) -> Any:
        """Load or compile the part."""
        args = tuple(sigutils.normalize_signature(sig)[0])
        with global_compiler_lock:
            if args in self.overloads or self.store is None:
                return super().compile(sig)
            found = self.store.load(args)
            if found is not None:
                self.add_overload(found)
                return found.entry_point
            entry_point = super().compile(sig)
            made: Any = self.overloads[args]
            made.library.part = self, args
            frozen = self._frozen(made)
            if frozen is not None:
                self.store.save(args, frozen)
            return entry_point

    def _frozen(self, made: Any) -> tuple[Any, ...] | None:
        """Give a compiled part in a form that can be pickled; None if it has none."""
        library = made.library
        parts = {one._part: number for number, one in enumerate(self._kernels_reached())}
        called = [one.part for one in library.called()]
        if made.fndesc.global_dict is not None or any(part is None or part[0] not in parts for part in called):
            return None
        description = copy.copy(made.fndesc)
        description.typemap = description.calltypes = None
        code = library._final_module.as_bitcode()
        return made.signature, description, code, [(parts[part], args) for part, args in called], shared_of(library)

    def thaw(self, args: tuple[Any, ...], frozen: Any) -> Any:
        """Rebuild a part, and the parts that it calls."""
        signature, description, code, called, shared = frozen
        load_shared(shared)
        kernels = self._kernels_reached()
        context: Any = self.targetctx
        library = _PartLibrary(context.codegen(), self.py_func.__qualname__)
        for number, types_of_call in called:
            part = kernels[number]._part
            part.compile(types_of_call)
            for one in part.overloads[types_of_call].library.closure():
                library.add_linking_library(one)
        library._final_module.link_in(llvmlite.binding.parse_bitcode(code))
        library.part = self, args
        library.finalize()
        key = object()
        context.insert_user_function(key, description, library.closure())
        return compile_result(
            typing_context=self.typingctx, target_context=self.targetctx, entry_point=key, library=library,
            signature=signature, objectmode=False, fndesc=description, lifted=(),
        )  # fmt: skip

    def _kernels_reached(self) -> list[Any]:
        return [one for one in functions_reached(self._owner) if isinstance(one, KernelDispatcher)]

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
        KeyError: No shared kernel has that name.
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
        self._part._owner = _OWNERS[py_func] = self

    @property
    def _numba_type_(self) -> Any:
        return types.Dispatcher(self._part)
