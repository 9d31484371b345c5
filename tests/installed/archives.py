"""What `make wheel` checks of the two archives: python tests/installed/archives.py DIST DIRECT.

DIST holds the source archive and the wheel that was built from it, DIRECT the wheel that was built from this checkout.
"""

from __future__ import annotations

import sys
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = ["src/cornerforge", "tests", "docs", "examples", "benchmarks", "supply", "web", ".ci"]


def kept(folder: str) -> Iterator[str]:
    """Files of this checkout below a folder, as paths from the root; what programs leave behind is left out."""
    for path in sorted((ROOT / folder).rglob("*")):
        left_behind = not {"__pycache__", "node_modules"}.isdisjoint(path.parts) or path.name.endswith(
            ("_cache", ".report.html", ".pyc")
        )
        if path.is_file() and not left_behind:
            yield path.relative_to(ROOT).as_posix()


def source_names(archive: Path) -> set[str]:
    """Files of a source archive, without its outer folder."""
    with tarfile.open(archive) as opened:
        return {one.name.partition("/")[2] for one in opened.getmembers() if one.isfile()}


def wheel_files(archive: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(archive) as opened:
        return {name: opened.read(name) for name in opened.namelist()}


def differences(one: dict[str, bytes], other: dict[str, bytes]) -> list[str]:
    """Names that only one of two wheels has, or whose bytes differ."""
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))


def faults(dist: Path, direct: Path) -> list[str]:
    (source,), (wheel,), (other,) = dist.glob("*.tar.gz"), dist.glob("*.whl"), direct.glob("*.whl")
    in_source, in_wheel = source_names(source), wheel_files(wheel)
    found = [f"not in {source.name}: {name}" for folder in SHIPPED for name in kept(folder) if name not in in_source]
    package = {name.removeprefix("src/") for name in kept("src/cornerforge")}
    packed = {name for name in in_wheel if name.startswith("cornerforge/") and not name.endswith(".nbc")}
    found += [f"not in {wheel.name}: {name}" for name in sorted(package - packed)]
    found += [f"in {wheel.name}, but not in the checkout: {name}" for name in sorted(packed - package)]
    found += [f"{name}: other bytes in the wheel of the checkout" for name in differences(in_wheel, wheel_files(other))]
    found += [f"{name} is machine code" for name in in_source if name.endswith((".nbc", ".nbi"))]
    return found


if __name__ == "__main__":
    wrong = faults(Path(sys.argv[1]), Path(sys.argv[2]))
    print("\n".join(wrong) or "The source archive is complete, and gives the same wheel as the checkout.")
    sys.exit(bool(wrong))
