"""`r157`, which is `suite run r157`: an AV in the regulation's scenarios, beside the reference drivers."""

from __future__ import annotations

import csv
import gzip
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge import cli
from cornerforge.drivers.careful import CAREFUL, HOLDS, SCENARIOS, crashes_at_cut_ins, drives_into
from cornerforge.errors import OutputError, UnknownNameError
from cornerforge.ext.studies import suite_run as module
from cornerforge.ext.studies.r157_roads import closing_at_least, cut_in_density
from cornerforge.ext.studies.r157_scenarios import R157
from cornerforge.ext.studies.scenarios import Panel, panels, rails_of_panel, road_of_suite
from cornerforge.library import CaseLibrary
from cornerforge.results import Regulated
from cornerforge.types import Odd

pytestmark = pytest.mark.full

VERDICTS = Path(__file__).parents[3] / "shared" / "data" / "r157" / "cut_in.csv.gz"
COLUMN = {"cc-human": "crash_cc_human", "reg157": "crash_reg157", "rss-brake": "crash_rss", "fsm": "crash_fsm"}
ROAD = road_of_suite(R157, Odd())
FAMILIES = [family.name for family in R157.families]
RAISES = """
class Raises:
    def act(self, view):
        if view[:, 0, 0].sum() > 0 and (view[:, 1, 0] == 1).any() and (view[:, 1, 1] < 15.0).any():
            raise ValueError("too near")
        import numpy as np
        return np.zeros((len(view), 2))
"""


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> list[Panel]:
    """One pair of speeds of each family, and of them one point in so many."""
    found, _ = panels(R157, FAMILIES, ROAD)
    wanted = {("cut-in", 60, 30), ("cut-out", 130, 0), ("deceleration", 130, 130)}
    chosen = [_thin(p) for p in found if (p.family.name, p.av_kmh, p.other_kmh) in wanted]
    monkeypatch.setattr(module, "panels", lambda suite, families, odd: (
        [p for p in chosen if p.family.name in set(families)], panels(suite, families, odd)[1]))  # fmt: skip
    return chosen


def _thin(panel: Panel) -> Panel:
    some = np.zeros_like(panel.possible)
    some[::3, ::3] = True
    return replace(panel, possible=panel.possible & some)


def judged(panel: Panel, driver: str) -> np.ndarray:
    return module._judge(panel, rails_of_panel(panel, ROAD), 1)[driver]


def test_grids_are_numbered_whatever_is_asked_for() -> None:
    every, too_fast = panels(R157, FAMILIES, ROAD)
    assert too_fast == []
    assert [p.first for p in every] == np.cumsum([0, *(len(p) for p in every[:-1])]).tolist()
    some, _ = panels(R157, ["deceleration"], ROAD)
    assert [p.first for p in some] == [p.first for p in every if p.family.name == "deceleration"]
    _, slow = panels(R157, FAMILIES, Odd(max_speed=30.0))
    assert slow == [130]


@pytest.mark.parametrize("driver", CAREFUL)
def test_the_judge_of_cut_ins_is_the_one_that_was_compared(driver: str) -> None:
    panel = next(p for p in panels(R157, ["cut-in"], ROAD)[0] if (p.av_kmh, p.other_kmh) == (90, 40))
    gap, across = panel.points
    alone = crashes_at_cut_ins(driver, 25.0, 40 / 3.6, gap, across)
    assert (judged(panel, driver) == alone).mean() > 0.998  # 37 s instead of 35 s


@pytest.mark.skipif(not VERDICTS.exists(), reason="the verdicts are no part of the repository")
@pytest.mark.parametrize("driver", CAREFUL)
def test_the_judge_crashes_where_the_public_implementation_does(driver: str) -> None:
    with gzip.open(VERDICTS, "rt", encoding="utf-8") as file:
        rows = {(int(r["ego_kmh"]), int(r["cut_in_kmh"]), float(r["gap_m"]), float(r["lateral_speed_mps"])):
                r[COLUMN[driver]] == "1" for r in csv.DictReader(file)}  # fmt: skip
    same = []
    for panel in panels(R157, ["cut-in"], ROAD)[0]:
        crashes = judged(panel, driver)
        for crash, gap, across in zip(crashes, *panel.points, strict=True):
            key = (panel.av_kmh, panel.other_kmh, float(gap), float(across))
            if key in rows:
                same.append(rows[key] == crash)
    assert len(same) == 16_167
    assert np.mean(same) >= 0.995


def test_the_careful_human_stops_behind_a_lead_that_brakes_by_1_g_at_2_s() -> None:
    """So the regulation says of it (Annex 4, Appendix 3); and so it does not, much nearer."""
    for panel in panels(R157, ["deceleration"], ROAD)[0]:
        gap, braking = panel.points
        crashes = judged(panel, "cc-human")
        assert not crashes[gap == 2.0].any()
        if panel.av_kmh >= 90:
            assert crashes[(gap == 1.0) & (braking > 9.0)].all()


def test_who_holds_its_speed_crashes_into_all_that_is_in_its_way() -> None:
    for panel in panels(R157, ["cut-out", "deceleration"], ROAD)[0][::3]:
        if panel.other_kmh == 0 or panel.family.name == "deceleration":
            assert judged(panel, "held speed").all()


