"""Files are whole or absent, whoever writes them."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

import pytest

import cornerforge
from cornerforge._files import append, below, is_part_of, remove_parts, write_bytes, writing
from cornerforge.errors import OutputError

PACKAGE = Path(cornerforge.__file__).parent


def test_a_file_appears_whole_with_its_folder(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b.txt"
    with writing(path) as part:
        part.write_text("half", encoding="utf-8")
        assert not path.exists()
        part.write_text("whole", encoding="utf-8")
    assert path.read_text(encoding="utf-8") == "whole"
    assert [file.name for file in path.parent.iterdir()] == ["b.txt"]


@pytest.mark.parametrize("kind", [OSError(28, "No space left on device"), KeyboardInterrupt(), ValueError("NaN")])
def test_what_fails_leaves_the_old_file_and_no_part(kind: BaseException, tmp_path: Path) -> None:
    """A full disk is an error with the file's name; an interrupt and a bug stay what they are."""
    path = tmp_path / "b.txt"
    path.write_text("old", encoding="utf-8")
    expected = OutputError if isinstance(kind, OSError) else type(kind)

    def fail() -> None:
        with writing(path, "the page") as part:
            part.write_text("half", encoding="utf-8")
            raise kind

    with pytest.raises(expected) as caught:
        fail()
    if expected is OutputError:
        assert str(caught.value).startswith(f"Cannot write the page {path}: No space left on device; make room")
    assert path.read_text(encoding="utf-8") == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["b.txt"]


def test_a_part_is_new_and_its_name_cannot_be_foreseen(tmp_path: Path) -> None:
    path, names = tmp_path / "b.txt", set()
    for _ in range(3):
        with writing(path) as part:
            assert is_part_of(part.name, path)
            assert stat.S_ISREG(part.lstat().st_mode)
            names.add(part.name)
    assert len(names) == 3


def test_parts_of_dead_processes_go_and_those_of_living_ones_stay(tmp_path: Path) -> None:
    path, other = tmp_path / "b.txt", tmp_path / "other"
    other.write_text("mine", encoding="utf-8")
    (tmp_path / ".b.txt.01234567.part").write_text("half", encoding="utf-8")
    (tmp_path / ".b.txt.89abcdef.part").symlink_to(other)
    with writing(path) as living:
        living.write_text("alive", encoding="utf-8")
        remove_parts(path)
        assert {file.name for file in tmp_path.iterdir()} == {living.name, ".b.txt.89abcdef.part", "other"}
    assert path.read_text(encoding="utf-8") == "alive"
    assert other.read_text(encoding="utf-8") == "mine"


def test_a_link_in_the_files_place_is_replaced_and_not_followed(tmp_path: Path) -> None:
    other, path = tmp_path / "other", tmp_path / "b.txt"
    other.write_text("mine", encoding="utf-8")
    path.symlink_to(other)
    write_bytes(path, b"new")
    assert not path.is_symlink()
    assert (other.read_bytes(), path.read_bytes()) == (b"mine", b"new")


def test_below_an_output_folder_no_link_to_a_folder_is_followed(tmp_path: Path) -> None:
    elsewhere, out = tmp_path / "elsewhere", tmp_path / "out"
    elsewhere.mkdir()
    out.mkdir()
    (out / "library").symlink_to(elsewhere)
    write_bytes(out / "library" / "a", b"named by the user")
    with below(str(out)):
        write_bytes(out / "b", b"")
        with pytest.raises(OutputError, match=r"library is a link, and within an output folder none is followed"):
            write_bytes(out / "library" / "b", b"")
    assert [file.name for file in elsewhere.iterdir()] == ["a"]


@pytest.mark.parametrize("link", ["symbolic", "hard"])
def test_what_grows_in_place_is_no_link(link: str, tmp_path: Path) -> None:
    other, log = tmp_path / "other", tmp_path / "av.log"
    append(other, b"mine")
    log.symlink_to(other) if link == "symbolic" else os.link(other, log)
    with pytest.raises(OSError, match=r"av\.log"):
        append(log, b"theirs")
    assert other.read_bytes() == b"mine"


def test_a_file_of_given_content_is_whole_too(tmp_path: Path) -> None:
    write_bytes(tmp_path / "a" / "b", b"all")
    assert (tmp_path / "a" / "b").read_bytes() == b"all"
    with pytest.raises(OutputError, match=r"Cannot write the picture .*b/c"):
        write_bytes(tmp_path / "a" / "b" / "c", b"all", "the picture")


def test_files_are_written_as_parts() -> None:
    """Whoever writes a file writes its part, which `writing` gives; `append` alone, for logs, writes in place."""
    write = re.compile(
        r'(\w+)\)?\.(?:write_bytes|write_text|touch)\(|(\w+)\.open\("[wax]|(?<![\w.])open\((\w+), "[wax]'
    )
    found = [
        f"{path.name}: {wrote.group()}"
        for path in PACKAGE.rglob("*.py")
        for wrote in write.finditer(path.read_text(encoding="utf-8"))
        if "part" not in wrote.groups() and (path.name, wrote[3]) not in (("_files.py", "number"),)
    ]
    assert found == []


def test_there_is_one_writer() -> None:
    """Nobody else renames a file into its place."""
    renames = re.compile(r"os\.(replace|rename)\(|(part|temporary)\.(replace|rename)\(")
    found = [path.name for path in PACKAGE.rglob("*.py") if renames.search(path.read_text(encoding="utf-8"))]
    assert found == ["_files.py"]
