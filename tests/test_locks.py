"""Locks of output places: which process holds one, that a dead process's is free, and that none is left."""

from __future__ import annotations

import errno
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cornerforge._locks import claim_file, claim_folder, claims, is_lock, lock_of
from cornerforge.errors import OutputError

_HOLDER = """
import sys, time
from pathlib import Path
from cornerforge._locks import claim_file, claim_folder, claims
with claims():
    {"file": claim_file, "folder": claim_folder}[sys.argv[1]](Path(sys.argv[2]))
    print("held", flush=True)
    sys.stdin.read()
"""


@contextmanager
def held_elsewhere(kind: str, place: Path) -> Iterator[subprocess.Popen[str]]:
    """Let another process hold a place."""
    with subprocess.Popen(
        [sys.executable, "-c", _HOLDER, kind, str(place)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        try:
            yield process
        finally:
            process.stdin.close()


def locks_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if is_lock(path.name))


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_a_second_process_is_told_in_one_line_which_holds_the_place(kind: str, tmp_path: Path) -> None:
    place = tmp_path / "out"
    claim = claim_file if kind == "file" else claim_folder
    with held_elsewhere(kind, place) as process:
        told = rf"out is being written by process {process.pid} on \S+ since [-\d]+ [:\d]+: .*-c .*; wait, or choose "
        with pytest.raises(OutputError, match=told) as refused:
            claim(place)
    assert "\n" not in str(refused.value)
    assert locks_in(tmp_path) == []  # it ended, and so did its lock
    claim(place)


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_the_lock_of_a_killed_process_is_taken_over_at_once(kind: str, tmp_path: Path) -> None:
    place = tmp_path / "out"
    with held_elsewhere(kind, place) as process:
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert len(locks_in(tmp_path)) == 1
        with claims():
            (claim_file if kind == "file" else claim_folder)(place)
            said = lock_of(place, is_folder=kind == "folder").read_text(encoding="utf-8")
            assert said.startswith(f"{os.getpid()}\n")
    assert locks_in(tmp_path) == []


def test_what_lies_in_a_held_folder_is_held_too(tmp_path: Path) -> None:
    inside = tmp_path / "run" / "library"
    inside.mkdir(parents=True)
    with held_elsewhere("folder", tmp_path / "run") as process:
        for claim in (claim_file, claim_folder):
            with pytest.raises(OutputError, match=r"library lies in .*run, which is being written by process"):
                claim(inside)
        process.kill()
        process.wait()
        claim_folder(inside)
    assert locks_in(tmp_path) == []


def test_a_call_within_may_claim_what_the_call_around_it_holds(tmp_path: Path) -> None:
    with claims():
        claim_folder(tmp_path / "run")
        with claims():
            claim_folder(tmp_path / "run")
            claim_folder(tmp_path / "run" / "library")
            claim_file(tmp_path / "run" / "policy")
        assert locks_in(tmp_path) == [".cornerforge.lock"]
    assert locks_in(tmp_path) == []


def test_another_thread_may_not(tmp_path: Path) -> None:
    refused: list[str] = []

    def claim() -> None:
        with claims(), pytest.raises(OutputError, match="another call in this process") as told:
            claim_folder(tmp_path)
        refused.append(str(told.value))

    with claims():
        claim_folder(tmp_path)
        thread = threading.Thread(target=claim)
        thread.start()
        thread.join()
    assert len(refused) == 1


def test_folders_made_for_a_lock_are_removed_if_nothing_came_of_the_call(tmp_path: Path) -> None:
    @claims()
    def interrupted() -> None:
        claim_file(tmp_path / "new" / "newer" / "policy")
        assert locks_in(tmp_path) == [".policy.cornerforge.lock"]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match=r"Cannot write .*file/in: Not a directory; make room, or choose"):
        claim_file(tmp_path / "file" / "in")


@pytest.mark.parametrize("claim", [claim_file, claim_folder])
@pytest.mark.parametrize("what", ["link", "dangling link", "hard link", "pipe", "folder"])
def test_a_lock_is_a_file_of_its_own(claim: Callable[[Path], None], what: str, tmp_path: Path) -> None:
    """A stranger's folder may hold anything at the lock's name: it is neither written, cut off, nor waited for."""
    place, other = tmp_path / "out", tmp_path / "other"
    lock = lock_of(place, is_folder=claim is claim_folder)
    lock.parent.mkdir(exist_ok=True)
    if what != "dangling link":
        other.write_text("mine", encoding="utf-8")
    if "hard" in what:
        os.link(other, lock)
    elif "link" in what:
        lock.symlink_to(other)
    else:
        os.mkfifo(lock) if what == "pipe" else lock.mkdir()
    with claims(), pytest.raises(OutputError, match=r"is a link or no file, so it is no lock of cornerforge's; remove"):
        claim(place)
    assert other.exists() == (what != "dangling link")
    assert not other.exists() or other.read_text(encoding="utf-8") == "mine"
    assert os.path.lexists(lock)
    with claims():  # of a folder above, a lock that is none holds nothing up
        claim_file(tmp_path / "out" / "below" / "file")
    assert not other.exists() or other.read_text(encoding="utf-8") == "mine"


@pytest.mark.full
def test_of_many_processes_that_start_together_one_gets_the_place(tmp_path: Path) -> None:
    place, go = tmp_path / "out", tmp_path / "go"
    script = _HOLDER.replace("with claims", f"\nwhile not Path({str(go)!r}).exists(): time.sleep(0.0005)\nwith claims")
    waiting = [
        subprocess.Popen(
            [sys.executable, "-c", script, "folder", str(place)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )
        for _ in range(6)
    ]  # fmt: skip
    try:
        time.sleep(0.5)
        go.touch()
        losers = [process for process in waiting if process.stdout and process.stdout.readline() != "held\n"]
    finally:
        ends = [process.communicate("")[1] for process in waiting]
    assert len(losers) == 5
    assert sum("is being written by" in said for said in ends) == 5
    assert locks_in(tmp_path) == []


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP])
def test_without_the_systems_locks_the_file_decides(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(descriptor: int, operation: int) -> None:  # noqa: ARG001
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("fcntl.flock", refuse)
    place, refused = tmp_path / "out", threading.Event()

    def claim() -> None:
        for wanted in (place, place / "in"):
            with (
                claims(),
                pytest.raises(OutputError, match=r"out,? .*is being written by another call in this process;"),
            ):
                claim_folder(wanted)
        refused.set()

    with claims():
        claim_folder(place)
        thread = threading.Thread(target=claim)
        thread.start()
        thread.join()
    assert refused.is_set()
    assert not place.exists()
    with subprocess.Popen(["true"]) as ended:
        ended.wait()
    tmp_path.joinpath(".cornerforge.lock").write_text(f"{ended.pid}\n{os.uname().nodename}\n", encoding="utf-8")
    claim_folder(tmp_path)  # of a killed process
    assert locks_in(tmp_path) == []
    tmp_path.joinpath(".cornerforge.lock").write_text("1\nelsewhere\n", encoding="utf-8")
    file = re.escape(str(lock_of(tmp_path, is_folder=True)))
    with pytest.raises(
        OutputError, match=rf"process 1 on elsewhere; wait, or choose another place, or remove {file} if"
    ):
        claim_folder(tmp_path)
    assert locks_in(tmp_path) == [".cornerforge.lock"]
