"""Critical moments: what counts, once for each event, in the same order, and with the right numbers."""

from __future__ import annotations

import csv
import gzip
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_files import LANE_WIDTH, US101, Track, braking, clips_file, motorway, straight_on, written

from cornerforge.drivers.rails import LANE, LATERAL_SPEED, SPEED, X, Y
from cornerforge.errors import DataError, InputError
from cornerforge.ext.interchange.moments import MEASURES, Moments, critical_moments
from cornerforge.ext.interchange.recorded_traffic import read_traffic

needs_us101 = pytest.mark.skipif(not US101.exists(), reason="NGSIM's clips are not at hand")


def moments_of(folder: Path, tracks: Sequence[Track], measure: str = "drac", **more: float) -> Moments:
    return critical_moments(read_traffic([clips_file(folder / "a.csv", tracks)]), measure=measure, **more)  # type: ignore[arg-type]


def closing(until: float = 10.0) -> list[Track]:
    """A car at 25 m/s, 60 m between bumpers behind one at 20 m/s; after 7.5 s it has come to 22.5 m, then falls back.

    The other lanes are there so that the road is known.
    """
    time = np.arange(101) / 10
    ego = straight_on(1, 1, 0.0, 25.0)
    way = np.where(time < 7.5, 25.0 * time, 187.5 + 18.0 * (time - 7.5))
    return [
        replace(ego, x=way),
        straight_on(2, 1, 64.5, 20.0),
        straight_on(3, 0, -200.0, 20.0),
        straight_on(4, 2, -200.0, 20.0, seconds=until),
    ]


def test_numbers_of_a_moment_are_those_of_the_formulas(tmp_path: Path) -> None:
    found = moments_of(tmp_path, closing(), before_s=4.0, after_s=2.0)
    facts = found.cases[0].facts
    moment = facts["recording_time_s"]
    assert isinstance(moment, float)
    assert 6.0 < moment < 7.5  # smoothed over 2.1 s, the end of the approach is round
    assert isinstance(facts["gap_m"], float)
    assert isinstance(facts["ego_speed_mps"], float)
    assert facts["gap_m"] == pytest.approx(60.0 - 5.0 * moment, abs=0.5)
    rate = facts["ego_speed_mps"] - 20.0
    assert facts["drac_mps2"] == pytest.approx(rate**2 / (2.0 * facts["gap_m"]), rel=1e-3)
    assert facts["ttc_s"] == pytest.approx(facts["gap_m"] / rate, rel=1e-3)
    assert facts["thw_s"] == pytest.approx(facts["gap_m"] / facts["ego_speed_mps"], rel=1e-3)
    assert facts["contact_s"] == pytest.approx(facts["ttc_s"], rel=1e-3)  # in one lane the two are the same
    assert (facts["ego_vehicle"], facts["other_vehicle"], facts["moment_s"]) == ("1", "2", 4.0)


def test_a_case_is_the_window_as_it_was_seen_from_the_ego(tmp_path: Path) -> None:
    (traffic,) = read_traffic([clips_file(tmp_path / "a.csv", motorway())])
    case = critical_moments([traffic], before_s=3.0, after_s=2.0).cases[0]
    moment = round(10 * float(case.facts["recording_time_s"] or 0))
    assert case.poses.shape == (51, 6, 7)
    assert case.av_is_recorded
    assert (case.poses[0, 0, X], len(case.length)) == (0.0, 6)
    sizes = {(round(a, 1), round(b, 1)) for a, b in zip(case.length, case.width, strict=True)}
    assert (16.0, 2.5) in sizes
    ego = np.flatnonzero(traffic.vehicle == traffic.names.index("1"))
    start = traffic.x[ego][moment - 30]
    for column in range(6):
        of = [
            v
            for v in range(6)
            if np.allclose(
                traffic.y[traffic.vehicle == v][moment - 30 : moment + 20], case.poses[:-1, column, Y], atol=0
            )
            and np.allclose(
                traffic.x[traffic.vehicle == v][moment - 30 : moment + 20] - start, case.poses[:-1, column, X], atol=0
            )
        ]
        assert len(of) == 1
    assert np.isnan(case.poses[-1, 1:]).all()  # what the others did after the window is not known
    assert np.isfinite(case.poses[-1, 0]).all()


