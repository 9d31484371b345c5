"""The cache of kernels' machine code: its folder, and what happens to files that are damaged or cannot be written.

A program must start wherever Python starts: with a read-only package, without a home folder, on a full disk. Kernels
are then compiled for this run only. A damaged file is dropped and its kernel compiled anew.
"""

# mypy: disable-error-code="no-untyped-call"
from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import shutil
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, UserProvidedCacheLocator
from numba.core.serialize import dumps

__all__ = ["KernelCache", "choose_folder", "warn_once"]

_UNUSED_DAYS = 30.0
_TOUCH_DAYS = 1.0
_DAY = 86400.0
_TOLD: list[str] = []


def choose_folder(name: str, package: Path) -> str:
    """Make the folder `name` in the first place that can be written, and return its path; "" if there is none.

    Places: the one that NUMBA_CACHE_DIR names, if it is set; else the package's `__pycache__`, then the user's cache.
    """
    wished = os.environ.get("NUMBA_CACHE_DIR")
    for base in (Path(wished),) if wished else _usual_places(package):
        folder = base / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            _mark_as_used(folder)
            _remove_unused(base)
            return str(folder)
    return ""


def _usual_places(package: Path) -> Iterator[Path]:
    yield package / "__pycache__"
    named = os.environ.get("XDG_CACHE_HOME")
    if named:
        yield Path(named) / "cornerforge"
        return
    with contextlib.suppress(RuntimeError):  # a user without a home
        yield Path.home() / ".cache" / "cornerforge"


def _mark_as_used(folder: Path) -> None:
    """Set the folder's time, which tells its last use; at most once a day."""
    with contextlib.suppress(OSError):
        if folder.stat().st_mtime < time.time() - _TOUCH_DAYS * _DAY:
            os.utime(folder)


def _remove_unused(base: Path) -> None:
    """Delete machine code that no program has used for a month: its sources or its installation are gone."""
    limit = time.time() - _UNUSED_DAYS * _DAY
    with contextlib.suppress(OSError):  # another process may remove the same folder
        for folder in base.glob("kernels-*"):
            if folder.stat().st_mtime < limit:
                shutil.rmtree(folder, ignore_errors=True)


class _Locator(UserProvidedCacheLocator):
    """The cache folder, as told to Numba. Numba's own class tries to write a file there for every kernel, at import."""

    def ensure_cache_path(self) -> None:
        os.makedirs(self.get_cache_path(), exist_ok=True)


class _Checked(CompileResultCacheImpl):
    """Machine code with its checksum: half a file must not become half a program."""

    _locator_classes = [_Locator]  # noqa: RUF012  (Numba's own attribute)

    def reduce(self, cres: Any) -> tuple[bytes, bytes]:
        content = dumps(super().reduce(cres))
        return hashlib.sha256(content).digest(), content

    def rebuild(self, target_context: Any, payload: tuple[bytes, bytes]) -> Any:
        checksum, content = payload
        if hashlib.sha256(content).digest() != checksum:
            raise ValueError("the checksum is another")
        return super().rebuild(target_context, pickle.loads(content))


class _Files(IndexDataCacheFile):
    """Index and machine code; a pipe or a device in the place of one would be read for ever."""

    def _load_index(self) -> Any:
        _check_regular(self._index_path)
        return super()._load_index()

    def _load_data(self, name: str) -> Any:
        _check_regular(self._data_path(name))
        return super()._load_data(name)


def _check_regular(path: str) -> None:
    if os.path.exists(path) and not os.path.isfile(path):
        raise OSError(f"{path} is no regular file")


class KernelCache(FunctionCache):
    """The cached files of one kernel; no fault in them ends the program.

    Raises:
        RuntimeError: Its folder cannot be made.
    """

    _impl_class = _Checked

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        own = self._cache_file
        self._cache_file = _Files(self._cache_path, own._index_name.removesuffix(".nbi"), own._source_stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Read the kernel's machine code; None if it is absent or damaged."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # damaged bytes, read as a pickle, can raise anything
            with contextlib.suppress(OSError):
                os.unlink(self._cache_file._index_path)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write the kernel's machine code; where that fails, warn once."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            warn_once(self.cache_path, error.strerror or str(error))


def warn_once(place: str, why: str) -> None:
    """Warn that machine code cannot be kept in a folder, once in a process."""
    if _TOLD:
        return
    _TOLD.append(place)
    warnings.warn(
        f"Machine code cannot be kept in {place} ({why}), so the next start compiles it again; make room, or name "
        "another folder in NUMBA_CACHE_DIR.",
        stacklevel=3,
    )
