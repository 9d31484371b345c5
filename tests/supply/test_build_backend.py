"""Archives get the same bytes from the same files, whatever surrounds them, and the wheel its bill of materials."""

from __future__ import annotations

import hashlib
import json
import os
import tarfile
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path

import cornerforge_build
import pytest
from cornerforge_build import ROOT, build_time, finish_sdist, finish_wheel
from sbom import BOM, bill_of_materials, pins, requirements

WHEN = 1_700_000_000


def a_wheel(place: Path, mode: int, day: int, *, turned: bool) -> Path:
    names = ["a/b.py", "a-1.dist-info/METADATA", "a-1.dist-info/RECORD"]
    with zipfile.ZipFile(place, "w") as packed:
        for name in reversed(names) if turned else names:
            entry = zipfile.ZipInfo(name, (2020, 1, day, 0, 0, 0))
            entry.external_attr = mode << 16
            packed.writestr(entry, f"of {name}" if "RECORD" not in name else "")
    return place


def an_sdist(place: Path, mode: int, day: int, *, turned: bool) -> Path:
    names = ["a-1/setup.py", "a-1/run"]
    (place.parent / "file").write_bytes(b"content")
    with tarfile.open(place, "w:gz") as packed:
        for name in reversed(names) if turned else names:
            entry = packed.gettarinfo(place.parent / "file", name)
            entry.mode, entry.mtime, entry.uname, entry.uid = (
                mode | (0o100 if "run" in name else 0),
                day,
                f"user{day}",
                day,
            )
            with (place.parent / "file").open("rb") as file:
                packed.addfile(entry, file)
    return place


@pytest.mark.parametrize(("make", "finish"), [(a_wheel, finish_wheel), (an_sdist, finish_sdist)])
def test_the_same_files_give_the_same_bytes(
    make: Callable[..., Path], finish: Callable[[Path, int], None], tmp_path: Path
) -> None:
    one, other = make(tmp_path / "one", 0o644, 1, turned=False), make(tmp_path / "other", 0o600, 2, turned=True)
    assert one.read_bytes() != other.read_bytes()
    for archive in (one, other):
        finish(archive, WHEN)
    assert one.read_bytes() == other.read_bytes()
    finish(other, WHEN + 86400)
    assert one.read_bytes() != other.read_bytes()


def test_a_finished_wheel_is_whole(tmp_path: Path) -> None:
    wheel = a_wheel(tmp_path / "a.whl", 0o600, 1, turned=True)
    finish_wheel(wheel, WHEN)
    with zipfile.ZipFile(wheel) as opened:
        assert opened.testzip() is None
        names = opened.namelist()
        record = opened.read("a-1.dist-info/RECORD").decode().splitlines()
        bill = json.loads(opened.read(f"a-1.dist-info/{BOM}"))
        assert opened.read("a/b.py") == b"of a/b.py"
    assert names[-1] == "a-1.dist-info/RECORD"
    assert [line.split(",")[0] for line in record] == names
    assert bill == bill_of_materials(ROOT, WHEN)


def test_a_finished_source_archive_keeps_programs_programs(tmp_path: Path) -> None:
    archive = an_sdist(tmp_path / "a.tar.gz", 0o600, 1, turned=True)
    finish_sdist(archive, WHEN)
    with tarfile.open(archive) as opened:
        assert {one.name: one.mode for one in opened} == {"a-1/run": 0o755, "a-1/setup.py": 0o644}
        assert opened.extractfile("a-1/run").read() == b"content"  # type: ignore[union-attr]


def test_the_time_is_the_one_asked_for_or_the_files_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "pyproject.toml").touch()
    os.utime(tmp_path / "pyproject.toml", (WHEN, WHEN))
    monkeypatch.setattr(cornerforge_build, "ROOT", tmp_path)
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    assert build_time() == WHEN
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1234567890")
    assert build_time() == 1234567890


def test_the_bill_says_what_is_required_and_with_what_it_is_tested() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    bill = bill_of_materials(ROOT, WHEN)
    by_name = {one["name"]: one for one in bill["components"]}
    numpy = {one["name"]: one["value"] for one in by_name["numpy"]["properties"]}
    assert numpy == {
        "cornerforge:requires": requirements(project)["numpy"][""],
        "cornerforge:tested-with": pins(ROOT / "constraints.txt")["numpy"],
    }
    assert "version" not in by_name["numpy"], "a wheel requires ranges; it does not pin"
    assert by_name["torch"]["scope"] == "optional"
    assert "pytest" not in by_name
    assert bill == bill_of_materials(ROOT, WHEN)
    assert (
        hashlib.sha256(json.dumps(bill).encode()).digest()
        != hashlib.sha256(json.dumps(bill_of_materials(ROOT, WHEN + 1)).encode()).digest()
    )


@pytest.mark.parametrize("line", ['numpy>=2; python_version < "3.12"', "numpy @ https://example.org/numpy.whl"])
def test_a_requirement_that_cannot_be_read_is_refused(line: str) -> None:
    with pytest.raises(ValueError, match="cannot read"):
        requirements({"name": "cornerforge", "dependencies": [line], "optional-dependencies": {}})
