"""What an AV prints is kept in a file, its traceback is shown whole, and it cannot disturb the protocol."""

from __future__ import annotations

import json
import re
import socket
import struct
import threading
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import AvFaultError
from cornerforge.foreign.av_log import AvLog
from cornerforge.foreign.process import AvFailureError, AvProcess
from cornerforge.foreign.protocol import ANSWER, JunkError, pack, receive, unpack_json
from cornerforge.foreign.session import context_of
from cornerforge.types import Odd

NOBODY = np.zeros(0, np.int64)
NOISY = """
import os, socket, struct, sys
import numpy as np

class Quiet:
    def act(self, view):
        return np.stack([np.clip(0.3 * (30.0 - view[:, 0, 3]), -3, 1), np.zeros(len(view))], axis=1)
class Chatty(Quiet):
    def act(self, view):
        for k in range(256):
            print("world", k, "\\udce4", flush=False)
        print("to the other", file=sys.stderr)
        return super().act(view)
class Closes(Quiet):
    def act(self, view):
        os.close(1); os.close(2)
        return super().act(view)
class Shuts(Quiet):
    def act(self, view):
        sys.stdout.close(); sys.stderr.close()
        return super().act(view)
class Deep(Quiet):
    calls = 0
    def act(self, view):
        self.calls += 1
        if (view[:, 0, 0] == 1).any() and self.calls > 3:
            self.first(view)
        return super().act(view)
    def first(self, view):
        print("before the end")
        try:
            self.second(view)
        except KeyError as error:
            raise ValueError("of the planner") from error
    def second(self, view):
        raise KeyError("the root")
class Unprintable(Quiet):
    def act(self, view):
        class Odd(Exception):
            def __str__(self): raise RuntimeError
        raise Odd
def ours():
    "The socket to the simulator."
    for n in range(3, 64):
        try:
            if os.path.exists(f"/proc/self/fd/{n}") and "socket" in os.readlink(f"/proc/self/fd/{n}"):
                return n
        except OSError:
            pass
class Junk(Quiet):
    def act(self, view):
        os.write(ours(), b"x" * 64)
        return super().act(view)
class Huge(Quiet):
    def act(self, view):
        os.write(ours(), struct.pack("<cQQ", b".", 3, 1 << 42))
        return super().act(view)
class Short(Quiet):
    def act(self, view):
        os.write(ours(), struct.pack("<cQQ", b".", 3, 4) + b"abcd")
        return super().act(view)
class Wrong(Quiet):
    def act(self, view):
        os.write(ours(), struct.pack("<cQQqd", b".", 3, 16, 0, 1.0))
        return super().act(view)
class Says(Quiet):
    def act(self, view):
        os.write(ours(), struct.pack("<cQQ", b"!", 3, 2) + b"{}")
        return super().act(view)
class Before(Quiet):
    def act(self, view):
        os.write(ours(), struct.pack("<cQQq", b".", 2, 8 + 64, 0) + bytes(64))
        return super().act(view)
class ClosesAll(Quiet):
    def act(self, view):
        os.closerange(3, 1024)
        return super().act(view)
"""


@pytest.fixture
def noisy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    (tmp_path / "noisy.py").write_text(NOISY, encoding="utf-8")
    return tmp_path


def started(name: str) -> AvProcess:
    process = AvProcess(f"noisy:{name}", timeout=20.0, first_timeout=20.0)
    process.setup(context_of(Odd(), batch=4, seed=0))
    return process


def views() -> np.ndarray:
    view = np.zeros((4, 13, 8), np.float32)
    view[:, 0] = 1.0, 400.0, 6.0, 25.0, 0.0, 0.0, 1.0, 0.0
    return view


