"""The check of the two archives sees what is missing, too much, or different."""

from __future__ import annotations

import io
import tarfile
import zipfile
from pathlib import Path

from archives import SHIPPED, faults, kept


def pack(folder: Path, source: list[str], wheel: dict[str, bytes]) -> Path:
    folder.mkdir()
    with tarfile.open(folder / "a-1.tar.gz", "w:gz") as opened:
        for name in source:
            opened.addfile(tarfile.TarInfo(f"a-1/{name}"), io.BytesIO())
    with zipfile.ZipFile(folder / "a-1.whl", "w") as packed:
        for name, content in wheel.items():
            packed.writestr(name, content)
    return folder


def test_only_whole_and_equal_archives_pass(tmp_path: Path) -> None:
    files = [name for folder in SHIPPED for name in kept(folder)]
    package = {name.removeprefix("src/"): b"1" for name in kept("src/cornerforge")}
    assert "cornerforge/ndd/default_model.npz" in package
    good = pack(tmp_path / "good", files, package)
    assert faults(good, good) == []

    data = "cornerforge/drivers/rl_av.safetensors"
    less = {name: content for name, content in package.items() if name != data}
    bad = pack(tmp_path / "bad", files[:-1], {**less, "cornerforge/stray.py": b"", "cornerforge/errors.py": b"2"})
    found = faults(bad, good)
    assert f"not in a-1.tar.gz: {files[-1]}" in found
    assert f"not in a-1.whl: {data}" in found
    assert "in a-1.whl, but not in the checkout: cornerforge/stray.py" in found
    assert "cornerforge/errors.py: other bytes in the wheel of the checkout" in found
    assert len(found) == 6  # the two wheels differ in the first two as well
