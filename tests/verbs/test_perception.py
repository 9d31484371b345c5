"""A perception goes with a library, from its making to its page."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.errors import InputError
from cornerforge.library import CaseLibrary
from cornerforge.perception import Perception
from cornerforge.report.cases import BEFORE_S, case_data, unseen_s
from cornerforge.sim import perceived

SEEN = "latency=0.3,dropout=0.01"


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("seen") / "library"
    cornerforge.generate(out=out, policy="swerve", budget=12.0, perception=SEEN, cases=12, seed=0)
    return out


def test_a_library_says_what_its_av_perceived_and_replays(library: Path) -> None:
    cases = CaseLibrary.open(library)
    assert cases.odd.perception == Perception(latency=0.3, dropout=0.01)
    assert cornerforge.replay(library, "all", check=True).identical


def test_a_case_says_which_seconds_an_adversary_hid_and_they_are_seen_so(library: Path) -> None:
    cases = CaseLibrary.open(library)
    hidden = 0
    for case in cases.scalars(["case_id"])["case_id"].to_pylist():
        scenario = cases.scenario(case).scenario
        seen = perceived(scenario)
        for second, slot in enumerate(scenario.hidden_slots):
            if slot >= 0:
                hidden += 1
                lost = seen[10 * second + 1 : 10 * second + 11, list(scenario.slot).index(slot), 0]
                assert np.isnan(lost).all()
        assert scenario.partner is not None
        partner = seen[-round(BEFORE_S * 10) - 1 : -1, scenario.partner, 0]
        assert unseen_s(scenario) == pytest.approx(0.1 * np.isnan(partner).sum())
        shown = case_data(case, scenario)["vehicles"]
        assert "seenX" not in shown[0]
        assert all(len(one["seenX"]) == len(one["x"]) for one in shown[1:])
        partner_shown = next(one for one in shown if one["slot"] == scenario.slot[scenario.partner])
        assert (None in partner_shown["seenX"]) == bool(np.isnan(seen[:, scenario.partner, 0]).any())
    assert hidden >= 6


def test_the_same_av_does_the_same_in_a_retest(library: Path) -> None:
    said = cornerforge.retest(library, av="idm-mobil")
    assert said.same_av
    assert {one.recorded for one in said.each} == {"still crashing"}


def test_a_library_with_drawn_errors_is_not_shrunk(library: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none is shrunk"):
        cornerforge.shrink(library, ["all"], out=tmp_path / "small")
