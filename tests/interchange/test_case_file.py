"""The case file: what is written comes back as the same bits, and what is wrong is named with its place."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from cornerforge._schema import read
from cornerforge.drivers.rails import ACCELERATION, LANE, POSE_NUMBERS, SPEED, X, Y
from cornerforge.errors import FileFormatError, InputError, OutputError
from cornerforge.library.case_content import CaseContent, case_schema
from cornerforge.library.case_file import (
    CaseFile,
    Happened,
    case_text,
    of_moving,
    read_case_file,
    write_case_file,
)
from cornerforge.library.out_case import Fact, MovingCase, straight_road
from cornerforge.sim import Script, n_slots, scripted
from cornerforge.types import CLASSES, MAX_LANES, N_ACTIONS, Odd


def moving_case(frames: int = 41) -> MovingCase:
    """Two vehicles beside each other and a third that comes later, leaves for a moment, and changes lanes."""
    rng = np.random.default_rng(7)
    time = 0.1 * np.arange(frames)
    poses = np.zeros((frames, 3, POSE_NUMBERS))
    poses[:, :, X] = (20.0 + rng.random(3)) * time[:, None] + rng.random((frames, 3)) / 3.0
    poses[:, :, Y], poses[:, :, LANE] = [1.75, 5.25, 8.75], [0, 1, 2]
    poses[:, :, SPEED] = 20.0 + rng.random((frames, 3))
    poses[:, 1, ACCELERATION] = -0.0
    poses[:4, 2] = np.nan
    poses[11:14, 2] = np.nan
    poses[20:, 2, LANE] = 1
    odd = straight_road(lanes=3, lane_width=3.5, vehicles=3, seconds=0.1 * frames, fastest=22.0, av_size=(4.6, 1.8))
    size = np.array([4.6, 12.3, 2.2]), np.array([1.8, 2.5, 0.8])
    notes = ("line 3: a bicycle is left out",)
    facts: dict[str, Fact] = {"source": "made up", "risk_per_hour": 1e-9, "is_real": False, "weather": None}
    return MovingCase("three", odd, np.array([0, 1, 2], np.int8), *size, poses, facts, notes)


def acting_case(seed: int = 1) -> CaseFile:
    """Five vehicles in motion with the most awkward numbers."""
    rng = np.random.default_rng(seed)
    n = 5
    shape = (n, len(scripted.START_FIELDS))
    rows = rng.standard_normal(shape) * 10.0 ** rng.integers(-18, 1, shape)
    table = dict(zip(scripted.START_FIELDS, rows.T, strict=True))
    for name in ("speed", "clock", "duration", "quantile", "habit", "desired_speed", "change_time", "inattention"):
        table[name] = np.abs(table[name]) % 1.0
    table["noise"] = table["noise"] % 1.0
    table["change_time"] += 0.1
    table["heading"][0], table["lateral_speed"][1] = -0.0, 0.0
    for name, high in (("target_lane", 3), ("signals", 2), ("away", 2)):
        table[name] = rng.integers(0, high, n).astype(np.float64)
    table["lanes"], table["kind"] = np.full(n, 3.0), np.zeros(n)
    table["length"], table["width"] = np.full(n, 5.0), np.full(n, 2.0)
    start = scripted.scripted_start(np.stack([table[name] for name in scripted.START_FIELDS], axis=1))
    action = rng.integers(-1, N_ACTIONS, (6, n)).astype(np.int8)
    action[:, 0], action[:, 3] = -1, -1
    scale = np.array([100.0, 10.0, 15.0, 10.0, 1.0, 100.0, 0.0])
    recorded = (scale * rng.standard_normal((31, POSE_NUMBERS))).astype(np.float32).astype(np.float64)
    recorded[:, LANE] = 2
    script = Script(np.array([0, 2, 3, 7, 30], np.int16), start, action, 2**62, 12345)
    contact = Happened(31, 7, rng.standard_normal((2, 4)))
    return CaseFile(
        "acting", Odd(), script, "some-av", "0123456789abcdef", contact, recorded, "fedcba9876543210", "CC0"
    )


def assert_same(one: CaseFile, other: CaseFile) -> None:
    for field in fields(Script):
        a, b = getattr(one.script, field.name), getattr(other.script, field.name)
        assert (a.tobytes() if isinstance(a, np.ndarray) else a) == (b.tobytes() if isinstance(b, np.ndarray) else b)
    for name in ("name", "odd", "av", "av_hash", "model", "licence", "facts", "notes"):
        assert getattr(one, name) == getattr(other, name)
    assert repr(one.odd) == repr(other.odd), "4 is not 4.0: the hash of a road would differ"
    assert bits(one.recorded) == bits(other.recorded)
    assert (one.happened is None) == (other.happened is None)
    if one.happened is not None and other.happened is not None:
        assert bits(one.happened.pose) == bits(other.happened.pose)
        assert one.happened.frame == other.happened.frame
        assert one.happened.partner == other.happened.partner


def bits(array: NDArray[np.float64] | None) -> bytes | None:
    return None if array is None else array.tobytes()


@pytest.mark.parametrize(
    "make", [acting_case, lambda: of_moving(moving_case()), lambda: of_moving(moving_case(), set_speed=33.3)]
)
def test_what_is_written_comes_back_as_the_same_bits(make: Callable[[], CaseFile], tmp_path: Path) -> None:
    case = make()
    path = write_case_file(case, tmp_path / "case.json")
    again = read_case_file(path)
    if case.script.poses is not None:  # actions move nobody on rails
        case = replace(case, script=replace(case.script, action=np.full_like(case.script.action, -1)))
    assert_same(case, again)
    assert case_text(again) == path.read_text(encoding="utf-8"), "the same case is the same bytes"


@given(st.integers(0, 10**6))
def test_any_start_comes_back(seed: int) -> None:
    case = acting_case(seed)
    text = case_text(case)
    from cornerforge.library.case_file import _case_of, _checked  # the file itself is tested above

    assert_same(case, _case_of(*_checked(json.loads(text), "")))


def test_of_moving_is_what_the_case_says() -> None:
    case = moving_case()
    made = of_moving(case)
    assert made.on_rails
    assert made.av_is_recorded
    assert made.av == "recorded"
    assert made.happened is None
    assert made.notes == case.notes
    assert made.script.poses is not None
    np.testing.assert_array_equal(made.script.poses[: len(case.poses)], case.poses)
    unknown = case.poses.copy()
    unknown[1:, 0] = np.nan
    assert of_moving(replace(case, poses=unknown)).av is None


def test_a_person_can_read_it() -> None:
    lines = case_text(of_moving(moving_case())).splitlines()
    assert lines[1:4] == [' "format": "cornerforge case",', ' "version": 1,', ' "name": "three",']
    assert sum('"x_m": [' in line for line in lines) == 3, "one vehicle's series a line"
    assert any(line.strip().startswith('"y_m": 1.75') for line in lines), "what stays the same is said once"


def test_the_schema_is_a_schema_and_files_follow_it() -> None:
    jsonschema.Draft202012Validator.check_schema(case_schema())
    for case in (acting_case(), of_moving(moving_case())):
        jsonschema.validate(json.loads(case_text(case)), case_schema())


def test_the_schema_knows_what_the_code_knows() -> None:
    ours = {name: one for name, one in case_schema()["$defs"].items() if name.endswith("Content")}
    parts = {name.removesuffix("Content"): one["properties"] for name, one in ours.items()}
    assert set(parts["Road"]) == {field.name for field in fields(Odd)}
    longest = parts["Road"]["traffic_length"]["maximum"]
    assert parts["Case"]["vehicles"]["maxItems"] == n_slots(Odd(n_lanes=MAX_LANES, traffic_length=longest))
    vehicle = parts["Vehicle"]
    assert vehicle["class"]["enum"] == sorted(one.name for one in CLASSES)
    assert [one["maximum"] for one in vehicle["actions"]["anyOf"] if "maximum" in one] == [N_ACTIONS - 1]
    assert len(parts["Start"]) == len(scripted.START_FIELDS) - 3 + 1, "all but length, width, class; and at_site"
    assert len(parts["Agent"]) == len(scripted.AGENT_FIELDS)


def test_the_schema_on_paper_is_made_of_the_types(golden: Callable[[str, str], None]) -> None:
    """docs/case_file.schema.json."""
    golden("../../docs/case_file.schema.json", json.dumps(case_schema(), indent=1, ensure_ascii=False) + "\n")


def change(*path: str | int, to: Any) -> Callable[[dict[str, Any]], None]:
    def make(content: dict[str, Any]) -> None:
        at: Any = content
        for key in path[:-1]:
            at = at[key]
        if to is ...:
            del at[path[-1]]
        else:
            at[path[-1]] = to

    return make


_PLACE = {"x_m": 1, "y_m": 1, "speed_mps": 1, "heading_rad": 0}
CONTACT = {"contact": True, "partner": 1, "av": _PLACE, "other": _PLACE}
WRONG = [
    (change("name", to="../x"), r"\"name\" is '\.\./x'; it must be a text of the form"),
    (change("name", to=...), '"name" is missing'),
    (change("colour", to="red"), '"colour" is unknown'),
    (change("road", "n_lanes", to=9), '"road.n_lanes" is 9; it must be a whole number of at most 6'),
    (change("road", "lane_width", to="wide"), "\"road.lane_width\" is 'wide'; it must be a number"),
    (change("others", to="fly"), "\"others\" is 'fly'; it must be one of act, rails"),
    (change("vehicles", to=[]), r'"vehicles" is \[\]; it must be a list of at least 1'),
    (change("vehicles", 1, "class", to="tram"), r"vehicles\[1\].class\" is 'tram'; it must be one of car, motorcycle"),
    (change("vehicles", 1, "length_m", to=True), r'vehicles\[1\].length_m" is True; it must be a number'),
    (change("vehicles", 1, "slot", to=0), r"the slots of the vehicles are \[0, 0, 2\]; they must ascend"),
    (change("vehicles", 1, "start", "target_lane", to=4), r"vehicles\[1\].start names a lane that the road"),
    (change("vehicles", 0, "start", "change_time_s", to=...), r"vehicles\[0\].start.change_time_s is 0; a change"),
    (change("vehicles", 1, "poses", to=...), r"vehicles\[1\] lacks poses: it is on rails"),
    (change("vehicles", 1, "poses", "lane", to=3), r"vehicles\[1\].poses.lane must be a whole number from 0 to 2"),
    (change("vehicles", 1, "poses", "lane", to=0.5), r"vehicles\[1\].poses.lane must be a whole number from 0 to 2"),
    (change("vehicles", 1, "poses", "x_m", to=[1.0]), r"vehicles\[1\].poses.x_m has 1 entries; it must have"),
    (change("vehicles", 2, "poses", "x_m", 0, to=None), r"vehicles\[2\].poses.y_m is null in other frames"),
    (change("vehicles", 1, "actions", to=5), r"vehicles\[1\]: actions stand where others act"),
    (change("vehicles", 1, "poses", "first_frame", to=5), r"vehicles\[1\].poses ends after frame"),
    (change("seconds", to=60), "seconds is 60; it must not be above the road's time_limit|frames is"),
    (change("frames", to=None), "frames is None; rails of"),
    (change("vehicles", 1, "poses", "speed_mps", to=1e9), 'poses.speed_mps" is 1000000000.0; it must be'),
    (change("vehicles", 1, "poses", "heading_rad", to=8), r'vehicles\[1\].poses.heading_rad" is 8; it must be'),
    (change("vehicles", 1, "poses", "lateral_speed_mps", to=101), 'poses.lateral_speed_mps" is 101; it must be'),
    (change("vehicles", 1, "poses", "acceleration_mps2", to=1001), 'poses.acceleration_mps2" is 1001; it must be'),
    (change("vehicles", 2, "poses", "x_m", to=[None] * 67), r"poses.x_m is null in all frames; the vehicle must be"),
    (change("vehicles", 2, "start", "x_m", to=99999), r"vehicles\[2\].start.x_m is 99999; it must be "),
    (change("vehicles", 1, "start", "y_m", to=5.2), r"vehicles\[1\].start.y_m is 5.2; it must be 5.25, as in the"),
    (change("vehicles", 0, "start", "speed_mps", to=-5), r"start.speed_mps is -5; that of the AV must be 0 or more"),
    (change("vehicles", 0, "poses", "first_frame", to=1), r"vehicles\[0\].poses.first_frame is 1; that of the AV"),
    (change("happened", to=CONTACT | {"time_s": 900}), r"happened.time_s is 900; it must be at most \d+, the length"),
    (change("facts", "speed", to={"a": 1}), "\"facts.speed\" is {'a': 1}; it must be true or false"),
    (change("happened", to={"contact": True}), "happened.contact is True, so happened must have time_s"),
    (change("happened", to={"contact": False, "time_s": 1}), "happened must not have time_s"),
]  # fmt: skip


@pytest.mark.parametrize(("spoil", "message"), WRONG)
def test_what_is_wrong_is_named(spoil: Callable[[dict[str, Any]], None], message: str, tmp_path: Path) -> None:
    content = json.loads(case_text(of_moving(moving_case())))
    spoil(content)
    path = tmp_path / "case.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(FileFormatError, match=message) as raised:
        read_case_file(path)
    assert str(path) in str(raised.value)


def test_more_vehicles_than_the_road_has_room_for(tmp_path: Path) -> None:
    content = json.loads(case_text(acting_case()))
    content["road"].update(n_lanes=3, traffic_length=80, av_start=0)
    one = content["vehicles"][1]
    path = tmp_path / "case.json"
    for more, is_too_many in ((2, False), (3, True)):
        vehicles = [*content["vehicles"], *(one | {"slot": 31 + k} for k in range(more))]
        path.write_text(json.dumps(content | {"vehicles": vehicles}), encoding="utf-8")
        if is_too_many:
            with pytest.raises(FileFormatError, match=r"case\.json: vehicles has 8 entries; .* of 80 m has room for 7"):
                read_case_file(path)
        else:
            assert read_case_file(path).script.slot.size == 7


@pytest.mark.full
def test_our_checks_and_a_validator_made_by_others_agree() -> None:
    """All single changes of type and range that the schema forbids, here a sample of each place, are found by both."""
    validator = jsonschema.Draft202012Validator(case_schema())
    rng = np.random.default_rng(3)
    plain = json.loads(case_text(of_moving(moving_case())))
    junk: list[Any] = [None, True, -5, 0.5, 10**12, "x", [], {}, [None], [1, 2], {"a": 1}]
    found = 0
    for _ in range(400):
        content = json.loads(json.dumps(plain))
        at: Any = content
        while True:
            keys = list(at) if isinstance(at, dict) else list(range(len(at)))
            key = keys[rng.integers(len(keys))]
            if not isinstance(at[key], (dict, list)) or not at[key] or rng.random() < 0.2:
                break
            at = at[key]
        at[key] = junk[rng.integers(len(junk))]
        theirs = validator.is_valid(content)
        with nullcontext() if theirs else pytest.raises(FileFormatError):
            read(CaseContent, content, "")
        found += not theirs
    assert found > 200


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is no case file: Expecting value"),
        ("[]", 'it has no "format"'),
        ('{"format": "cornerforge case library"}', 'it has no "format": "cornerforge case"'),
        ('{"format": "cornerforge case", "version": 2}', "version 2; this cornerforge reads version 1: upgrade"),
        ('{"format": "cornerforge case", "version": true}', "version True; this cornerforge reads version 1"),
        ('{"format": "cornerforge case", "format": "cornerforge case"}', 'the key "format" is there twice'),
        ('{"format": NaN}', "NaN is no number of JSON"),
        ('{"format": 1e999}', "the number 1e999 is too large"),
        ('{"a":' * 100_000, "nested too deeply"),
        ("\ufeff{}", 'it has no "format"'),
        ('{"format": ' + "9" * 5000 + "}", "is no case file"),
    ],
)  # fmt: skip
def test_what_is_no_case_file_is_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "case.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError, match=message):
        read_case_file(path)


def test_a_case_file_with_a_byte_order_mark_is_read_and_utf_16_is_refused(tmp_path: Path) -> None:
    path = write_case_file(acting_case(), tmp_path / "case.json")
    text = path.read_text(encoding="utf-8")
    marked, wide = tmp_path / "marked.json", tmp_path / "wide.json"
    marked.write_text(text, encoding="utf-8-sig")
    assert case_text(read_case_file(marked)) == text
    wide.write_text(text, encoding="utf-16")
    with pytest.raises(FileFormatError, match="it is no text in UTF-8; save it as such"):
        read_case_file(wide)


def test_half_a_file_bytes_and_no_file(tmp_path: Path) -> None:
    path = tmp_path / "case.json"
    text = case_text(acting_case())
    path.write_text(text[: len(text) // 2], encoding="utf-8")
    with pytest.raises(FileFormatError, match="is no case file"):
        read_case_file(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match="is no case file"):
        read_case_file(path)
    with pytest.raises(FileFormatError, match="No such file"):
        read_case_file(tmp_path / "none.json")
    with pytest.raises(FileFormatError, match="Cannot read"):
        read_case_file(tmp_path)


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cornerforge.library.case_file.MOST_BYTES", 1_000_000)
    path = tmp_path / "case.json"
    path.write_bytes(b" " * 1_000_001)
    with pytest.raises(FileFormatError, match="more than 1 MB"):
        read_case_file(path)


def test_nothing_is_overwritten_and_nothing_half_written(tmp_path: Path) -> None:
    case = acting_case()
    path = write_case_file(case, tmp_path / "deep" / "case.json")
    with pytest.raises(OutputError, match="exists already"):
        write_case_file(case, path)
    write_case_file(replace(case, licence="MIT"), path, overwrite=True)
    assert read_case_file(path).licence == "MIT"
    with pytest.raises(InputError, match=r"ends in \.json"):
        write_case_file(case, tmp_path / "case.txt")
    with pytest.raises(InputError, match="facts"):
        write_case_file(replace(case, facts={"risk": float("nan")}), path, overwrite=True)
    with pytest.raises(InputError, match='"name" is'):
        write_case_file(replace(case, name="a/b"), path, overwrite=True)
    assert sorted(one.name for one in path.parent.iterdir()) == ["case.json"]
