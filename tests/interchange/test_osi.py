"""Traces of ASAM OSI: what is read of them is where they say; what a straight road cannot hold is named."""

from __future__ import annotations

import struct
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crashes_by_hand import LEFT, MIDDLE, RIGHT, Car, Turn, crash
from reference.osi import (
    ANIMAL,
    BICYCLE,
    MOTORCYCLE,
    PEDESTRIAN,
    TRUCK,
    Thing,
    driven,
    encoded,
    ground_truth,
    lane,
    road,
    scene,
    stream,
)

from cornerforge import types
from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, LATERAL_SPEED, SPEED, X, Y
from cornerforge.errors import (
    CornerForgeError,
    DataError,
    FileFormatError,
    InputError,
    MissingExtraError,
    UnknownNameError,
)
from cornerforge.ext.interchange import osi_messages
from cornerforge.ext.interchange.read_osi import read_osi
from cornerforge.ext.interchange.write_osi import write_osi
from cornerforge.library.out_case import ONE_LANE, OutCase
from cornerforge.types import Scenario

pytest.importorskip("google.protobuf", reason="protobuf is not installed (the extra osi)")

AV = Thing(0, 0.0, -6.0)
AHEAD = Thing(1, 40.0, -6.0, vx=15.0)


def cut_in() -> Scenario:
    scenario = crash(
        Car(0.0, MIDDLE, 30.0),
        Car(35.0, LEFT, 27.0, ((1.0, -3.0),), (Turn(0.5, 3.0, MIDDLE),)),
        Car(-160.0, RIGHT, 25.0),
    )
    present = scenario.present.copy()
    present[12:, 2] = False
    return replace(scenario, present=present)


def on_road(folder: Path, text: str | None = None) -> Path:
    place = folder / "road.xodr"
    place.write_text(road() if text is None else text, encoding="utf-8")
    return place


