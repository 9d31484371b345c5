"""Small AVs, each in a module of its own in the working directory: some good, some that fail in one way."""

from __future__ import annotations

from pathlib import Path
from textwrap import indent

import pytest

# Every AV remembers the seeds of its tests, so that a fault can be tied to tests and not to rows of a batch.
BASE = """
import os, signal, sys, time
import numpy as np

class Base:
    def setup(self, context):
        self.context = context
        self.seeds = np.zeros(context.batch, np.int64)
        self.calls = np.zeros(context.batch, np.int64)
    def reset(self, worlds, seeds):
        self.seeds[worlds] = seeds
        self.calls[worlds] = 0
    def struck(self, view, one_in):
        "Worlds in trouble: one test in so many, at its 21st decision."
        self.calls += 1
        return (view[:, 0, 0] == 1) & (self.seeds % one_in == 0) & (self.calls == 21)
    def fail_once(self):
        if not os.path.exists('once'):
            open('once', 'w').close()
            raise ValueError('once')
    def good(self, view):
        av, lead = view[:, 0], view[:, 1]
        return np.stack([np.clip(0.3 * (30.0 - av[:, 3]), -3, 1), np.zeros(len(view))], axis=1)
"""

AVS = {
    "Good": "return self.good(view)",
    "Raises": "if self.struck(view, 61).any(): raise ValueError('on purpose')\nreturn self.good(view)",
    "Hangs": "if self.struck(view, 97).any(): time.sleep(60)\nreturn self.good(view)",
    "Exits": "if self.struck(view, 97).any(): sys.exit(3)\nreturn self.good(view)",
    "Segfaults": "if self.struck(view, 97).any(): os.kill(os.getpid(), signal.SIGSEGV)\nreturn self.good(view)",
    "Nan": "a = self.good(view); a[self.struck(view, 40), 0] = np.nan; return a",
    "BadOrder": "a = self.good(view); a[self.struck(view, 40), 1] = 0.5; return a",
    "Flaky": "self.n = getattr(self, 'n', 0) + 1\nif self.n == 40: self.fail_once()\nreturn self.good(view)",
    "AlwaysRaises": "self.calls += 1\nif (self.calls > 9).any(): raise ValueError('always')\nreturn self.good(view)",
    "RaisesAtOnce": "raise ZeroDivisionError('at once')",
    "HangsAtOnce": "time.sleep(60)",
    "WrongShape": "return self.good(view)[:, 0]",
    "WrongType": "return self.good(view).astype(complex)",
    "NotAnArray": "return 'brake'",
    "Random": "a = self.good(view); a[:, 0] += np.random.default_rng().normal(size=len(a)); return a",
    "Neighbours": "a = self.good(view); a[:, 0] += 0.1 * np.roll(view[:, 0, 3], 1) - 3; return a",
    "Prints": "print('hello'); return self.good(view)",
    "Integers": "return np.zeros((len(view), 2), dtype=np.int32)",
    "Accelerates": "return np.stack([np.full(len(view), 2.0), np.zeros(len(view))], axis=1)",
    "Counts": "self.calls += 1; a = self.good(view); a[:, 0] += 0.2 * (self.calls % 7); return a",
    "Writes": "a = self.good(view); view[:] = 7; return a",
}

FORGETFUL = """
class Forgetful:
    def act(self, view):
        return Base.good(self, view)
"""


@pytest.fixture
def avs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with a module `avs`."""
    classes = [
        f"class {name}(Base):\n    def act(self, view):\n{indent(body, 8 * ' ')}\n" for name, body in AVS.items()
    ]
    (tmp_path / "avs.py").write_text(BASE + "\n".join(classes) + FORGETFUL, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def twins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A module of AVs that drive as the built-in AV `rl`, but for one that draws random numbers."""
    source = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parents[1])!r})
import numpy as np
from learned_twin import Twin

class Dice(Twin):
    def act(self, view):
        answers = super().act(view)
        answers[:, 0] += 0.1 * np.random.default_rng().normal(size=len(view))
        return answers
"""
    (tmp_path / "twins.py").write_text(source, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