def test_one_event_is_one_moment_and_a_second_approach_another(tmp_path: Path) -> None:
    once = moments_of(tmp_path, closing(), before_s=3.0, after_s=1.0)
    assert [case.facts["ego_vehicle"] for case in once.cases].count("1") == 1
    twice = closing()
    time = np.arange(201) / 10
    speed = np.select([time < 6.0, time < 8.0, time < 16.0], [25.0, 12.0, 24.0], 15.0)
    way = np.concatenate([[0.0], np.cumsum(0.1 * speed[:-1])])
    twice[0] = Track(1, 4.5, 1.8, "car", 0, way, np.full(201, 1.5 * LANE_WIDTH))
    twice[1] = straight_on(2, 1, 64.5, 20.0, seconds=20.0)
    found = moments_of(tmp_path, twice, before_s=3.0, after_s=1.0)
    times = [case.facts["recording_time_s"] for case in found.cases if case.facts["ego_vehicle"] == "1"]
    assert sorted(float(when or 0) for when in times) == pytest.approx([6.0, 16.0], abs=1.0)  # smoothed over 2.1 s


def test_moments_are_ranked_and_ties_do_not_depend_on_the_order_of_rows(tmp_path: Path) -> None:
    tracks = motorway()
    far = [replace(track, name=track.name + 20, x=track.x + 2000.0) for track in tracks]
    path = clips_file(tmp_path / "a.csv", [*tracks, *far])
    wanted = critical_moments(read_traffic([path]))
    values = [float(case.facts["drac_mps2"] or 0) for case in wanted.cases]
    assert values == sorted(values, reverse=True)
    assert values[0] == pytest.approx(values[1], abs=1e-9)  # the same event twice, 2 km apart
    header, *rows = path.read_text().splitlines()
    written(path, header, [rows[i] for i in np.random.default_rng(1).permutation(len(rows))])
    again = critical_moments(read_traffic([path]))
    assert [case.name for case in again.cases] == [case.name for case in wanted.cases]
    for a, b in zip(again.cases, wanted.cases, strict=True):
        np.testing.assert_array_equal(a.poses, b.poses)


def test_who_passes_in_the_next_lane_is_not_in_the_way_until_it_cuts_in(tmp_path: Path) -> None:
    tracks = [straight_on(1, 1, 0.0, 28.0), straight_on(2, 2, 60.0, 20.0), straight_on(3, 0, -300.0, 20.0)]
    with pytest.raises(DataError, match="no car comes near another vehicle ahead of it in its way"):
        moments_of(tmp_path, tracks)
    time = np.arange(101) / 10
    aside = 0.5 - 0.5 * np.cos(np.pi * np.clip((time - 1.0) / 3.0, 0.0, 1.0))
    slower = np.where(time < 4.0, 28.0 * time, 112.0 + 18.0 * (time - 4.0))
    tracks[0] = replace(tracks[0], x=slower)
    tracks[1] = replace(tracks[1], y=(2.5 - aside) * LANE_WIDTH)
    case = moments_of(tmp_path, tracks).cases[0]
    assert (case.facts["ego_vehicle"], case.facts["other_vehicle"]) == ("1", "2")
    column = int(case.facts["other_column"] or 0)
    assert case.poses[0, column, LANE] == 2
    assert case.poses[:, column, LATERAL_SPEED][:-1].min() < -1.0
    assert float(case.facts["recording_time_s"] or 0) > 2.0  # its body comes before the ego's after about half the way


def test_trucks_and_motorcycles_are_no_egos(tmp_path: Path) -> None:
    tracks = closing()
    tracks[0] = replace(tracks[0], length=14.0, width=2.5)
    with pytest.raises(DataError, match="no car comes near"):
        moments_of(tmp_path, tracks)


def test_boxes_that_overlap_make_no_case(tmp_path: Path) -> None:
    tracks = closing()
    lying = replace(tracks[1], x=tracks[1].x - 24.0)  # at 7.5 s the two are 3 m apart, and share a place
    found = moments_of(
        tmp_path, [tracks[0], lying, *tracks[2:], *[replace(t, name=t.name + 30, x=t.x - 900.0) for t in closing()[:2]]]
    )
    assert any("overlaps another vehicle" in reason for reason in found.left_out)
    assert "1" not in [case.facts["ego_vehicle"] for case in found.cases]


