"""What many tests read is made once: for all processes, files and runs of pytest, as long as what makes it is the same.

A folder is named after a hash of the package's sources and of the file that says how the artefact is made. It lies in
`.pytest_cache/artefacts`, is made under another name and renamed, and nothing may write into it afterwards.
"""

from __future__ import annotations

import hashlib
import inspect
import shutil
import time
from collections.abc import Callable
from pathlib import Path

from filelock import FileLock

from cornerforge.work import code_hash

__all__ = ["artefact", "made_once"]

ROOT = Path(__file__).parents[1] / ".pytest_cache" / "artefacts"
_KEPT_S = 14 * 86_400.0


def made_once(name: str, make: Callable[[Path], object]) -> Path:
    """Return the folder of an artefact, and make it if it is not there.

    Args:
        name: Its name among those that the same file makes.
        make: Fills the folder that it is given.
    """
    source = Path(inspect.getsourcefile(make) or "").read_bytes()
    key = hashlib.sha256(code_hash().encode() + source).hexdigest()[:16]
    folder = ROOT / key / name
    if not folder.exists():
        folder.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(folder.parent / f".{name}.lock"):
            if not folder.exists():
                part = folder.with_name(f".{name}.part")
                shutil.rmtree(part, ignore_errors=True)
                part.mkdir()
                make(part)
                part.rename(folder)
                _remove_old()
    return folder


def artefact(name: str) -> Path:
    """Return the folder of one of the small whole files of every kind that `fuzz.seeds` makes."""
    from fuzz.seeds import SEEDS, seed_folder

    root = made_once("seeds", lambda _: None)
    with FileLock(root.parent / f".seed-{name}.lock"):
        assert name in SEEDS
        return seed_folder(root, name)


def _remove_old() -> None:
    """Remove artefacts of other versions that nobody made anything for in two weeks."""
    for folder in ROOT.iterdir():
        if folder.stat().st_mtime < time.time() - _KEPT_S:
            shutil.rmtree(folder, ignore_errors=True)
