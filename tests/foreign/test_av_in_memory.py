"""The double of an AV's process and the process itself: the same answers, the same failures, the same log."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign.av_in_memory import AvInMemory, patched

from cornerforge.errors import CornerForgeError
from cornerforge.foreign.process import AvFailureError, AvProcess
from cornerforge.foreign.scene import COLUMNS
from cornerforge.foreign.session import context_of
from cornerforge.sim.av_scene import SCENE_COLUMNS
from cornerforge.types import Odd

NOBODY = np.zeros(0, np.int64)

ODD_ONES = """
import os, signal, sys, time
import numpy as np

CALLS = []  # of this process

class Plain:
    def act(self, view):
        return np.zeros((len(view), 2))

class Leaves(Plain):
    def act(self, view): sys.exit(3)
class Bids(Plain):
    def act(self, view): sys.exit('bye')
class Base(Plain):
    def act(self, view): raise BaseException('base')
class Ends(Plain):
    def act(self, view): os._exit(7)
class Aborts(Plain):
    def act(self, view): os.abort()
class Kills(Plain):
    def act(self, view): os.kill(os.getpid(), signal.SIGKILL)
class Faults(Plain):
    def act(self, view): os.kill(os.getpid(), signal.SIGSEGV)
class Sleeps(Plain):
    def act(self, view): time.sleep(60)
class Naps(Plain):
    def act(self, view):
        time.sleep(0.01)
        return super().act(view)
class Later(Plain):
    "Fails at its third question."
    def act(self, view):
        CALLS.append(1)
        if len(CALLS) == 3: raise ValueError('third')
        return super().act(view) + len(CALLS)
class Counts(Plain):
    def setup(self, context): self.n = np.zeros(context.batch)
    def reset(self, worlds, seeds): self.n[worlds] = seeds
    def act(self, view):
        self.n += 1
        return np.stack([self.n, 0 * self.n], axis=1)
class Nan(Plain):
    def act(self, view): return np.full((len(view), 2), np.nan)
class Prints(Plain):
    def act(self, view):
        print('hello')
        print('trouble', file=sys.stderr)
        return super().act(view)
class Warns(Plain):
    def act(self, view):
        open('odd_ones.py').read()  # and never closes it
        return super().act(view) * np.log(np.zeros(1))
class Setup(Plain):
    def setup(self, context): raise KeyError('weights')
class SetupEnds(Plain):
    def setup(self, context): sys.exit(4)
class Unmade(Plain):
    def __init__(self): raise OSError('no weights')
class Gone(Plain):
    def __init__(self): os._exit(5)
class Late(Plain):
    def __init__(self): time.sleep(60)
class Path:
    answers = 'trajectory'
    def plan(self, scene):
        if scene.own.y > 8: raise ValueError('too far left')
        return [[t, scene.own.x + 25.0 * t, scene.own.y] for t in (0.0, 0.5, 1.0)]
class Wish:
    answers = 'wish'
    def plan(self, scene): ...
class Policy:
    def predict(self, observation): return int(observation[0, 2])