@pytest.mark.full
def test_what_it_prints_goes_to_the_log_and_nowhere_else(noisy: Path, capfd: pytest.CaptureFixture[str]) -> None:
    run = cornerforge.simulate(av="noisy:Chatty", tests=3, out=noisy / "lib")
    assert run.av_faults == 0
    assert capfd.readouterr() == ("", "")
    text = (noisy / "lib" / "av.log").read_text(encoding="utf-8")
    assert "world 255 \\udce4\n" in text
    assert "to the other\n" in text
    assert list(noisy.glob("cornerforge-av-*")) == []
    assert run.digest == cornerforge.simulate(av="noisy:Quiet", tests=3, out=noisy / "quiet").digest
    assert not (noisy / "quiet" / "av.log").exists()


@pytest.mark.full
@pytest.mark.usefixtures("in_memory")
def test_tests_left_out_are_named_in_the_log(avs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--av", "avs:Nan", "--tests", "200", "--out", "lib"]) == 0
    told = capsys.readouterr().out
    text = (avs / "lib" / "av.log").read_text(encoding="utf-8")
    found = re.findall(r"^cornerforge: left out test (\d+) of seed 0: the AV answered with NaN", text, re.MULTILINE)
    assert f"{len(found)} tests left out, because the AV raised, hung or gave no usable answer in them" in told
    assert len(set(found)) == len(found) > 0
    assert f"; what it printed, and its tracebacks: {Path('lib') / 'av.log'}." in told


@pytest.mark.parametrize("name", ["Closes", "Shuts"])
@pytest.mark.usefixtures("noisy")
def test_it_may_close_its_streams(name: str) -> None:
    process = started(name)
    np.testing.assert_allclose(process.act(views(), NOBODY, NOBODY)[0], [[1.0, 0.0]] * 4)
    process.close()


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("Junk", r"disturbed the socket through which it is asked \(b'x{17}' begins no message\)"),
        ("Before", r"disturbed the socket .* for question 2, to question 3\)"),
        ("Huge", r"disturbed the socket .* begins no message"),
        ("Short", r"disturbed the socket .*a reply of 4 bytes"),
        ("Wrong", r"disturbed the socket"),
        ("Says", r"disturbed the socket"),
        ("ClosesAll", r"ended its process \((it closed its connection|exit status \d+)\)"),
    ],
)
@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="there is no /proc to find the socket")
@pytest.mark.usefixtures("noisy")
def test_what_disturbs_the_socket_is_a_plain_message(name: str, text: str) -> None:
    process = started(name)
    with pytest.raises(AvFailureError, match=text) as failure:
        process.act(views(), NOBODY, NOBODY)
    assert "\n" not in str(failure.value)
    assert process._process.returncode is not None or name == "ClosesAll"
    process.close()


def test_a_frame_is_checked_before_memory_is_taken_for_it() -> None:
    for head in (struct.pack("<cQQ", ANSWER, 1, (1 << 30) + 1), struct.pack("<cQQ", b"z", 1, 1)):
        ours, theirs = socket.socketpair()
        with ours, theirs:
            theirs.sendall(head)
            with pytest.raises(JunkError, match="begins no message"):
                receive(ours)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        threading.Thread(target=theirs.sendall, args=(pack(ANSWER, 7, b"x" * 1_000_000),)).start()
        assert receive(ours) == (ANSWER, 7, bytearray(b"x" * 1_000_000))
    for body in (b"", b"{", b"[1]", b"\xff", b"[" * 100_000):
        with pytest.raises(JunkError):
            unpack_json(body)


def test_an_exception_without_a_text_is_named(noisy: Path) -> None:  # noqa: ARG001
    process = started("Unprintable")
    with pytest.raises(AvFailureError, match=r"raised Odd\(\?\) \(noisy.py:\d+\)") as failure:
        process.act(views(), NOBODY, NOBODY)
    assert "in act\n" in failure.value.trace
    process.close()


def whole(text: str) -> bool:
    """Is the traceback whole: all frames of the AV, and the cause?"""
    return all(part in text for part in ("in first", "in second", "KeyError: 'the root'", "ValueError: of the planner"))


