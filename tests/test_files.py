"""Files are whole or absent, whoever writes them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import cornerforge
from cornerforge._files import part_of, write_bytes, writing
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
    assert not part_of(path).exists()


def test_a_file_of_given_content_is_whole_too(tmp_path: Path) -> None:
    write_bytes(tmp_path / "a" / "b", b"all")
    assert (tmp_path / "a" / "b").read_bytes() == b"all"
    with pytest.raises(OutputError, match=r"Cannot write the picture .*b/c"):
        write_bytes(tmp_path / "a" / "b" / "c", b"all", "the picture")


def test_files_are_written_as_parts() -> None:
    """Whoever writes a file writes its part, which `writing` gives; only the log of what an AV prints grows.

    What a sandbox writes are settings of the kernel.
    """
    write = re.compile(
        r'(\w+)\)?\.(?:write_bytes|write_text|touch)\(|(\w+)\.open\("[wax]|(?<![\w.])open\((\w+), "[wax]'
    )
    found = [
        f"{path.name}: {wrote.group()}"
        for path in PACKAGE.rglob("*.py")
        for wrote in write.finditer(path.read_text(encoding="utf-8"))
        if "part" not in wrote.groups() and path.name not in ("av_log.py", "sandbox.py")
    ]
    assert found == []


def test_there_is_one_writer() -> None:
    """Nobody else renames a file into its place."""
    renames = re.compile(r"os\.(replace|rename)\(|(part|temporary)\.(replace|rename)\(")
    found = [path.name for path in PACKAGE.rglob("*.py") if renames.search(path.read_text(encoding="utf-8"))]
    assert found == ["_files.py"]