@pytest.mark.parametrize("ending", ["osi", "mcap"])
def test_a_case_comes_back_as_it_was(tmp_path: Path, ending: str) -> None:
    if ending == "mcap":
        pytest.importorskip("mcap", reason="mcap is not installed (the extra osi)")
    scenario = cut_in()
    names = write_osi(OutCase("case", scenario, {"judge": "x"}), tmp_path / f"case.{ending}")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    case = read_osi(tmp_path / f"case.{ending}")
    there = scenario.present
    np.testing.assert_array_equal(np.isfinite(case.poses[..., X]), there)
    np.testing.assert_allclose(case.poses[..., X][there] + scenario.x[0, 0], scenario.x[there], rtol=0, atol=1e-3)
    np.testing.assert_allclose(case.poses[..., Y][there], scenario.y[there], rtol=0, atol=1e-3)
    np.testing.assert_allclose(case.poses[..., SPEED][there], scenario.speed[there], rtol=0, atol=1e-9)
    np.testing.assert_allclose(case.poses[..., HEADING][there], scenario.heading[there], rtol=0, atol=1e-9)
    np.testing.assert_allclose(case.poses[..., ACCELERATION][there], scenario.acceleration[there], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(case.kind, scenario.kind)
    np.testing.assert_allclose((case.length, case.width), (scenario.length, scenario.width))
    assert (case.odd.n_lanes, case.odd.lane_width) == (scenario.odd.n_lanes, pytest.approx(scenario.odd.lane_width))
    assert case.facts["road"] == names[1]


def test_the_same_case_gives_the_same_bytes(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        write_osi(OutCase("case", cut_in(), {}), tmp_path / folder / "case.osi")
    assert (tmp_path / "a" / "case.osi").read_bytes() == (tmp_path / "b" / "case.osi").read_bytes()


def test_uneven_steps_are_taken_at_tenths(tmp_path: Path) -> None:
    """Between two frames counts the straight line: off by at most a dt^2 / 8."""
    rng = np.random.default_rng(3)
    times = np.cumsum(np.append(7.0, rng.uniform(0.01, 0.08, 120)))
    braking = replace(AV, vx=60.0, ax=-3.0)
    case = read_osi(scene(tmp_path / "t.osi", braking, AHEAD, times=times.tolist()), road=on_road(tmp_path))
    at = times[0] + 0.1 * np.arange(len(case.poses))
    assert times[-1] - 0.1 < at[-1] <= times[-1]
    exact = [driven(braking, time) for time in at]
    off = case.poses[:, 0, X] - [one.x - exact[0].x for one in exact]
    assert np.abs(off).max() < 3.0 * 0.08**2 / 8.0 + 1e-6
    np.testing.assert_allclose(case.poses[:, 0, SPEED], [one.vx for one in exact], atol=1e-6)
    assert case.facts["start_time_s"] == pytest.approx(7.0)


def test_places_classes_and_sizes_are_those_of_the_trace(tmp_path: Path) -> None:
    """The box's centre counts, whatever stands in bbcenter_to_rear; the road may point anywhere."""
    things = [AV, replace(AHEAD, vehicle=TRUCK, length=12.0, width=2.5), Thing(7, -30.0, -2.0, vehicle=MOTORCYCLE)]
    case = read_osi(scene(tmp_path / "t.osi", *things), road=on_road(tmp_path))
    assert case.kind.tolist() == [types.CAR, types.TRUCK, types.MOTORCYCLE]
    assert case.length.tolist() == [5.0, 12.0, 5.0]
    np.testing.assert_allclose(case.poses[0, :, X], [0.0, 40.0, -30.0])
    np.testing.assert_allclose(case.poses[0, :, Y], [6.0, 6.0, 10.0])
    assert case.poses[0, :, LANE].tolist() == [1.0, 1.0, 2.0]
    assert case.called == ("object 0", "object 1", "object 7")
    turned = [replace(one, x=-one.x, y=-one.y, yaw=np.pi, vx=-one.vx) for one in things]
    text = road(left=[lane(1), lane(2), lane(3)], right=[lane(-1)])
    other = read_osi(scene(tmp_path / "u.osi", *turned), road=on_road(tmp_path, text))
    np.testing.assert_allclose(other.poses[..., :LATERAL_SPEED], case.poses[..., :LATERAL_SPEED], atol=1e-9)
    assert any("lanes of road 1 that are not driven in the AV's direction are left out: -1" in n for n in other.notes)


def test_without_velocities_they_are_differences(tmp_path: Path) -> None:
    path = scene(tmp_path / "t.osi", AV)
    bare = [(1, ((1, 0),)), (2, [field for field in AV.fields()[1][1] if field[0] < 4]), (3, 2), (6, ((1, 4),))]
    frames = []
    for k in range(31):
        bare[1] = (2, [field for field in driven(AV, 0.1 * k).fields()[1][1] if field[0] < 4])
        frames.append(ground_truth(0.1 * k, [], host=0, more=((5, tuple(bare)),)))
    for road_of in (on_road(tmp_path), None):
        case = read_osi(stream(path, frames), road=road_of)
        np.testing.assert_allclose(case.poses[:, 0, SPEED], 20.0)
        np.testing.assert_allclose(case.poses[:, 0, ACCELERATION], 0.0, atol=1e-9)


@pytest.mark.parametrize("k", [0, 1], ids=["the AV", "object 1"])
@pytest.mark.parametrize(
    "after", [{"x": 15.0}, {"y": 3.0}, {"vx": 3.0}, {"vx": 15.0}], ids=["jump", "aside", "otherwise", "km/h"]
)
def test_what_moves_otherwise_than_its_velocity_says_is_refused(
    tmp_path: Path, k: int, after: dict[str, float]
) -> None:
    things = [AV, Thing(1, 40.0, -6.0)]

    def frame(at: int) -> bytes:
        now = [driven(one, 0.1 * at) for one in things]
        if at >= 20:
            now[k] = replace(now[k], **{name: getattr(now[k], name) + by for name, by in after.items()})
        return ground_truth(0.1 * at, now, host=0, more=())

    path = stream(tmp_path / "t.osi", [frame(at) for at in range(40)])
    with pytest.raises(DataError, match=r"t\.osi, frame \d+: .*moves otherwise than its velocity says"):
        read_osi(path, road=on_road(tmp_path))


@pytest.mark.parametrize(
    ("host", "ego", "seat"),
    [(1, None, "object 1"), (1, "0", "object 0"), (None, "Other", "Other")],
)
def test_the_av_is_the_host_or_the_one_that_is_named(
    tmp_path: Path, host: int | None, ego: str | None, seat: str
) -> None:
    named = replace(AHEAD, name="Other") if ego == "Other" else AHEAD
    case = read_osi(scene(tmp_path / "t.osi", AV, named, host=host), ego=ego, road=on_road(tmp_path))
    assert case.called[0] == seat


def test_who_is_the_av_must_be_known(tmp_path: Path) -> None:
    path = scene(tmp_path / "t.osi", AV, replace(AHEAD, name="Target"), host=None)
    with pytest.raises(InputError, match=r"t\.osi does not say which .* as ego \(--ego\): 0, 1 \(Targe"):
        read_osi(path)
    with pytest.raises(UnknownNameError, match="Tarjet"):
        read_osi(path, ego="Tarjet")
    with pytest.raises(DataError, match="host vehicle, 9, is no vehicle"):
        read_osi(scene(tmp_path / "t.osi", AV, host=9))
    hero = scene(tmp_path / "t.osi", AV, replace(AHEAD, name="Hero"), host=None)
    assert read_osi(hero, road=on_road(tmp_path)).called[0] == "Hero"


LEFT_OUT = {
    "oncoming": (Thing(5, 300.0, 14.0, yaw=np.pi, vx=-20.0), "object 5 is left out: it drives against the AV's dir"),
    "pedestrian": (Thing(5, 60.0, -20.0, vx=0.0, kind=PEDESTRIAN), "object 5 is left out: it is a pedestrian; it come"),
    "no size": (Thing(5, 60.0, -20.0, kind=PEDESTRIAN, length=0.0, width=0.0, vx=0.0), "it is a pedestrian"),
    "animal": (Thing(5, 400.0, -6.0, vx=0.0, kind=ANIMAL), "it is an animal"),
    "bicycle": (Thing(5, 200.0, -11.0, vx=6.0, vehicle=BICYCLE, length=1.8, width=0.6), "it is a bicycle"),
    "shoulder": (Thing(5, 40.0, -19.0, vx=0.0), "it is beside the lanes; it comes within"),
    "backwards": (Thing(5, 400.0, -2.0, vx=-3.0), "it drives backwards"),
    "crossing": (Thing(5, 300.0, -2.0, yaw=1.57, vx=0.0), "it stands or drives across the road"),
    "monster": (Thing(5, 300.0, -2.0, length=40.0), "it is 40 m long"),
}
"""Things that a straight road cannot hold, far from the AV, and what the note says of them."""


@pytest.mark.parametrize("what", LEFT_OUT)
def test_what_cannot_be_held_is_left_out_by_name(tmp_path: Path, what: str) -> None:
    thing, words = LEFT_OUT[what]
    case = read_osi(scene(tmp_path / "t.osi", AV, thing, AHEAD), road=on_road(tmp_path))
    assert case.called == ("object 0", "object 1")
    (note,) = [note for note in case.notes if "object 5" in note]
    assert words in note
    assert " m of the AV (after " in note


@pytest.mark.parametrize("what", LEFT_OUT)
def test_what_cannot_be_held_is_refused_near_the_av(tmp_path: Path, what: str) -> None:
    thing, words = LEFT_OUT[what]
    near = replace(thing, x=30.0, y=-14.0 if what == "shoulder" else -6.0)
    av = replace(AV, y=-10.0 if what == "shoulder" else -6.0)
    wanted = words.partition("it ")[2].partition(";")[0].removeprefix("is left out: it ")
    with pytest.raises(
        DataError, match=rf"t\.osi, frame \d+: object 5 .*{wanted[:24]}.*, \d+\.\d m from the AV"
    ) as said:
        read_osi(scene(tmp_path / "t.osi", av, near, AHEAD), road=on_road(tmp_path))
    assert "\n" not in str(said.value)


def test_the_closest_distance_is_between_boxes(tmp_path: Path) -> None:
    """A standing pedestrian, 14 m to the right of the AV's middle; the AV is 1 m from there to its side."""
    standing = Thing(5, 50.0, -20.0, vx=0.0, kind=PEDESTRIAN, length=0.5, width=0.5)
    notes = read_osi(scene(tmp_path / "t.osi", AV, standing), road=on_road(tmp_path)).notes
    assert any("comes within 12.8 m of the AV (after 2.4 s)" in note for note in notes)


def test_what_comes_and_goes_near_the_av_is_refused(tmp_path: Path) -> None:
    place = on_road(tmp_path)
    for gap, span, words in ((15.0, (1.0, 9.0), "appears 15.0 m"), (18.0, (0.0, 2.0), "vanishes 18.0 m")):
        one = Thing(1, gap + 5.0, -6.0)
        with pytest.raises(DataError, match=f"object 1 {words} from the AV"):
            read_osi(scene(tmp_path / "t.osi", AV, one, spans={1: span}), road=place)
        case = read_osi(scene(tmp_path / "t.osi", AV, replace(one, x=200.0), spans={1: span}), road=place)
        there = np.isfinite(case.poses[:, 1, X])
        assert there.sum() == round(10.0 * (min(span[1], 5.0) - span[0])) + 1
        assert any(f"object 1 {words.split()[0]} 195.0 m" in note for note in case.notes)


def test_the_av_must_be_held_throughout(tmp_path: Path) -> None:
    place = on_road(tmp_path)
    gone = [ground_truth(0.1 * k, [] if k == 7 else [driven(AV, 0.1 * k)], host=0, more=()) for k in range(20)]
    with pytest.raises(DataError, match=r"t\.osi, frame 7: the AV, object 0, is not there"):
        read_osi(stream(tmp_path / "t.osi", gone), road=place)
    with pytest.raises(DataError, match=r"frame \d+: the AV, object 0, drives backwards"):
        read_osi(scene(tmp_path / "t.osi", replace(AV, vx=2.0, ax=-1.0)), road=place)
    with pytest.raises(DataError, match=r"AV starts in lane -2 \(driving\), which is not driven its way"):
        read_osi(scene(tmp_path / "t.osi", replace(AV, yaw=np.pi, vx=-20.0)), road=place)
    late = scene(tmp_path / "t.osi", AV, AHEAD, spans={0: (1.0, 3.0)})
    case = read_osi(late, road=place)
    assert len(case.poses) == 21
    assert case.facts["start_time_s"] == pytest.approx(1.0)


def test_stationary_objects_are_counted_or_refused(tmp_path: Path) -> None:
    def pole(y: float, z: float = 0.75) -> bytes:
        base = ((1, ((1, 0.3), (2, 0.3), (3, 1.5))), (2, ((1, 60.0), (2, y), (3, z))), (3, ()))
        return encoded(((1, ((1, 33),)), (2, base)))

    place = on_road(tmp_path)
    notes = read_osi(scene(tmp_path / "t.osi", AV, more=((4, pole(-15.0)),)), road=place).notes
    assert any(note.startswith("1 stationary object is left out") for note in notes)
    read_osi(scene(tmp_path / "t.osi", AV, more=((4, pole(-6.0, z=6.0)),)), road=place)  # a sign above the road
    with pytest.raises(DataError, match="stationary object 33 stands in the lanes"):
        read_osi(scene(tmp_path / "t.osi", AV, more=((4, pole(-6.0)),)), road=place)


ROADS = {
    "bend on the way": (road(shape='<arc curvature="0.01"/>', begin=-950), r"after 55 m .* \(arc"),
    "start on a bend": (road(shape='<arc curvature="0.01"/>', begin=-1010), r"AV starts in no lane of a straight road"),
    "end": (road(begin=-2950), r"no such lane is there any more"),
    "junction": (road().replace('rule="RHT"', 'rule="RHT" junction="9"'), r"road 1 in junction 9 \(straight; line"),
    "one wide lane": (road([lane(-1, width=8.0)]), r"road\.xodr, line 1: lanes are 8 m wide"),
    "reversed lane": (road([lane(-1), lane(-2, more='direction="reversed"'), lane(-3)]), r"in lane -2 \(driving\)"),
    "no direction": (road([lane(-1, more='direction="up"')]), r'lane -1 has direction "up"'),
    "a lane ends": (
        road().replace("</laneSection>", f'</laneSection><laneSection s="560"><right>{lane(-1)}</right></laneSection>'),
        r"after 60 m no such lane",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", ROADS)
def test_a_road_that_cannot_be_driven_is_refused_by_name(tmp_path: Path, what: str) -> None:
    text, words = ROADS[what]
    with pytest.raises(DataError, match=words):
        read_osi(scene(tmp_path / "t.osi", AV), road=on_road(tmp_path, text))


def test_a_reversed_lane_is_one_of_oncoming_traffic(tmp_path: Path) -> None:
    """OpenDRIVE 1.8: of three lanes to the right, the left one is driven the other way."""
    text = road([lane(-1, more='direction="reversed"'), lane(-2), lane(-3)])
    case = read_osi(scene(tmp_path / "t.osi", AV, AHEAD), road=on_road(tmp_path, text))
    assert case.odd.n_lanes == 2
    assert any("left out: -1 (driving)" in note for note in case.notes)
    oncoming = Thing(5, 200.0, -2.0, yaw=np.pi, vx=-20.0)
    with pytest.raises(DataError, match="object 5 drives against the AV's direction"):
        read_osi(scene(tmp_path / "t.osi", AV, oncoming), road=on_road(tmp_path, text))


def test_an_overtaker_in_the_oncoming_lane_has_a_lane(tmp_path: Path) -> None:
    text = road([lane(-1)], left=[lane(1)])
    slow = replace(AV, y=-2.0)
    alone = read_osi(scene(tmp_path / "t.osi", slow), road=on_road(tmp_path, text))
    case = read_osi(scene(tmp_path / "t.osi", slow, Thing(3, -30.0, 2.0, vx=30.0)), road=on_road(tmp_path, text))
    assert case.poses[0, :, LANE].tolist() == [0.0, 1.0]
    assert any("lane 1 of road 1 is for oncoming traffic, but vehicles drive" in note for note in case.notes)
    assert not any("oncoming traffic, but" in note for note in alone.notes)


def test_the_road_that_the_trace_names_lies_beside_it(tmp_path: Path) -> None:
    path = scene(tmp_path / "t.osi", AV, more=((15, "https://roads.example/road.xodr"),))
    assert read_osi(path).facts["road"] is None
    on_road(tmp_path)
    assert read_osi(path).facts["road"] == "road.xodr"
    other = tmp_path / "other.xodr"
    other.write_text(road([lane(-1), lane(-2)]), encoding="utf-8")
    assert read_osi(path, road=other).odd.n_lanes == 2


def test_without_a_road_lanes_are_where_vehicles_drive(tmp_path: Path) -> None:
    angle = 0.7
    things = [Thing(0, 0.0, 0.0), Thing(1, 30.0, 3.4), Thing(2, -40.0, -3.6), Thing(3, 60.0, 0.1)]
    cos, sin = np.cos(angle), np.sin(angle)
    turned = [
        replace(one, x=one.x * cos - one.y * sin, y=one.x * sin + one.y * cos, yaw=angle, vx=20.0 * cos, vy=20.0 * sin)
        for one in things
    ]
    case = read_osi(scene(tmp_path / "t.osi", *turned))
    assert case.odd.n_lanes == 3
    assert case.odd.lane_width == pytest.approx(3.5, abs=0.02)
    assert case.poses[0, :, LANE].tolist() == [1.0, 2.0, 0.0, 1.0]
    np.testing.assert_allclose(np.diff(case.poses[0, :, X]), np.diff([one.x for one in things]))
    np.testing.assert_allclose(np.diff(case.poses[0, :, Y]), np.diff([one.y for one in things]), atol=1e-9)
    assert any("3 lanes, 3.5" in note for note in case.notes)
    with pytest.raises(DataError, match="which are no lanes; say on which road"):
        read_osi(scene(tmp_path / "t.osi", AV, replace(AHEAD, y=0.0), Thing(2, 80.0, 0.0 - 6.0 + 1.9)))


def test_a_road_of_one_lane_gets_another_and_says_so(tmp_path: Path) -> None:
    case = read_osi(scene(tmp_path / "t.osi", AV, AHEAD))
    assert case.odd.n_lanes == 2
    assert any("its 1 lanes" in note for note in case.notes)
    assert ONE_LANE in case.notes


def test_without_a_road_a_bend_is_seen(tmp_path: Path) -> None:
    frames = []
    for k in range(51):
        things = []
        for ident, ahead in ((0, 0.0), (1, 40.0)):
            angle = (ahead + 2.0 * k) / 300.0
            x, y = 300.0 * np.sin(angle), 300.0 - 300.0 * np.cos(angle)
            vx, vy = 20.0 * np.cos(angle), 20.0 * np.sin(angle)
            things.append(Thing(ident, float(x), float(y), angle, float(vx), float(vy)))
        frames.append(ground_truth(0.1 * k, things, host=0))
    with pytest.raises(DataError, match=r"all vehicles turn, by 0\.33 rad or more: the road bends"):
        read_osi(stream(tmp_path / "t.osi", frames))


def test_sensor_views_are_read(tmp_path: Path) -> None:
    place = on_road(tmp_path)
    truths = [ground_truth(0.1 * k, [driven(AV, 0.1 * k)] if k else [], host=0) for k in range(21)]
    views = [encoded(((2, ((1, 0), (2, 0))), (3, ((1, 4),)), (7, truth))) for truth in truths]
    case = read_osi(stream(tmp_path / "t.osi", views), road=place)
    same = read_osi(stream(tmp_path / "u.osi", truths), road=place)
    np.testing.assert_array_equal(case.poses, same.poses)


def damaged(whole: bytes, frame: int, new: bytes) -> bytes:
    """The stream with other bytes instead of one frame, length included."""
    at = 0
    for _ in range(frame):
        at += 4 + struct.unpack_from("<I", whole, at)[0]
    return whole[:at] + new + whole[at + 4 + struct.unpack_from("<I", whole, at)[0] :]


def framed(content: bytes) -> bytes:
    return struct.pack("<I", len(content)) + content


def one_frame(*things: Thing, time: float = 0.15) -> bytes:
    return framed(ground_truth(time, things, host=0))


NAN, INF = float("nan"), float("inf")
DAMAGE = {
    "cut in a message": (lambda whole: whole[:-5], FileFormatError, "frame 100: it is cut off"),
    "cut in a length": (lambda whole: whole + b"\x07\x00", FileFormatError, "frame 101: it is cut off"),
    "giant length": (lambda whole: damaged(whole, 3, b"\xff\xff\xff\xff"), FileFormatError, "frame 3: it is cut off"),
    "no message": (lambda whole: damaged(whole, 3, framed(b"\xff" * 40)), FileFormatError, "frame 3: this is no mess"),
    "text": (lambda _: b"no such thing\n", FileFormatError, "frame 0: it is cut off, or this is no OSI trace"),
    "empty": (lambda _: b"", FileFormatError, "is empty"),
    "nothing moves": (lambda _: framed(ground_truth(0.0, [])), DataError, "no frame of 1 holds a moving object"),
    "no place": (lambda whole: damaged(whole, 3, one_frame(replace(AV, x=NAN))), DataError, "3: x of object 0 is nan"),
    "far": (lambda whole: damaged(whole, 3, one_frame(replace(AV, y=1e300))), DataError, "3: y of object 0 is 1e"),
    "no speed": (lambda whole: damaged(whole, 3, one_frame(replace(AV, vx=INF))), DataError, "3: x of object 0 is inf"),
    "no yaw": (lambda whole: damaged(whole, 3, one_frame(replace(AV, yaw=NAN))), DataError, "frame 3: yaw of object 0"),
    "no size": (lambda whole: damaged(whole, 3, one_frame(replace(AV, width=-2.0))), DataError, "3: object 0 has"),
    "twice": (lambda whole: damaged(whole, 3, one_frame(AV, AV)), DataError, "frame 3: object 0 is there twice"),
    "time back": (lambda whole: damaged(whole, 3, one_frame(AV, time=0.05)), DataError, "3: its time, 0.05 s, do"),
    "time stands": (lambda whole: damaged(whole, 3, one_frame(AV, time=0.1)), DataError, "3: its time, 0.1 s, do"),
    "other host": (
        lambda whole: damaged(whole, 3, framed(ground_truth(0.15, [AV], host=4))), DataError, "3: the host vehicle is",
    ),
    "no id": (
        lambda whole: damaged(whole, 3, framed(ground_truth(0.15, [], more=((5, AV.fields()[1:]),)))), DataError,
        "frame 3: a moving object has no id",
    ),
    "hole": (lambda whole: damaged(whole, 100, one_frame(AV, time=9.0)), DataError, "frame 100: 4.05 s are missing"),
}  # fmt: skip


@pytest.mark.parametrize("what", DAMAGE)
def test_a_damaged_trace_is_refused_in_one_line(tmp_path: Path, what: str) -> None:
    path = scene(tmp_path / "t.osi", AV, AHEAD)
    change, error, words = DAMAGE[what]
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(error) as said:
        read_osi(path)
    assert str(said.value).startswith("t.osi")
    assert words in str(said.value)
    assert "\n" not in str(said.value)


def test_a_name_that_is_no_text_is_no_end(tmp_path: Path) -> None:
    path = scene(tmp_path / "t.osi", AV, more=((15, b"\xff\xfe road.xodr"),))
    assert read_osi(path, road=on_road(tmp_path)).facts["map_reference"] == "\ufffd\ufffd road.xodr"


def test_mcap_files_are_read_with_care(tmp_path: Path) -> None:
    pytest.importorskip("mcap", reason="mcap is not installed (the extra osi)")
    from mcap.writer import CompressionType, Writer

    place = on_road(tmp_path)
    truths = [ground_truth(0.1 * k, [driven(AV, 0.1 * k)], host=0) for k in range(21)]

    def written(topics: int = 1, schema: str = "osi3.GroundTruth", **how: CompressionType) -> Path:
        with (tmp_path / "t.mcap").open("wb") as file:
            writer = Writer(file, **how)
            writer.start()
            kind = writer.register_schema(schema, "protobuf", b"")
            channels = [writer.register_channel(f"topic{k}", "protobuf", kind) for k in range(topics)]
            for frame, truth in enumerate(truths):
                for channel in channels:
                    writer.add_message(channel, frame, truth, frame)
            writer.finish()
        return tmp_path / "t.mcap"

    wanted = read_osi(stream(tmp_path / "t.osi", truths), road=place)
    for compression in CompressionType:
        case = read_osi(written(compression=compression), road=place)
        np.testing.assert_array_equal(case.poses, wanted.poses)
    with pytest.raises(DataError, match=r"several traces \(topic0, topic1\)"):
        read_osi(written(topics=2), road=place)
    with pytest.raises(FileFormatError, match="no channel of osi3"):
        read_osi(written(schema="osi3.SensorData"), road=place)
    whole = written().read_bytes()
    (tmp_path / "t.mcap").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FileFormatError, match=r"t\.mcap, frame \d+: it is no whole MCAP file"):
        read_osi(tmp_path / "t.mcap", road=place)


def test_a_small_file_does_not_unpack_to_a_large_one(tmp_path: Path) -> None:
    """A chunk that says 1 kB and holds 1 GB in 50 kB."""
    pytest.importorskip("mcap", reason="mcap is not installed (the extra osi)")
    import zstandard
    from mcap.data_stream import RecordBuilder
    from mcap.records import Chunk, Header

    builder = RecordBuilder()
    Header(profile="", library="").write(builder)
    bomb = zstandard.compress(bytes(1 << 30))
    Chunk(
        compression="zstd", data=bomb, message_end_time=0, message_start_time=0, uncompressed_crc=0,
        uncompressed_size=1024,
    ).write(builder)  # fmt: skip
    magic = b"\x89MCAP0\r\n"
    (tmp_path / "t.mcap").write_bytes(magic + builder.end() + magic)
    with pytest.raises(CornerForgeError, match="a chunk of another size than it says"):
        read_osi(tmp_path / "t.mcap")


@pytest.mark.parametrize(
    ("ending", "module"), [("osi", "google.protobuf.descriptor_pb2"), ("mcap", "mcap.stream_reader")]
)
def test_a_missing_library_is_named_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str, module: str
) -> None:
    """A new process would take seconds; the classes made so far are forgotten instead."""
    path = scene(tmp_path / f"t.{ending}", AV)
    monkeypatch.setitem(sys.modules, module, None)
    for made in (osi_messages._file, osi_messages.message_class):
        made.cache_clear()
    with pytest.raises(MissingExtraError, match=r"cornerforge\[osi\]"):
        read_osi(path)
