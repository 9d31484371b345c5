"""Cases of AVs from outside, made smaller: the AV is asked about each part, and begins each without memory."""

from __future__ import annotations

from pathlib import Path

import pytest

import cornerforge
from cornerforge.errors import AvFaultError
from cornerforge.library import CaseLibrary

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("in_memory")]

WEAVES = """
import numpy as np

class Weaves:
    answers = "trajectory"
    def reset(self, seed):
        self.phase, self.seen = seed % 628 / 100, 0.0
    def plan(self, scene):
        if len(scene.others) < int(open("fewest").read()):
            raise ValueError("too few")
        own, t = scene.own, np.arange(0, 2, 0.2)
        self.seen += sum(o.vx for o in scene.others) * 1e-3
        y = own.y + 0.01 * t * np.sin(self.phase + self.seen)
        return np.stack([t, own.x + own.vx * t, y], axis=1)
"""


def generated(av: str, out: Path, cases: int) -> Path:
    cornerforge.generate(policy="swerve", av=av, cases=cases, out=out, seed=3)
    return out


@pytest.mark.usefixtures("twins")
def test_they_become_the_same_as_those_of_the_same_av_inside(tmp_path: Path) -> None:
    """The AV `rl` decides every half second, so it drives otherwise if it is not told that a drive begins."""
    small = [
        cornerforge.shrink(generated(av, tmp_path / name, 2), "all", out=tmp_path / f"{name}-small")
        for name, av in (("inside", "rl"), ("outside", "twins:Twin"))
    ]
    assert small[0].cases == small[1].cases
    assert small[0].median.after.vehicles < small[0].median.before.vehicles
    inside, outside = (CaseLibrary.open(Path(library.library)) for library in small)
    assert inside.scalars(["trajectory_digest"]) == outside.scalars(["trajectory_digest"])
    said = cornerforge.replay(small[1].library, "all", check=True)
    assert said.identical


@pytest.mark.slow
def test_an_av_that_steers_and_fails_at_times_keeps_what_it_needs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "weaves.py").write_text(WEAVES, encoding="utf-8")
    (tmp_path / "fewest").write_text("4", encoding="utf-8")
    library = generated("weaves:Weaves", tmp_path / "library", 2)
    small = cornerforge.shrink(library, "all", out=tmp_path / "small")
    for row in small.cases:
        assert 5 <= row.after.vehicles < row.before.vehicles
        assert row.after.seconds <= row.before.seconds
    assert any(row.after.seconds < row.before.seconds for row in small.cases), "no later start was ever accepted"
    assert cornerforge.replay(small.library, "all", check=True).identical


def test_an_av_that_fails_too_often_ends_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "weaves.py").write_text(WEAVES, encoding="utf-8")
    (tmp_path / "fewest").write_text("0", encoding="utf-8")
    library = generated("weaves:Weaves", tmp_path / "library", 1)
    case = CaseLibrary.open(library).scenario(CaseLibrary.open(library).scalars(["case_id"])["case_id"][0].as_py())
    (tmp_path / "fewest").write_text(str(case.scenario.slot.size - 2), encoding="utf-8")
    with pytest.raises(AvFaultError, match=r"raised ValueError\(too few\)"):
        cornerforge.shrink(library, "all", out=tmp_path / "small")
