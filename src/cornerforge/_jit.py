"""Kernels: how they are compiled with Numba, and where their machine code is kept.

`kernel` compiles on first call, keeps the machine code on disk (a second start pays no compile time), releases the GIL
(so that ranges of tests run in a thread pool), and keeps IEEE semantics: no `fastmath`, hence results that do not
depend on vector width, thread count or batch size.

Numba by itself notices edits of the file in which a function stands, but not in the files of functions that it calls,
and would go on with stale code. Here the key is a hash of all that a kernel reaches (`_kernel_content.py`).
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numba.np.linalg
from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, event, types
from numba.extending import intrinsic

from cornerforge._kernel_cache import KernelCache, PartStore
from cornerforge._kernel_parts import KernelDispatcher

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["announce_compiling", "inlined_kernel", "kernel", "kernel_by_code", "prefetch", "shared_kernel"]

_OPTIONS: dict[str, Any] = {
    "nopython": True,
    "nogil": True,
    "error_model": "numpy",
    "_nrt": False,
    "forceinline": False,
}
# `_nrt`: no reference counting, which took most of the time where arrays travel in tuples, and no allocation, which
# kernels must not do anyway. The switch is private to Numba (docs/adr/0006-compiled-kernels.md).
# `forceinline`, set even where it is off: a kernel without it inherits it from whichever caller is compiled first, and
# then all of `advance` was one function of 68,000 instructions that took LLVM a minute.


def _load_array_functions() -> None:
    """Load Numba's functions of arrays without SciPy's BLAS, which takes half a second and which no kernel uses.

    Numba loads it here only to see that it is there; a function of another package that multiplies matrices asks again
    when it is compiled.
    """
    usual = numba.np.linalg.ensure_blas
    numba.np.linalg.ensure_blas = lambda: None
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        numba.np.linalg.ensure_blas = usual


_load_array_functions()

F = TypeVar("F", bound=Callable[..., object])


def kernel(function: F) -> F:
    """Compile a scalar loop function to machine code."""
    return _compiled(function, _OPTIONS)


def inlined_kernel(function: F) -> F:
    """Compile a scalar loop function into every kernel that calls it.

    A call hands over world, road and tables as about a hundred words; in functions called once per vehicle or look-up
    that took half the time (docs/adr/0006-compiled-kernels.md). The results have the same bits.
    """
    return _compiled(function, {**_OPTIONS, "forceinline": True})


def shared_kernel(function: F) -> F:
    """Compile a scalar loop function to a program of its own, which kernels call by its address.

    For what is large, is called by many kernels, and seldom: once a test or a second.
    """
    return _compiled(function, _OPTIONS, shared=True)


def _compiled(function: F, options: dict[str, Any], *, shared: bool = False) -> F:
    dispatcher: Any = KernelDispatcher(function, options, shared=shared)
    dispatcher._cache = KernelCache(dispatcher)
    dispatcher._part.store = PartStore(dispatcher)
    return cast("F", dispatcher)


def kernel_by_code(codes: Mapping[str, int], kernels: Mapping[str, Callable[..., object]]) -> Any:
    """Make one inlined kernel of several: called with a code and more arguments, it calls the kernel of that code.

    Args:
        codes: The code of each name; all different.
        kernels: The kernel of each name. All take the same arguments and return the same types.

    Raises:
        LookupError: A name has no kernel, a kernel no name, or two names have one code. Without this check another
            kernel would run without a warning.
    """
    if codes.keys() != kernels.keys():
        missing = ", ".join(sorted(codes.keys() ^ kernels.keys()))
        raise LookupError(f"{missing}: declared and without a kernel, or a kernel that is not declared.")
    if len(set(codes.values())) < len(codes):
        raise LookupError(f"Two have the same code: {dict(codes)}.")
    *rest, last = sorted(kernels, key=codes.__getitem__)
    return functools.reduce(
        lambda others, name: _or(codes[name], kernels[name], others), rest, _whatever(kernels[last])
    )


def _whatever(function: Any) -> Any:
    """Make a kernel that calls `function` for any code."""

    @inlined_kernel
    def call(code: int, *arguments: Any) -> Any:  # noqa: ARG001
        return function(*arguments)

    return call


def _or(code_of_first: int, first: Any, others: Any) -> Any:
    """Make a kernel that calls `first` for its code, else `others`."""

    @inlined_kernel
    def call(code: int, *arguments: Any) -> Any:
        if code == code_of_first:
            return first(*arguments)
        return others(code, *arguments)

    return call


@contextmanager
def announce_compiling(say: Callable[[], None]) -> Iterator[None]:
    """Call `say` once, when the first kernel is compiled within this block; kernels read from disk do not count.

    Args:
        say: Tells the user the reason for waiting.
    """

    class _Once(event.Listener):
        said = False

        def on_start(self, event: object) -> None:  # noqa: ARG002
            if not self.said:
                self.said = True
                say()

        def on_end(self, event: object) -> None:
            pass

    with event.install_listener("numba:compile", _Once()):
        yield


def _prefetch(_: object, array: Any, row: Any, column: Any) -> tuple[Any, Callable[..., Any]]:
    """Give typing and code of `prefetch`, as Numba asks for them."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        fields = context.make_array(signature.args[0])(context, builder, arguments[0])
        place = cgutils.get_item_pointer(  # type: ignore[no-untyped-call]
            context, builder, signature.args[0], fields, list(arguments[1:])
        )
        form = ir.FunctionType(ir.VoidType(), [place.type, *[cgutils.int32_t] * 3])
        hint = builder.module.declare_intrinsic("llvm.prefetch", [cgutils.voidptr_t], form)
        read, keep_near, data = (cgutils.int32_t(number) for number in (0, 3, 1))
        builder.call(hint, [place, read, keep_near, data])
        return context.get_dummy_value()

    return types.none(array, row, column), generate


prefetch = cast("Callable[[NDArray[Any], int, int], None]", intrinsic(_prefetch))
"""Kernels call `prefetch(array, row, column)` to ask for memory that will be read soon; the call does not wait for it.

It changes no result. The array has two axes, the indices are int64, and the element must lie within the array.
"""
