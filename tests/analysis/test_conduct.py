"""What the AV did wrong, on crashes made by hand and on those of AVs whose flaw is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crashes_by_hand import LEFT, MIDDLE, RIGHT, Car, Turn, crash, mirrored
from hand_built import WIDE
from reference.recorded import recordings_of_all

import cornerforge
from cornerforge.analysis.avoidability import AvoidParams
from cornerforge.analysis.conduct import CONDUCTS, Conduct, conduct_of
from cornerforge.analysis.flaw import FLAWS, flaws_of, headline, in_words
from cornerforge.analysis.prevented import Prevention, prevention_of
from cornerforge.experiment.roads import odd_on, road_named
from cornerforge.recordings import Recordings
from cornerforge.results.analysis import OwnDoing
from cornerforge.types import Odd, Scenario

ODD = WIDE
CODES = {name: k for k, name in enumerate(CONDUCTS)}


def prevention(recordings: Recordings, odd: Odd = ODD) -> Prevention:
    return prevention_of(recordings, [None] * recordings.n_cases, odd, AvoidParams())


def found(scenario: Scenario, odd: Odd = ODD) -> tuple[str, str]:
    recordings = recordings_of_all([scenario])
    columns = conduct_of(recordings, odd, prevention(recordings, odd)).columns()
    return str(columns["conduct"][0]), str(columns["conduct_side"][0])


SLOWER = Car(80.0, MIDDLE, 20.0)
STEADY = Car(20.0, MIDDLE, 30.0)  # 55 m behind a slower one at 10 m/s: it must act at 40 m, after 1.5 s
INTO_LEFT = (Turn(1.0, 4.0, LEFT),)

MADE = {
    "it never brakes": (STEADY, SLOWER, ("does-not-brake", "none")),
    "it brakes 1.5 s late": (STEADY._replace(pulls=((4.0, -2.0),)), SLOWER, ("brakes-late", "none")),
    "it brakes in time and not enough": (
        STEADY._replace(pulls=((1.5, -0.5), (2.2, -1.2))), SLOWER, ("brakes-weakly", "none"),
    ),
    "it brakes in time, and enough too late": (
        STEADY._replace(pulls=((1.5, -0.5), (2.2, -1.1), (6.4, -4.0))), SLOWER, ("reacts-late", "none"),
    ),
    "it brakes hard for nothing": (Car(60.0, MIDDLE, 30.0, ((2.0, -6.0),)), Car(25.0, MIDDLE, 30.0),
                                   ("brakes-hard", "none")),
    "it brakes for nothing, gently": (Car(60.0, MIDDLE, 30.0, ((2.0, -2.0),)), Car(25.0, MIDDLE, 30.0),
                                      ("none", "none")),
    "it had braked, and went on": (
        STEADY._replace(pulls=((0.5, -0.8), (2.0, 0.2))), SLOWER, ("stops-heeding", "none"),
    ),
    "it follows at 0.3 s, and the other brakes": (
        Car(20.0, MIDDLE, 30.0, ((4.3, -4.0),)), Car(34.0, MIDDLE, 30.0, ((4.0, -8.0),)), ("too-close", "none"),
    ),
    "it follows at 1.2 s, and the other brakes too hard": (
        Car(20.0, MIDDLE, 30.0, ((4.3, -4.0),)), Car(61.0, MIDDLE, 30.0, ((4.0, -8.0),)), ("none", "none"),
    ),
    "it is cut in on": (
        Car(20.0, MIDDLE, 30.0), Car(32.0, LEFT, 22.0, turns=(Turn(0.5, 2.0, MIDDLE),)), ("none", "left"),
    ),
    "it changes lanes in front of a faster one": (
        Car(40.0, MIDDLE, 25.0, turns=INTO_LEFT), Car(16.0, LEFT, 33.0), ("not-behind", "left"),
    ),
    "it changes lanes into one further back": (
        Car(40.0, MIDDLE, 25.0, turns=INTO_LEFT), Car(37.0, LEFT, 25.0), ("not-behind", "left"),
    ),
    "it changes lanes into one further ahead": (
        Car(40.0, MIDDLE, 25.0, turns=INTO_LEFT), Car(43.0, LEFT, 25.0), ("not-beside", "left"),
    ),
    "it changes lanes 2 m in front of one as fast, and brakes": (
        Car(40.0, MIDDLE, 25.0, ((2.0, -2.0),), INTO_LEFT), Car(33.0, LEFT, 25.0), ("cuts-in", "left"),
    ),
    "the other comes in beside it": (
        Car(40.0, MIDDLE, 25.0), Car(40.0, LEFT, 25.0, turns=(Turn(1.0, 4.0, MIDDLE),)), ("none", "left"),
    ),
    "it turns back into its lane": (
        Car(40.0, MIDDLE, 25.0, turns=(Turn(0.0, 3.0, LEFT - 0.5), Turn(3.0, 3.0, MIDDLE))), Car(20.0, MIDDLE, 28.0),
        ("hesitates", "right"),
    ),
    "it drives astride the line": (
        Car(60.0, MIDDLE, 25.0, turns=(Turn(0.0, 2.0, MIDDLE + 2.2),)), Car(30.0, LEFT, 29.0), ("hesitates", "left"),
    ),
    "the other drives astride the line, slowly": (
        Car(20.0, MIDDLE, 30.0), Car(70.0, LEFT - 1.6, 22.0, turns=(Turn(4.4, 1.5, MIDDLE),)),
        ("does-not-brake", "left"),
    ),
    "it changes lanes twice, 3 s apart, and is struck from behind later": (
        Car(60.0, MIDDLE, 25.0, turns=(Turn(0.0, 3.0, LEFT), Turn(6.0, 3.0, MIDDLE))), Car(20.0, MIDDLE, 28.0),
        ("none", "right"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MADE)
def test_crashes_made_by_hand(name: str) -> None:
    av, bv, expected = MADE[name]
    assert found(crash(av, bv)) == expected


@pytest.mark.parametrize("name", MADE)
def test_the_mirror_image_gives_the_other_side(name: str) -> None:
    av, bv, (conduct, side) = MADE[name]
    assert found(mirrored(crash(av, bv))) == (conduct, {"left": "right", "right": "left"}.get(side, side))


MERGING = replace(odd_on(Odd(), replace(road_named("on-ramp"), lane_width=4.0), "ramp"), road_at=600.0)
"""The right lane of crashes made by hand is an acceleration lane up to 250 m."""
CLOSES_UP = Car(20.0, MIDDLE, 27.0, ((0.5, 1.5),))
INTO_MIDDLE = (Turn(2.5, 4.0, MIDDLE),)

AT_LANE_ENDS = {
    "it merges in front of a faster one": (
        (Car(40.0, RIGHT, 25.0, turns=(Turn(1.0, 4.0, MIDDLE),)), Car(16.0, MIDDLE, 33.0)),
        ("merges-blind", "not-behind"),
    ),
    "it changes lanes elsewhere": (
        (Car(40.0, MIDDLE, 25.0, turns=INTO_LEFT), Car(16.0, LEFT, 33.0)), ("not-behind", "not-behind"),
    ),
    "it merges 2 m in front of one as fast, and brakes": (
        (Car(40.0, RIGHT, 25.0, ((2.0, -2.0),), (Turn(1.0, 4.0, MIDDLE),)), Car(33.0, MIDDLE, 25.0)),
        ("none", "cuts-in"),
    ),
    "it stops at the end, beside a free lane": (
        (Car(40.0, RIGHT, 25.0, ((3.0, -3.4),)), Car(2.0, RIGHT, 25.0, ((4.0, -2.6),))),
        ("stops-at-end", "brakes-hard"),
    ),
    "it stops at the end, always beside another": (
        (Car(40.0, RIGHT, 25.0, ((3.0, -3.4),)), Car(2.0, RIGHT, 25.0, ((4.0, -2.6),)),
         Car(40.0, MIDDLE, 25.0, ((3.0, -3.4),))),
        ("none", "brakes-hard"),
    ),
    "it brakes hard before the end": (
        (Car(60.0, RIGHT, 30.0, ((2.0, -6.0),)), Car(25.0, RIGHT, 30.0)), ("none", "brakes-hard"),
    ),
    "it closes the gap to one that merges": (
        (CLOSES_UP, Car(46.0, RIGHT, 26.0, turns=INTO_MIDDLE)), ("blocks-mergers", "reacts-late"),
    ),
    "it lets one in, and brakes too little": (
        (CLOSES_UP._replace(pulls=((2.5, -1.2),)), Car(36.0, RIGHT, 22.0, turns=INTO_MIDDLE)), ("none", "none"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", AT_LANE_ENDS)
def test_crashes_made_by_hand_where_lanes_end(name: str) -> None:
    """The second conduct of each is the one on a road whose lanes go on."""
    cars, (conduct, elsewhere) = AT_LANE_ENDS[name]
    scenario = crash(*cars)
    assert found(scenario)[0] == elsewhere
    assert found(scenario, MERGING)[0] == conduct


def test_braking_earlier_than_the_models_is_not_late_where_the_rear_is_struck() -> None:
    """All four models brake later for the slower one ahead, and are out of reach of the one behind: no lateness."""
    struck = crash(
        Car(30.0, MIDDLE, 30.0, ((0.5, -2.0),)), Car(5.0, MIDDLE, 29.0, ((2.0, -2.0),)), Car(90.0, MIDDLE, 22.0)
    )
    recordings = recordings_of_all([struck])
    driven = prevention(recordings)
    assert driven.prevented.all()
    assert driven.reacts[0] >= 0
    conduct = conduct_of(recordings, ODD, driven)
    assert conduct.code.tolist() == [CODES["none"]]
    assert driven.columns(conduct.slow, conduct.begun)["prevention"].tolist() == ["models differ"]


def test_a_third_vehicle_changes_nothing() -> None:
    scenarios = [crash(STEADY, SLOWER), crash(STEADY, SLOWER, Car(60.0, RIGHT, 30.0))]
    recordings = recordings_of_all(scenarios)
    found = conduct_of(recordings, ODD, prevention(recordings))
    assert found.code.tolist() == 2 * [CODES["does-not-brake"]]
    assert found.begin_s[0] == found.begin_s[1] > 2.0
    columns = found.columns()
    again = Conduct.of_columns(columns["conduct"].tolist(), columns["conduct_side"].tolist(), found.begin_s)
    np.testing.assert_array_equal(np.stack([again.code, again.side]), np.stack([found.code, found.side]))


def conducts(**cases: int) -> Conduct:
    """So many cases of each conduct, named like not_behind_left."""
    codes, sides = [], []
    for name, n in cases.items():
        conduct, _, side = name.replace("_", "-").rpartition("-")
        codes += n * [CODES[conduct]]
        sides += n * [("ahead", "left", "right").index(side)]
    return Conduct(np.array(codes), np.array(sides), np.zeros(len(codes)))


@pytest.mark.parametrize(
    ("cases", "flaw"),
    [
        ({"not_behind_left": 10, "not_behind_right": 9, "none_ahead": 80}, "not-behind"),
        ({"not_behind_left": 20, "none_ahead": 80}, "not-behind"),  # it may seldom change to the right
        ({"not_behind_left": 10, "not_beside_left": 9, "none_ahead": 80}, "not-left"),
        ({"not_behind_right": 10, "not_beside_right": 9, "none_ahead": 80}, "not-right"),
        ({"not_behind_left": 10, "not_beside_right": 9, "none_ahead": 80}, "not-beside"),
        ({"does_not_brake_ahead": 10, "stops_heeding_ahead": 1}, "does-not-brake"),
        ({"does_not_brake_ahead": 10, "stops_heeding_ahead": 5}, "forgets"),
        ({"not_behind_left": 3, "cuts_in_right": 4, "none_ahead": 100}, "not-behind"),
        ({"not_behind_left": 1, "cuts_in_right": 9, "none_ahead": 100}, "too-close"),
        ({"too_close_ahead": 9, "cuts_in_right": 9, "none_ahead": 100}, "too-close"),
        ({"not_beside_right": 5, "cuts_in_right": 5, "none_ahead": 100}, "not-right"),
        ({"brakes_late_ahead": 4, "none_ahead": 90}, "brakes-late"),  # 1.2 to 10.5 %
        ({"brakes_late_ahead": 2, "none_ahead": 3}, None),
        (
            {"brakes_late_ahead": 2, "does_not_brake_ahead": 2, "reacts_late_left": 2, "none_ahead": 80},
            "brakes-too-little",
        ),
        ({"brakes_late_ahead": 3, "none_ahead": 85}, None),  # 0.7 to 9.6 %
    ],
)
def test_flaws_are_named_by_what_many_cases_show(cases: dict[str, int], flaw: str | None) -> None:
    named = flaws_of(conducts(**cases))
    assert [one.name for one in named] == ([] if flaw is None else [flaw])


def test_natural_cases_count_by_how_often_they_happen() -> None:
    found = conducts(brakes_late_ahead=5, hesitates_left=5)
    assert [one.name for one in flaws_of(found, np.repeat([1.0, 9.0], 5))] == ["hesitates", "brakes-late"]
    assert flaws_of(found, np.repeat([1.0, 9.0], 5))[0].share == pytest.approx(0.9)


def test_a_flaw_of_several_kinds_says_how_many_of_each_and_on_which_side() -> None:
    """A page said 97.2 % "does not look behind" above a chart with 80.4 %: the sum of three kinds, all on the right."""
    (flaw,) = flaws_of(conducts(not_behind_right=25, cuts_in_right=5, not_beside_right=1, none_ahead=9))
    assert flaw.detail == (
        "In 25 it does not look behind, in 5 it cuts in and in 1 it does not look beside. "
        "The other was on its right in 31 of 31."
    )
    assert flaws_of(conducts(brakes_late_ahead=30, none_ahead=70))[0].detail == ""
    assert flaws_of(conducts(not_behind_right=7, not_behind_left=5))[0].detail == ""


def test_the_sentence() -> None:
    late, nothing = conducts(brakes_late_ahead=30, none_ahead=70), conducts(none_ahead=70, hesitates_left=1)
    said = in_words(flaws_of(late), late, natural=False)
    assert said == (
        "This AV brakes late for vehicles ahead, in 30 % of its crashes (95 % interval 21 % to 40 %; 30 of 100 cases)."
    )
    none = in_words([], nothing, natural=True)
    assert none == (
        "Nothing was found that is this AV's own doing, in 71 natural crashes. In 1 of them it did something wrong, "
        "too few to name a flaw."
    )
    assert in_words([], conducts(none_ahead=1), natural=False).endswith("own doing, in 1 crash.")
    without = OwnDoing(text=none, flaws=(), conducts={"none": 70, "hesitates": 1})
    assert headline(without, without).startswith(
        "Nothing was found that is this AV's own doing: not in 71 natural crashes, nor in 71 that an adversary caused."
    )


FLAWED = ("brakes-late", "not-behind", "not-left", "forgets", "hesitates")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("av", [*(f"flawed-{flaw}" for flaw in FLAWED), "idm-mobil", "rss-cautious", "cc-human"])
def test_the_flaw_is_named_without_knowing(av: str, tmp_path: Path) -> None:
    """By the crashes of a heuristic adversary that changes lanes beside the AV; AVs without a flaw are the control.

    That one follows too close shows in 2 % of them only, at the limit; its natural crashes show it, all of them.
    """
    cornerforge.generate(out=tmp_path / "library", policy="lane-changer", cases=300, av=av, seed=4, threads=2)
    told = cornerforge.analyse(tmp_path / "library", avoidability="none", threads=2).own_doing
    assert told is not None
    assert sum(told.conducts.values()) == 300
    assert [one.flaw for one in told.flaws][:1] == ([av.removeprefix("flawed-")] if av.startswith("flawed-") else [])
    assert (FLAWS[told.flaws[0].flaw] if told.flaws else "Nothing was found") in told.text


@pytest.mark.full
@pytest.mark.parametrize(
    ("av", "task"), [("merges-blind", "ramp"), ("stops-at-end", "ramp"), ("blocks-mergers", "through")]
)
def test_the_flaw_is_named_where_lanes_end(av: str, task: str, tmp_path: Path) -> None:
    """By natural crashes; idm-mobil, which hardly has any, is the control with those of an adversary."""
    tests = {"merges-blind": 2_000, "stops-at-end": 200_000, "blocks-mergers": 40_000}[av]
    cornerforge.simulate(
        out=tmp_path / "natural", av=f"flawed-{av}", road="on-ramp", task=task, tests=tests, seed=4, threads=2
    )
    cornerforge.generate(
        out=tmp_path / "good", policy="lane-changer", cases=300, road="on-ramp", task=task, seed=4, threads=2
    )
    told, good = (
        cornerforge.analyse(tmp_path / name, avoidability="none", threads=2).own_doing for name in ("natural", "good")
    )
    assert told is not None
    assert told.flaws[0].flaw == av
    assert FLAWS[av] in told.text
    assert good is not None
    assert good.conducts.get(av, 0) <= 6
    assert av not in [one.flaw for one in good.flaws]
