"""The build backend: setuptools, whose archives get the same bytes each time, and whose wheel gets a bill of materials.

What differs otherwise from one build to the next: times and modes of files (the second go with the umask), the order in
which a folder lists them, names of users, and the time in the head of gzip. See docs/adr/0052-supply-chain.md.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import io
import os
import stat
import subprocess
import tarfile
import time
import zipfile
from pathlib import Path
from typing import Any

import setuptools.build_meta as made_by
from sbom import BOM, bill_of_materials, bom_text
from setuptools.build_meta import (
    build_editable,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

ROOT = Path(__file__).resolve().parents[1]
_FIRST_OF_ZIP = 315532800  # 1980-01-01, the earliest date that a zip can hold


def build_time() -> int:
    """Say which time the archives bear, in seconds since 1970.

    SOURCE_DATE_EPOCH where it is set; else the time of the last commit, if this folder is the root of a repository;
    else the time of pyproject.toml, which an unpacked source archive has from the build that made it.
    """
    wished = os.environ.get("SOURCE_DATE_EPOCH")
    if wished:
        return int(wished)
    if (ROOT / ".git").exists():
        asked = subprocess.run(
            ["git", "log", "-1", "--format=%ct"], cwd=ROOT, capture_output=True, text=True, check=False
        )
        if asked.returncode == 0 and asked.stdout.strip():
            return int(asked.stdout)
    return int((ROOT / "pyproject.toml").stat().st_mtime)


def build_wheel(
    wheel_directory: str, config_settings: dict[str, Any] | None = None, metadata_directory: str | None = None
) -> str:
    """Build the wheel; see PEP 517."""
    name: str = made_by.build_wheel(wheel_directory, config_settings, metadata_directory)
    finish_wheel(Path(wheel_directory) / name, build_time())
    return name


def build_sdist(sdist_directory: str, config_settings: dict[str, Any] | None = None) -> str:
    """Build the source archive; see PEP 517."""
    # setuptools adds what the list of an earlier build names, though MANIFEST.in may leave it out by now.
    (ROOT / "src" / "cornerforge.egg-info" / "SOURCES.txt").unlink(missing_ok=True)
    name: str = made_by.build_sdist(sdist_directory, config_settings)
    finish_sdist(Path(sdist_directory) / name, build_time())
    return name


def prepare_metadata_for_build_wheel(metadata_directory: str, config_settings: dict[str, Any] | None = None) -> str:
    """Write the wheel's metadata without the wheel; see PEP 517."""
    name: str = made_by.prepare_metadata_for_build_wheel(metadata_directory, config_settings)
    place = Path(metadata_directory) / name / BOM
    place.parent.mkdir(exist_ok=True)
    place.write_bytes(bom_text(bill_of_materials(ROOT, build_time())))
    return name


def finish_wheel(wheel: Path, when: int) -> None:
    """Write a wheel again: with the bill of materials, sorted, all files of one time, readable and not executable."""
    with zipfile.ZipFile(wheel) as opened:
        files = {name: opened.read(name) for name in opened.namelist() if not name.endswith("/")}
    files |= machine_code()
    record = next(name for name in files if name.endswith(".dist-info/RECORD"))
    info = record.removesuffix("RECORD")
    files[info + BOM] = bom_text(bill_of_materials(ROOT, when))
    names = sorted(files.keys() - {record}, key=lambda name: (name.startswith(info), name))
    lines = [f"{name},sha256={_digest(files[name])},{len(files[name])}" for name in names]
    files[record] = "\n".join([*lines, f"{record},,", ""]).encode()
    date = time.gmtime(max(when, _FIRST_OF_ZIP))[:6]
    with zipfile.ZipFile(wheel, "w") as packed:
        for name in [*names, record]:
            entry = zipfile.ZipInfo(name, date)
            entry.create_system = 3  # Unix, wherever this is built
            entry.external_attr = (stat.S_IFREG | 0o644) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            packed.writestr(entry, files[name])


def machine_code() -> dict[str, bytes]:
    """Read what `supply/kernels.py FOLDER` compiled, if CORNERFORGE_MACHINE_CODE names that folder."""
    folder = os.environ.get("CORNERFORGE_MACHINE_CODE")
    found = sorted(Path(folder).glob("*.nbc")) if folder else []
    return {f"cornerforge/kernels/{file.name}": file.read_bytes() for file in found}


def _digest(content: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()


def finish_sdist(archive: Path, when: int) -> None:
    """Write a source archive again: sorted, all files of one time and nobody's, with modes that no umask changed."""
    plain = io.BytesIO()
    with tarfile.open(archive) as opened, tarfile.open(fileobj=plain, mode="w", format=tarfile.PAX_FORMAT) as packed:
        for old in sorted(opened.getmembers(), key=lambda member: member.name):
            entry = tarfile.TarInfo(old.name)
            entry.type, entry.size, entry.mtime = old.type, old.size, when
            entry.mode = 0o755 if old.isdir() or old.mode & 0o100 else 0o644
            packed.addfile(entry, opened.extractfile(old) if old.isfile() else None)
    with archive.open("wb") as file, gzip.GzipFile("", "wb", fileobj=file, mtime=when) as packed_small:
        packed_small.write(plain.getvalue())
