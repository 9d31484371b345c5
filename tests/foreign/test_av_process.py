"""The AV's own process: what goes wrong in it is stopped in time and said in one sentence."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

from cornerforge.errors import AvFaultError, CornerForgeError, FileFormatError, InputError
from cornerforge.foreign.process import AvFailureError, AvProcess
from cornerforge.foreign.session import context_of
from cornerforge.types import Odd

NOBODY = np.zeros(0, np.int64)


def started(spec: str, timeout: float = 20.0) -> AvProcess:
    process = AvProcess(spec, timeout=timeout, first_timeout=timeout)
    process.setup(context_of(Odd(), batch=4, seed=0))
    return process


def views() -> np.ndarray:
    view = np.zeros((4, 13, 8), np.float32)
    view[:, 0] = 1.0, 400.0, 6.0, 25.0, 0.0, 0.0, 1.0, 0.0
    return view


def test_it_answers(avs: Path) -> None:  # noqa: ARG001
    process = started("avs:Good")
    np.testing.assert_allclose(process.act(views(), np.arange(4), np.arange(4))[0], [[1.0, 0.0]] * 4)
    assert process.about["kind"] == "class"
    process.close()


def test_it_may_print_write_into_its_view_and_answer_in_integers(avs: Path) -> None:  # noqa: ARG001
    for name in ("Prints", "Writes", "Integers"):
        process = started(f"avs:{name}")
        first, second = (process.act(views(), NOBODY, NOBODY)[0].copy() for _ in range(2))
        np.testing.assert_array_equal(first, second)
        process.close()


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("name", "what", "text"),
    [
        ("RaisesAtOnce", "raised", r"raised ZeroDivisionError\(at once\) \(avs.py:\d+\)"),
        ("WrongShape", "answer", r"array of shape \(4,\); expected \(4, 2\)"),
        ("WrongType", "answer", "complex128; allowed: real numbers"),
        ("NotAnArray", "answer", "no usable answer"),
        ("HangsAtOnce", "hung", "gave no answer within 3 s"),
    ],
)
def test_what_goes_wrong_is_named(avs: Path, name: str, what: str, text: str) -> None:  # noqa: ARG001
    process = started(f"avs:{name}", timeout=3.0 if name == "HangsAtOnce" else 20.0)
    begin = time.monotonic()
    with pytest.raises(AvFailureError, match=text) as failure:
        process.act(views(), NOBODY, NOBODY)
    assert failure.value.what == what
    if what == "hung":
        assert time.monotonic() - begin < 30.0  # it would sleep for a minute
    process.close()
    assert process._process.returncode is not None  # nothing stays behind


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("import os; os._exit(7)", "exit status 7"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "SIGSEGV"),
    ],
)
def test_a_process_that_ends_is_named(avs: Path, code: str, text: str) -> None:
    (avs / "ender.py").write_text(f"class Av:\n    def act(self, view):\n        {code}\n", encoding="utf-8")
    process = started("ender:Av")
    with pytest.raises(AvFailureError, match=text) as failure:
        process.act(views(), NOBODY, NOBODY)
    assert failure.value.what == "ended"


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("spec", "text"),
    [
        ("gone:Av", "No module gone for the AV gone:Av"),
        ("avs.gone:Av", "No module avs.gone"),
        ("avs:Goood", 'No class in module avs "Goood". Did you mean "Good"?'),
        ("avs:np", "is a module, not a class"),
        ("avs:Base", r"is no AV: it has no method act\(view\)"),
        ("avs:", "names no AV; write it as package.module:Class"),
        ("a b:Av", "names no AV"),
        ("broken:Av", r"Importing broken .* SyntaxError"),
        ("needs:Av", r"Importing needs .* failed: No module named 'not_there' \(needs.py:1\)"),
        ("picky:Av", r"picky:Av cannot be made: TypeError"),
        ("abstract:Av", r"abstract:Av cannot be made: TypeError"),
    ],
)
def test_what_is_no_av_is_refused(avs: Path, spec: str, text: str) -> None:
    (avs / "broken.py").write_text("class Av(:\n", encoding="utf-8")
    (avs / "needs.py").write_text("import not_there\n", encoding="utf-8")
    (avs / "picky.py").write_text("class Av:\n    def __init__(self, x): ...\n    def act(self, v): ...\n")
    (avs / "abstract.py").write_text("from cornerforge.foreign import Av as Base\nclass Av(Base): ...\n")
    with pytest.raises(InputError, match=text):
        AvProcess(spec, timeout=20.0, first_timeout=60.0)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["gone.zip", "gone.onnx", "text.zip", "text.onnx"])
def test_files_that_are_no_avs_are_refused(avs: Path, name: str) -> None:
    pytest.importorskip("torch" if name.endswith("zip") else "onnxruntime")
    for suffix in ("zip", "onnx"):
        (avs / f"text.{suffix}").write_text("no network", encoding="utf-8")
    with pytest.raises(FileFormatError, match=name):
        AvProcess(name, timeout=60.0, first_timeout=60.0)


def test_setup_that_fails_is_named(avs: Path) -> None:
    (avs / "bad_setup.py").write_text(
        "class Av:\n    def setup(self, c): raise KeyError('weights')\n    def act(self, v): ...\n", encoding="utf-8"
    )
    with pytest.raises(AvFaultError, match=r"raised KeyError\('weights'\) \(bad_setup.py:2\) in setup"):
        started("bad_setup:Av")


def test_the_hash_is_that_of_the_source(avs: Path) -> None:
    first = AvProcess("avs:Good", timeout=20.0, first_timeout=20.0).about["hash"]
    assert first == AvProcess("avs:Good", timeout=20.0, first_timeout=20.0).about["hash"]
    assert first != AvProcess("avs:Nan", timeout=20.0, first_timeout=20.0).about["hash"]
    with (avs / "avs.py").open("a", encoding="utf-8") as file:
        file.write("# changed\n")
    assert first != AvProcess("avs:Good", timeout=20.0, first_timeout=20.0).about["hash"]


def test_it_ends_with_its_owner(avs: Path) -> None:  # noqa: ARG001
    process = started("avs:Good")
    pid = process._process.pid
    del process
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_every_refusal_is_a_plain_line(avs: Path) -> None:  # noqa: ARG001
    with pytest.raises(CornerForgeError) as refusal:
        AvProcess("gone:Av", timeout=20.0, first_timeout=20.0)
    assert "\n" not in str(refusal.value)
