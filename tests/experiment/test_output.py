"""Output places: files whole or absent, folders ours or untouched."""

from __future__ import annotations

import errno
import json
import sys
from pathlib import Path

import pytest
from folder_snapshot import snapshot

from cornerforge.errors import FileFormatError, InputError, OutputError
from cornerforge.experiment.output import (
    check_new_file,
    code_hash,
    config_hash,
    open_output,
    provenance,
    read_json_file,
    version,
    write_json,
    writing,
)


def test_a_file_is_whole_or_absent(tmp_path: Path) -> None:
    place = tmp_path / "new" / "a.txt"
    with writing(place) as part:
        part.write_text("first", encoding="utf-8")
        assert not place.exists()
    assert place.read_text(encoding="utf-8") == "first"


def test_a_file_that_fails_half_way_leaves_the_old_one_and_no_trace(tmp_path: Path) -> None:
    place = tmp_path / "a.txt"
    place.write_text("first", encoding="utf-8")

    def fill_the_disk() -> None:
        with writing(place) as part:
            part.write_text("sec", encoding="utf-8")
            raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OutputError, match="No space left on device"):
        fill_the_disk()
    assert snapshot(tmp_path) == {"a.txt": b"first"}


def test_writing_below_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="Cannot write"):
        write_json(tmp_path / "file" / "a.json", {})
    assert snapshot(tmp_path) == {"file": b"mine"}


def test_json_holds_no_nan(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON compliant"):
        write_json(tmp_path / "a.json", {"rate": float("nan")})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("content", [b"", b"{", b"[1]", b"\xff\xfe"])
def test_a_damaged_file_is_named(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(content)
    with pytest.raises(FileFormatError, match=r"a\.json"):
        read_json_file(tmp_path / "a.json")


def test_checking_a_place_makes_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    check_new_file(tmp_path / "a" / "b" / "c.txt")
    check_new_file(tmp_path / "file", overwrite=True)
    for place in (tmp_path, tmp_path / "file", tmp_path / "file" / "c.txt", tmp_path / ("x" * 300)):
        with pytest.raises(OutputError):
            check_new_file(place)
    assert snapshot(tmp_path) == {"file": b"mine"}


def test_a_relative_place_is_checked_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    check_new_file(Path("a/b.txt"))
    (tmp_path / "a").write_text("", encoding="utf-8")
    with pytest.raises(OutputError, match="is a file"):
        check_new_file(Path("a/b.txt"))


def test_a_folder_is_taken_up_only_by_the_same_work(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    identity = {"seed": 1, "budget": "quick", "share": 0.1}
    assert open_output(folder, identity, resume=False) is False
    before = snapshot(tmp_path)
    with pytest.raises(OutputError, match="--resume"):
        open_output(folder, identity, resume=False)
    with pytest.raises(InputError, match=r"seed = 1, not 2"):
        open_output(folder, identity | {"seed": 2}, resume=True)
    with pytest.raises(InputError, match="lanes"):
        open_output(folder, identity | {"lanes": 3}, resume=True)
    assert open_output(folder, identity, resume=True) is True
    assert snapshot(tmp_path) == before


def test_what_a_kill_in_the_first_moment_leaves_is_no_obstacle(tmp_path: Path) -> None:
    (tmp_path / ".provenance.json.01234567.part").write_text('{"half', encoding="utf-8")
    assert open_output(tmp_path, {"seed": 1}, resume=False) is False


@pytest.mark.parametrize("resume", [False, True])
def test_a_folder_of_something_else_is_not_touched(resume: bool, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    for folder in (tmp_path, tmp_path / "notes.txt"):
        with pytest.raises(OutputError):
            open_output(folder, {"seed": 1}, resume=resume)
    assert snapshot(tmp_path) == {"notes.txt": b"mine"}


def test_provenance_says_what_where_and_when(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["/some/where/__main__.py", "run", "--out", "my folder"])
    made = provenance({"seed": 3}, 1.5)
    assert made["command"] == "cornerforge run --out 'my folder'"
    assert (made["cornerforge"], made["identity"], made["seconds"]) == (version(), {"seed": 3}, 1.5)
    assert {"system", "processor", "cores", "python"} <= set(made["machine"])
    json.dumps(made, allow_nan=False)
    monkeypatch.setattr(sys, "argv", ["study.py"])
    assert provenance({})["command"] == "study.py"


def test_hashes() -> None:
    assert config_hash({"a": 1, "b": {"c": 0.1}}) == config_hash({"b": {"c": 0.1}, "a": 1})
    assert config_hash({"a": 1}) != config_hash({"a": 2})
    assert len(code_hash()) == len(config_hash({})) == 16