def test_a_vehicle_that_nobody_can_drive_makes_no_case(tmp_path: Path) -> None:
    road_train = straight_on(9, 0, 40.0, 20.0, length=38.0, width=2.5)
    found = moments_of(tmp_path, [*closing(), road_train])
    assert found.cases == []
    assert found.left_out == {"a vehicle near is longer than 30 m or narrower than 0.3 m": 1}


def test_a_moment_at_the_end_of_a_track_makes_no_case(tmp_path: Path) -> None:
    tracks = [straight_on(1, 1, 0.0, 25.0), *closing()[1:]]  # closes until the last row
    found = moments_of(tmp_path, tracks)
    assert (found.cases, found.found) == ([], 1)
    assert [*found.left_out] == ["the car was seen for less than 2 s before or 1 s after it"]


def test_a_moment_in_two_clips_is_one(tmp_path: Path) -> None:
    tracks = closing()
    a = clips_file(tmp_path / "a.csv", tracks, "a").read_text()
    later = [replace(t, x=t.x[10:], y=t.y[10:]) for t in tracks]
    b = clips_file(tmp_path / "b.csv", later, "b").read_text().partition("\n")[2]
    (tmp_path / "c.csv").write_text(a + b)
    found = critical_moments(read_traffic([tmp_path / "c.csv"]))
    assert [case.facts["ego_vehicle"] for case in found.cases].count("1") == 1
    assert found.left_out == {"the same moment stands in another clip of the file": 1}


def test_what_cannot_be_is_named(tmp_path: Path) -> None:
    traffic = read_traffic([clips_file(tmp_path / "a.csv", motorway())])
    for wrong in ({"most": 0}, {"before_s": 1.0}, {"after_s": 0.5}, {"measure": "pet"}):
        with pytest.raises(InputError):
            critical_moments(traffic, **wrong)


@pytest.mark.full
@needs_us101
def test_moments_of_us101_are_in_its_rows() -> None:
    """Gap and TTC of each moment from the file's rows as they stand: positions, lengths and speeds of its own."""
    with gzip.open(US101, "rt", newline="") as file:
        rows = {
            (row["scenario"], row["veh_id"], round(10 * float(row["t_s"]))): tuple(
                float(row[name]) for name in ("s_m", "speed_mps", "length_m", "lane")
            )
            for row in csv.DictReader(file)
        }
    traffic = read_traffic([US101])
    for measure in MEASURES[:3]:
        found = critical_moments(traffic, most=50, measure=measure)
        assert len(found.cases) == 50
        gaps, closing_speeds = [], []
        for case in found.cases:
            facts = case.facts
            tick, clip = round(10 * float(facts["recording_time_s"] or 0)), str(facts["recording"])
            pair = [(clip, str(facts[name])) for name in ("ego_vehicle", "other_vehicle")]
            both = [k for k in range(tick - 3, tick + 4) if all((*one, k) in rows for one in pair)]
            ego, other = (np.mean([rows[(*one, k)] for k in both], axis=0) for one in pair)
            assert other[0] > ego[0]
            gaps.append(other[0] - ego[0] - 0.5 * (other[2] + ego[2]) - float(facts["gap_m"] or 0))
            rate = float(facts["ego_speed_mps"] or 0) - float(facts["other_speed_mps"] or 0)
            closing_speeds.append(ego[1] - other[1] - rate)
        assert np.median(np.abs(gaps)) < 0.2
        assert np.abs(gaps).max() < 1.5
        assert np.median(np.abs(closing_speeds)) < 0.4
        assert np.abs(closing_speeds).max() < 3.0


def test_speeds_in_a_case_are_never_negative(tmp_path: Path) -> None:
    stopping = [braking(1, 1, 0.0, 15.0, 2.5, 2.0, 0.0), straight_on(2, 1, 90.0, 0.0), *closing()[2:]]
    case = moments_of(tmp_path, stopping).cases[0]
    assert np.nanmin(case.poses[..., SPEED]) >= 0.0
    assert (np.diff(case.poses[:, 0, X]) >= 0.0).all()
