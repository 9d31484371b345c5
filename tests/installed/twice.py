"""What `make wheel` checks beside the archives' contents: python tests/installed/twice.py DIST DIRECT.

The explorer's page, the source archive and the wheel are built again, from a copy in another folder and as another user
would: other umask, time zone, language and hash seed, and times of files of another day. The bytes must be the same.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MADE = ("PKG-INFO", "setup.cfg", "src/cornerforge.egg-info")
"""What is in a source archive and in no checkout: the build makes it."""
OTHERWISE = {"TZ": "Pacific/Kiritimati", "LC_ALL": "C", "LANG": "C", "PYTHONHASHSEED": "77"}


def sums(*folders: Path) -> dict[str, set[str]]:
    """SHA-256 of the archives in some folders, by name."""
    found: dict[str, set[str]] = {}
    for archive in sorted(path for folder in folders for path in folder.iterdir() if path.suffix in (".whl", ".gz")):
        found.setdefault(archive.name, set()).add(hashlib.sha256(archive.read_bytes()).hexdigest())
    return found


def copy_of_checkout(source: Path, folder: Path) -> Path:
    """Unpack a source archive as the checkout that it was made from; only pyproject.toml keeps its time."""
    with tarfile.open(source) as opened:
        opened.extractall(folder, filter="data")
    (root,) = folder.iterdir()
    for name in MADE:
        shutil.rmtree(root / name) if (root / name).is_dir() else (root / name).unlink()
    for path in root.rglob("*"):
        if path.is_file() and path.name != "pyproject.toml":
            os.utime(path, (1e9, 1e9))
            path.chmod(0o600 | path.stat().st_mode & 0o100)
    return root


def build_again(source: Path, folder: Path) -> Path:
    """Build the page and both archives from a copy in `folder`, under other circumstances."""
    root = copy_of_checkout(source, folder / "copy")
    otherwise = {**os.environ, **OTHERWISE, "PIP_CONSTRAINT": str(root / "constraints.txt")}
    shutil.copytree(ROOT / "web/node_modules", root / "web/node_modules", symlinks=True, copy_function=os.link)
    shutil.rmtree(root / "src/cornerforge/ext/explorer/static")
    for command, place in (
        (["node", "build.mjs"], root / "web"),
        ([sys.executable, "-m", "build", "--outdir", str(folder / "dist"), str(root)], folder),
    ):
        done = subprocess.run(
            command, cwd=place, env=otherwise, umask=0o077, capture_output=True, text=True, check=False
        )
        if done.returncode:
            sys.exit(f"{done.stdout}{done.stderr}")
    return folder / "dist"


if __name__ == "__main__":
    dist, direct = (Path(folder).resolve() for folder in sys.argv[1:])
    (source,) = dist.glob("*.tar.gz")
    with tempfile.TemporaryDirectory(dir=direct) as work:  # of the same disk: files are linked, not copied
        found = sums(dist, direct, build_again(source, Path(work)))
    wrong = [name for name, each in found.items() if len(each) > 1]
    for name in wrong:
        print(
            f"{name} has other bytes when it is built in another place; see docs/adr/0052-supply-chain.md for causes."
        )
    if not wrong:
        print(*(f"Built twice with the same bytes: {one.pop()}  {name}" for name, one in found.items()), sep="\n")
    sys.exit(bool(wrong))
