"""A library from somebody else starts no program that this user has not named."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from edited_files import write_object

import cornerforge
from cornerforge.errors import InputError
from cornerforge.foreign import named_avs


@pytest.fixture
def received(swerve_library: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A library whose manifest names a program, which would leave a mark; of a user who has named none."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(named_avs, "_HERE", set())
    library = tmp_path / "library"
    library.mkdir()
    for file in swerve_library.iterdir():
        (library / file.name).write_bytes(file.read_bytes())
    manifest = json.loads((library / "manifest.json").read_text(encoding="utf-8"))
    manifest["run"]["av"] = f"cmd: {sys.executable} -c \"open('{tmp_path}/mark', 'w')\""
    write_object(library / "manifest.json", manifest)
    return library


@pytest.mark.parametrize("verb", ["replay", "shrink", "suite_build"])
def test_its_program_is_not_started(received: Path, tmp_path: Path, verb: str) -> None:
    work = {
        "replay": lambda: cornerforge.replay(received, "all", check=True),
        "shrink": lambda: cornerforge.shrink(received, "all", out=tmp_path / "small"),
        "suite_build": lambda: cornerforge.suite_build([received], out=tmp_path / "suite"),
    }[verb]
    with pytest.raises(InputError, match=r"made by an AV from outside, 'cmd: .*check-av"):
        work()
    assert not (tmp_path / "mark").exists()


def test_a_name_counts_in_its_folder_and_later_too(
    received: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    named_avs.remember("my_av:Av")
    named_avs.check_named("my_av:Av", received)
    code = "from cornerforge.foreign.named_avs import check_named; check_named('my_av:Av', 'library')"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="not named in this folder"):
        named_avs.check_named("my_av:Av", received)
    with pytest.raises(InputError):
        named_avs.check_named("my_av:Other", received)