"""
CASES = {
    "answers": ("avs:Good", 3),
    "integers": ("avs:Integers", 1),
    "writes into its view": ("avs:Writes", 2),
    "no array": ("avs:NotAnArray", 1),
    "wrong shape": ("avs:WrongShape", 1),
    "complex numbers": ("avs:WrongType", 1),
    "NaN": ("odd_ones:Nan", 2),
    "raises": ("avs:RaisesAtOnce", 2),
    "raises later and is made anew": ("odd_ones:Later", 6),
    "remembers": ("odd_ones:Counts", 4),
    "naps": ("odd_ones:Naps", 1),
    "prints": ("odd_ones:Prints", 2),
    "warns": ("odd_ones:Warns", 1),
    "exit": ("odd_ones:Leaves", 2),
    "exit with words": ("odd_ones:Bids", 1),
    "BaseException": ("odd_ones:Base", 1),
    "_exit": ("odd_ones:Ends", 2),
    "abort": ("odd_ones:Aborts", 1),
    "SIGKILL": ("odd_ones:Kills", 1),
    "SIGSEGV": ("odd_ones:Faults", 1),
    "hangs": ("odd_ones:Sleeps", 2),
    "fails in setup": ("odd_ones:Setup", 1),
    "ends in setup": ("odd_ones:SetupEnds", 1),
    "cannot be made": ("odd_ones:Unmade", 1),
    "ends when it is made": ("odd_ones:Gone", 1),
    "hangs when it is made": ("odd_ones:Late", 1),
    "plans world by world": ("odd_ones:Path", 2),
    "says what cannot be": ("odd_ones:Wish", 1),
    "a policy": ("odd_ones:Policy", 2),
    "no module": ("gone:Av", 1),
    "no class": ("avs:Goood", 1),
    "a file": ("odd_ones.py:Counts", 2),
    "no such file": ("gone.py:Av", 1),
    "half a module": ("broken:Av", 1),
}
"""AVs, and how often they are asked."""


def views(process: AvProcess) -> np.ndarray:
    """Four worlds, as such an AV sees them; the last one drives no test."""
    if process.about["form"] == "view":
        view: np.ndarray = np.zeros((4, 13, 8), np.float32)
        view[:, 0] = 1.0, 400.0, 6.0, 25.0, 0.0, 0.0, 1.0, 0.0
        view[3] = 0.0
        return view
    scene = np.zeros((4, 3, SCENE_COLUMNS))
    scene[:3, 0, COLUMNS.index("length")] = 5.0
    scene[1, 0, COLUMNS.index("y")] = 9.0
    return scene


def told(make: Callable[..., AvProcess], spec: str, questions: int, processes: int) -> list[Any]:
    """All that comes of an AV: what it is, its answers, its failures, whether it is made anew after these, its log."""
    found: list[Any] = []
    for _ in range(processes):  # each begins anew
        try:
            process = make(spec, timeout=3.0, first_timeout=3.0)
        except CornerForgeError as error:
            found.append((type(error), plain(str(error)), notes(error)))
            continue
        found.append(process.about)
        context = context_of(Odd(), batch=4, seed=5)
        try:
            process.setup(context)
        except CornerForgeError as error:
            found.append((type(error), plain(str(error)), notes(error)))
            continue
        for k in range(questions):
            fresh = np.arange(4) if k == 0 else NOBODY
            try:
                answers, failed = process.act(views(process), fresh, 10 * fresh)
                found.append((answers.tolist(), failed))
            except AvFailureError as failure:
                found += [(failure.what, str(failure), notes(failure)), process.renew(context)]
                if not found[-1]:
                    break
        process.close()
        kept = process.log.named()
        log = "" if kept is None else kept.read_text(encoding="utf-8")
        found.append(
            sorted(line for line in log.splitlines() if re.search("^hello|^trouble|^bye|^cornerforge: |Warning", line))
        )
    return found


def plain(text: str) -> str:
    """A message without the name of the log."""
    return re.sub(r"cornerforge-av-\w+", "LOG", text)


def notes(error: BaseException) -> list[str]:
    return getattr(error, "__notes__", [])


@pytest.mark.sampled(4)
@pytest.mark.parametrize("case", CASES)
def test_the_double_gives_what_the_process_gives(avs: Path, case: str) -> None:
    (avs / "odd_ones.py").write_text(ODD_ONES, encoding="utf-8")
    (avs / "broken.py").write_text("class Av(:\n", encoding="utf-8")
    processes = 1 if "hangs" in case else 2
    expected = told(AvProcess, *CASES[case], processes)
    with patched():
        found = told(AvInMemory, *CASES[case], processes)
    assert repr(found) == repr(expected)  # NaN is NaN


def test_two_doubles_know_nothing_of_each_other(avs: Path) -> None:
    (avs / "odd_ones.py").write_text(ODD_ONES, encoding="utf-8")
    with patched():
        first, second = (AvInMemory("odd_ones:Later", timeout=3.0, first_timeout=3.0) for _ in range(2))
        for process in (first, second):
            process.setup(context_of(Odd(), batch=4, seed=0))
        given = [process.act(views(process), NOBODY, NOBODY)[0][0, 0] for process in (first, second, first, second)]
    assert given == [1.0, 1.0, 2.0, 2.0]