def test_one_is_not_seen_past_a_nearer_one() -> None:
    """A standing car behind a lead that stays: nobody sees it, so nobody brakes before the lead does."""
    poses = np.full((101, 3, 7), np.nan)
    for slot, x, speed in ((1, 40.0, 20.0), (2, 300.0, 0.0)):
        poses[:, slot] = 0.0
        poses[:, slot, 0] = x + speed * 0.1 * np.arange(101)
        poses[:, slot, 2] = speed
    sizes = np.array([[4.3, 1.9]] * 3)
    hidden = drives_into(CAREFUL["fsm"], SCENARIOS["cut-out"], 20.0, (0.0, 0.0), sizes, poses[:60])
    assert hidden == -1
    aside = poses.copy()
    aside[:, 1, 1] = 0.4
    for name in ("cc-human", "fsm"):
        assert drives_into(CAREFUL[name], SCENARIOS["cut-out"], 20.0, (0.0, 0.0), sizes, aside) == -1
    assert drives_into(HOLDS, SCENARIOS["cut-out"], 20.0, (0.0, -2.0), sizes, aside) == -1


def test_what_is_said_is_what_happened(few: list[Panel], tmp_path: Path) -> None:
    said = cornerforge.r157(av="idm-mobil-blind", out=tmp_path / "out", lanes=2)
    assert said.scenarios == sum(map(len, few))
    library = CaseLibrary.open(tmp_path / "out" / "library")
    assert len(library) == said.failed == sum(family.failed for family in said.families) > 0
    rows = library.query("select crash_cc_human, crash_fsm, crash_held_speed, family, gap_m, time_gap_s from cases")[1]
    assert sum(not row[0] for row in rows) == said.failed_but_prevented_by["cc-human"]
    assert sum(not row[1] for row in rows) == said.failed_but_prevented_by["fsm"]
    assert sum(not row[2] for row in rows) == said.failed_but_held_speed_passes
    assert all(math.isnan(row[5]) for row in rows if row[3] == "cut-in")
    with (tmp_path / "out" / "scenarios.csv").open(encoding="utf-8") as file:
        listed = list(csv.DictReader(file))
    assert len(listed) == said.scenarios
    assert sum(row["av"] == "failed" for row in listed) == said.failed
    page = (tmp_path / "out" / "r157.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 3
    assert "http" not in page.split("</style>")[1]
    again = cornerforge.replay(tmp_path / "out" / "library", "all", check=True)
    assert again.identical
    retested = cornerforge.retest(tmp_path / "out" / "library", av="idm-mobil-blind")
    assert retested.recorded.still_crashing == said.failed
    other = cornerforge.r157(av="idm-mobil", out=tmp_path / "other", lanes=2)
    both = set(CaseLibrary.open(tmp_path / "other" / "library").scalars(["test"])["test"].to_pylist())
    here = set(library.scalars(["test"])["test"].to_pylist())
    retested = cornerforge.retest(tmp_path / "out" / "library", av="idm-mobil")
    assert retested.recorded.still_crashing == len(both & here)
    assert 0 < other.failed < said.failed
    first = library.scalars(["case_id"])["case_id"].to_pylist()[0]
    small = cornerforge.shrink(library.path, first, out=tmp_path / "small")
    assert small.median.after.seconds <= small.median.before.seconds
    assert cornerforge.replay(tmp_path / "small", "all", check=True).identical
    with pytest.raises(OutputError, match="is there already and not empty"):
        cornerforge.r157(out=tmp_path / "out")


@pytest.mark.usefixtures("few")
def test_threads_change_nothing_and_a_family_is_a_part() -> None:
    one = cornerforge.r157(av="cc-human", families=["deceleration"], threads=1)
    two = cornerforge.r157(av="cc-human", families="deceleration", threads=2)
    assert isinstance(one, Regulated)
    assert one.pairs == two.pairs
    assert [family.family for family in one.families] == ["deceleration"]
    assert one.roads_failed is None
    assert one.library is None


@pytest.mark.usefixtures("few", "in_memory")
def test_an_av_that_fails_is_left_out_and_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "raising.py").write_text(RAISES, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(cornerforge.errors.AvFaultError, match=r"spoiled \d+ tests"):
        cornerforge.r157(av="raising:Raises", families=["cut-in"])


def test_bad_input_is_named() -> None:
    with pytest.raises(UnknownNameError, match="cut-in"):
        cornerforge.r157(families=["cut-on"])
    with pytest.raises(UnknownNameError, match="idm-mobil"):
        cornerforge.r157(av="idm-mobile")


@pytest.mark.usefixtures("few")
def test_the_command_prints_the_keys_that_are_promised(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["r157", "--av", "fsm", "--family", "deceleration", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["scenarios"] == 28
    assert 0 < found["failed"] < 28
    assert set(found["failed_but_prevented_by"]) == set(CAREFUL)


def test_how_often_is_a_density() -> None:
    """Its integral over gap, closing speed and lateral speed is the share of the band."""
    gap = np.linspace(0.5, 120.0, 240)
    across = np.linspace(0.1, 2.5, 49)
    g, u = (one.ravel() for one in np.meshgrid(gap, across))
    total = 0.0
    for closing in np.arange(0.05, 12.0, 0.1):
        density = cut_in_density(30.0, float(closing), g, u)
        assert density is not None
        total += float(density.sum()) * 0.5 * 0.05 * 0.1
    assert total == pytest.approx(0.281, rel=0.05)
    assert cut_in_density(2.0, 5.0, g, u) is None
    assert closing_at_least(2.0, 5.0) is None
    assert closing_at_least(30.0, 0.0) == pytest.approx(1.0)
    found = closing_at_least(30.0, 5.277)  # the 99 % point of what was recorded
    assert found == pytest.approx(0.01, rel=0.15)