@pytest.mark.full
@pytest.mark.usefixtures("in_memory")
def test_the_traceback_is_whole_in_the_log_in_debug_and_in_check_av(
    noisy: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", "--av", "noisy:Deep", "--tests", "40"]) == 2
    told = capfd.readouterr().err
    assert "Traceback" not in told
    assert re.search(r"raised ValueError\(of the planner\) \(noisy.py:\d+\)", told)
    named = re.search(r"; what it printed: (\S+\.log)", told)
    assert named is not None
    text = Path(named.group(1)).read_text(encoding="utf-8")
    assert whole(text)
    assert "before the end\n" in text
    assert main(["simulate", "--av", "noisy:Deep", "--tests", "40", "--debug"]) == 2
    assert whole(capfd.readouterr().err)
    assert main(["check-av", "noisy:Deep", "--tests", "4"]) == 1
    shown = capfd.readouterr().out
    assert whole(shown)
    assert shown.count("KeyError: 'the root'") <= 2  # the trials tell it once, the tests once more if at another line
    last = re.search(r"what it printed, and its tracebacks: (\S+\.log)\n", shown)
    assert last is not None
    assert whole(Path(last.group(1)).read_text(encoding="utf-8"))
    assert main(["check-av", "noisy:Deep", "--tests", "4", "--json"]) == 1
    found = json.loads(capfd.readouterr().out)
    assert any(whole(check.get("trace", "")) for check in found["checks"])
    assert Path(found["log"]).exists()
    assert len(list(noisy.glob("cornerforge-av-*"))) >= 3


def test_an_error_of_python_carries_the_traceback(noisy: Path) -> None:
    (noisy / "bad_setup.py").write_text(
        "class Av:\n    def setup(self, c): raise KeyError('weights')\n    def act(self, v): ...\n", encoding="utf-8"
    )
    process = AvProcess("bad_setup:Av", timeout=20.0, first_timeout=20.0)
    with pytest.raises(AvFaultError, match=r"in setup; what it printed: \S+\.log$") as fault:
        process.setup(context_of(Odd(), batch=4, seed=0))
    cause = fault.value.__cause__
    assert isinstance(cause, AvFailureError)
    assert "bad_setup.py" in cause.trace
    assert any("in setup" in note for note in cause.__notes__)


# --- the file ---


def test_the_file_keeps_the_last_of_it(tmp_path: Path) -> None:
    log = AvLog(most=1000)
    log.keep_in(tmp_path / "av.log")
    assert not (tmp_path / "av.log").exists()
    for k in range(500):
        log.write(f"line {k}\n".encode())
        assert (tmp_path / "av.log").stat().st_size <= 1000
    said, *lines = (tmp_path / "av.log").read_text(encoding="utf-8").splitlines()
    assert said == "cornerforge: earlier output is left out; this file holds 1,000 bytes or less"
    assert len(lines) > 40
    assert lines == [f"line {k}" for k in range(500 - len(lines), 500)]
    log.write(b"x" * 5000)
    assert (tmp_path / "av.log").read_bytes() == f"{said}\n".encode() + b"x" * 500
    (tmp_path / "av.log").unlink()
    assert log.pointer() == ""


def test_it_goes_on_in_its_place_and_temporary_files_leave(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / "av.log").write_text("before\n", encoding="utf-8")
    log = AvLog()
    log.write(b"first\n")
    assert len(list(tmp_path.glob("cornerforge-av-*.log"))) == 1
    log.keep_in(tmp_path / "av.log")
    log.keep_in(tmp_path / "elsewhere.log")
    log.write(b"second\n")
    assert (tmp_path / "av.log").read_text(encoding="utf-8") == "before\nfirst\nsecond\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["av.log"]
    unnamed, named = AvLog(), AvLog()
    for one in (unnamed, named):
        one.write(b"text\n")
    kept = named.named()
    assert AvLog().pointer() == ""
    del unnamed, named, one
    assert [path for path in tmp_path.iterdir() if path.name != "av.log"] == [kept]


def test_a_place_that_cannot_be_written_ends_nothing(tmp_path: Path) -> None:
    log = AvLog()
    log.keep_in(tmp_path / "gone" / "av.log")
    log.write(b"text\n")
    log.note("raised", "a traceback")
    assert log.trace("raised") == "a traceback"
