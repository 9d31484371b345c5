"""Numbers of a result that contradict each other are found, and those of real ones are not."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from edited_files import write_object

import cornerforge
from cornerforge.errors import FileFormatError
from cornerforge.results import Analysed, NaturalRate
from cornerforge.results.stating import from_file
from cornerforge.results.validation import BaselineDifference


@pytest.fixture(scope="module")
def analysed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The analysis of 40 cases, as `analyse` wrote it."""
    folder = tmp_path_factory.mktemp("consistent")
    cornerforge.generate(policy="swerve", cases=40, out=folder / "library", seed=3)
    cornerforge.analyse(folder / "library", out=folder / "analysis")
    content: dict[str, Any] = json.loads((folder / "analysis" / "analysis.json").read_text(encoding="utf-8"))
    return content


def test_what_analyse_writes_does_not_contradict_itself(analysed: dict[str, Any], tmp_path: Path) -> None:
    assert read(analysed, tmp_path).cases == 40


def read(content: dict[str, Any], folder: Path) -> Analysed:
    write_object(folder / "analysis.json", content)
    return from_file(Analysed, folder / "analysis.json", "cornerforge analyse")


def put(*names: Any, value: Any) -> Callable[[dict[str, Any]], None]:
    """Make a change: another value at a place; None: none there."""

    def change(content: Any) -> None:
        *way, last = names
        for name in way:
            content = content[name]
        if value is None:
            del content[last]
        else:
            content[last] = value

    return change


def test_an_interval_of_no_named_number_may_lie_below_zero(tmp_path: Path) -> None:
    """Log-likelihoods of `ndd validate` do."""
    said = {"difference": -0.1, "interval95": [-0.2, -0.05]}
    write_object(tmp_path / "part.json", said)
    assert from_file(BaselineDifference, tmp_path / "part.json", "cornerforge ndd validate").difference == -0.1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (put("judges", "agreement", "fsm", value=None), "judges.agreement.fsm."),
        (put("judges", "agreement", "fsm", "rss-brake", value=None), "judges.agreement.fsm.rss-brake"),
        (put("judges", "agreement", "fsm", "rss-brake", value=7.0), "judges.agreement.fsm.rss-brake"),
        (put("judges", "lead", "share", value=0.123), "judges.lead.share"),
        (put("avoidability", "interval95", value=[0.98, 0.99]), "avoidability.avoidable_share"),
        (put("avoidability", "cases", value=777), "avoidability.labels"),
        (put("prevented", "any", "share", value=7.0), "prevented.any.share"),
        (put("prevented", "any", "by_braking", value=41), "prevented.any.by_braking"),
        (put("coverage", "unseen_kind_interval95", value=[0.9, 0.1]), "coverage.unseen_kind_interval95"),
        (put("majority", value=777), "majority, minority"),
        (put("crash_types", "head-on", value=41), "crash_types"),
        (put("fault", "bv", value=777), "fault"),
        (put("own_doing", "conducts", "none", value=777), "conducts"),
        (put("clusters", 0, "size", value=777), "clusters"),
        (put("clusters", 0, "crash_types", "head-on", value=41), "clusters.0.crash_types"),
        (put("prevented", "any", "interval95", value=[-1.0, 1.0]), "prevented.any.interval95"),
        (put("prevented", "any", "interval95", value=[0.0, 7.0]), "prevented.any.interval95"),
        (put("avoidability", "reaction_s", value=-1.0), "avoidability.reaction_s"),
        (put("severity", "av_injury_probability", "99", value=7.0), "severity.av_injury_probability"),
    ],
)  # fmt: skip
def test_a_contradiction_is_named(
    analysed: dict[str, Any], tmp_path: Path, change: Callable[[dict[str, Any]], None], said: str
) -> None:
    content = json.loads(json.dumps(analysed))
    change(content)
    with pytest.raises(FileFormatError, match=r"analysis\.json") as raised:
        read(content, tmp_path)
    assert f'"{said}' in str(raised.value)


@pytest.fixture(scope="module")
def rated(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A rate with 8 crashes in 200 tests, as `rate` wrote it."""
    folder = tmp_path_factory.mktemp("rated")
    cornerforge.rate(av="flawed-not-behind", method="mc", max_tests=200, out=folder / "out")
    content: dict[str, Any] = json.loads((folder / "out" / "rate.json").read_text(encoding="utf-8"))
    return content


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (put("av_crashes", value=77), "crashes_per_test"),
        (put("tests", value=777), "crashes_per_test"),
        (put("crash_types", "head-on", value=7), "crash_types"),
        (put("mechanisms", "other", value=7), "mechanisms"),
        (put("bv_crashes", value=777), "bv_crashes_per_test"),
        (put("bv_crashes_per_bv_mile", value=7.0), "bv_crashes_per_bv_mile"),
        (put("interval95", value=[-1.0, 1.0]), "interval95"),
        (put("miles", value=-1.0), "miles"),
        (put("seconds", value=-1.0), "seconds"),
        (put("largest_share", value=7.0), "largest_share"),
    ],
)
def test_a_contradiction_of_a_rate_is_named(
    rated: dict[str, Any], tmp_path: Path, change: Callable[[dict[str, Any]], None], said: str
) -> None:
    content = json.loads(json.dumps(rated))
    write_object(tmp_path / "rate.json", content)
    assert from_file(NaturalRate, tmp_path / "rate.json", "cornerforge rate").tests == 200
    change(content)
    write_object(tmp_path / "rate.json", content)
    with pytest.raises(FileFormatError, match=rf'rate\.json: "{said}"'):
        from_file(NaturalRate, tmp_path / "rate.json", "cornerforge rate")
