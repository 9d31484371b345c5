"""Tables of cases: what is written is read back, to the bit from Parquet, to six decimals from CSV."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest
from crashes_by_hand import LEFT, MIDDLE, RIGHT, Car, Turn, crash, mirrored
from hypothesis import given, settings
from hypothesis import strategies as st
from old_tables import with_comments

from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, LATERAL_SPEED, SPEED, X, Y
from cornerforge.errors import CornerForgeError, DataError, FileFormatError, InputError
from cornerforge.experiment.setting import RECORDED_AV, experiment
from cornerforge.ext.interchange.tables import COLUMNS, read_table, write_table
from cornerforge.library.out_case import ONE_LANE, Fact, OutCase, script_of
from cornerforge.types import Scenario

FACTS: dict[str, Fact] = {"av": 'the "old" one; yes', "rate_per_mile": 1.5e-7, "judge": None, "found": True}


def cut_in() -> Scenario:
    scenario = crash(
        Car(0.0, MIDDLE, 30.0),
        Car(35.0, LEFT, 27.0, ((1.0, -3.0),), (Turn(0.5, 3.0, MIDDLE),)),
        Car(-60.0, RIGHT, 25.0),
    )
    present = scenario.present.copy()
    present[12:, 2] = False
    return replace(
        scenario, present=present, kind=np.array([0, 1, 2], np.int8), slot=np.array([0, 7, 3], np.int16),
        length=np.array([4.7, 16.5, 2.2]), width=np.array([1.9, 2.55, 0.8]),
    )  # fmt: skip


@pytest.mark.parametrize("ending", ["csv", "parquet"])
@pytest.mark.parametrize("turned", [False, True])
def test_what_is_written_is_read(tmp_path: Path, ending: str, turned: bool) -> None:
    scenario = mirrored(cut_in()) if turned else cut_in()
    path = tmp_path / f"t.{ending}"
    write_table(OutCase("case-1", scenario, FACTS), path)
    case = read_table(path)
    order = np.argsort(scenario.slot)
    there = scenario.present[:, order]
    off = 6e-7 if ending == "csv" else 0.0
    for number, series in (
        (X, scenario.x), (Y, scenario.y), (SPEED, scenario.speed), (HEADING, scenario.heading),
        (ACCELERATION, scenario.acceleration), (LANE, scenario.target_lane),
    ):  # fmt: skip
        np.testing.assert_array_equal(np.isfinite(case.poses[:, :, number]), there)
        np.testing.assert_allclose(case.poses[:, :, number][there], series[:, order][there], rtol=0.0, atol=off)
    np.testing.assert_allclose(case.poses[:, 2, LATERAL_SPEED], np.gradient(scenario.y[:, 1], 0.1), atol=1e-5)
    assert (case.kind.tolist(), case.length.tolist(), case.width.tolist()) == (
        [0, 2, 1],
        [4.7, 2.2, 16.5],
        [1.9, 0.8, 2.55],
    )
    assert (case.name, dict(case.facts), case.notes) == ("case-1", FACTS, ())
    assert (case.odd.n_lanes, case.odd.lane_width) == (3, 4.0)


def test_the_crash_comes_again_at_the_same_step(tmp_path: Path) -> None:
    scenario = crash(Car(0.0, MIDDLE, 30.0), Car(35.0, LEFT, 27.0, ((1.0, -3.0),), (Turn(0.5, 3.0, MIDDLE),)))
    write_table(OutCase("case-1", scenario, {}), tmp_path / "t.csv")
    case = read_table(tmp_path / "t.csv")
    driver = experiment(road=case.odd, av=RECORDED_AV, takes_recorded=True).script_driver()
    again, _ = driver.record(script_of(case))
    assert again.crash == scenario.crash


def test_an_av_with_one_row_is_not_recorded(tmp_path: Path) -> None:
    scenario = cut_in()
    present = scenario.present.copy()
    present[1:, 0] = False
    write_table(OutCase("case-1", replace(scenario, present=present), {}), tmp_path / "t.parquet")
    case = read_table(tmp_path / "t.parquet")
    assert not case.av_is_recorded
    assert len(case.poses) == len(scenario.x)


def test_the_file_says_what_its_columns_mean(tmp_path: Path) -> None:
    for ending in ("csv", "parquet"):
        write_table(OutCase("case-1", cut_in(), FACTS), tmp_path / f"t.{ending}")
    schema = pq.read_schema(tmp_path / "t.parquet")
    beside = json.loads((tmp_path / "t.facts.json").read_text())
    for column, field in zip(COLUMNS, schema, strict=True):
        assert field.metadata[b"meaning"].decode() == column.meaning
        assert beside["columns"][column.name] == {"unit": column.unit, "meaning": column.meaning}
    assert json.loads(schema.metadata[b"cornerforge"])["facts"] == FACTS
    assert beside["facts"] == FACTS
    read = pa_csv.read_csv(tmp_path / "t.csv")  # as pandas and spreadsheets do: no comment, one head, one table
    assert (read.num_rows, read.column_names) == (cut_in().present.sum(), [column.name for column in COLUMNS])


def test_a_csv_file_with_comments_is_the_same_case(tmp_path: Path) -> None:
    write_table(OutCase("case-1", cut_in(), FACTS), tmp_path / "t.csv")
    new, old = read_table(tmp_path / "t.csv"), read_table(with_comments(tmp_path / "t.csv"))
    assert not (tmp_path / "t.facts.json").exists()
    assert (new.name, new.facts, new.odd) == (old.name, old.facts, old.odd)
    np.testing.assert_array_equal(new.poses, old.poses)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, r"t\.csv: the road is not given; t\.facts\.json beside"),
        ("{", r"t\.facts\.json: it holds no JSON"),
        ("[]", r"t\.facts\.json: it holds no JSON object"),
        ("{}", "the road is not given"),
        ('{"road": {"lanes": 3, "lane_width_m": 4.0}, "facts": []}', "the road is not given"),
    ],
)
def test_facts_that_are_gone_or_damaged_are_one_clear_error(tmp_path: Path, content: str | None, message: str) -> None:
    write_table(OutCase("case-1", cut_in(), FACTS), tmp_path / "t.csv")
    (tmp_path / "t.facts.json").unlink()
    if content is not None:
        (tmp_path / "t.facts.json").write_text(content, encoding="utf-8")
    with pytest.raises(FileFormatError, match=message):
        read_table(tmp_path / "t.csv")


def change(old: str, new: str) -> Callable[[str], str]:
    def changed(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return changed


def row_changed(number: int, column: str, value: str) -> Callable[[str], str]:
    def changed(text: str) -> str:
        lines = text.split("\n")
        at = next(i for i, line in enumerate(lines) if line.startswith("frame,")) + number
        parts = lines[at].split(",")
        parts[[c.name for c in COLUMNS].index(column)] = value
        lines[at] = ",".join(parts)
        return "\n".join(lines)

    return changed


def semicolons(line: re.Match[str]) -> str:
    return line[0].replace(",", ";")


BAD: dict[str, tuple[Callable[[str], str], type[CornerForgeError], str]] = {
    "half a row": (lambda text: text[:-30], FileFormatError, "no such table"),
    "empty": (lambda _: "", FileFormatError, "no such table"),
    "no rows": (lambda text: text[: text.index("\n0,0.0,0") + 1], DataError, "there are 0 rows"),
    "NaN": (row_changed(4, "x_m", "nan"), DataError, "x_m is missing in row 4"),
    "missing": (row_changed(4, "x_m", ""), DataError, "x_m is missing in row 4"),
    "a word": (row_changed(4, "x_m", "here"), FileFormatError, "no such table"),
    "backwards": (row_changed(2, "speed_mps", "-3"), DataError, "speed_mps = -3 in row 2; allowed: 0 to"),
    "km/h": (row_changed(2, "speed_mps", "110"), InputError, "110 m/s.*in m/s"),
    "feet": (row_changed(2, "length_m", "60"), DataError, "length_m = 60 in row 2"),
    "frames of 25 Hz": (row_changed(4, "time_s", "0.04"), DataError, "ten frames a second"),
    "another class": (
        row_changed(1, "class", "tram"),
        DataError,
        'class "tram" of slot 0, the AV, is none of car, truck',
    ),
    "grows": (row_changed(4, "length_m", "4.8"), DataError, "length_m of slot 0 changes in row 4"),
    "no AV": (lambda text: text.replace(",0,car", ",1,car"), DataError, "no slot 0"),
    "twice": (row_changed(2, "slot", "0"), DataError, "two rows for one frame"),
    "seven lanes": (change('"lanes": 3', '"lanes": 7'), InputError, "7 lanes"),
    "beside": (row_changed(2, "lane", "4"), DataError, "lane 4 in a road of 3 lanes"),
    "no road": (change("# road:", "# rood:"), FileFormatError, "the road is not given"),
    "half a road": (change('"lanes": 3', '"lane": 3'), FileFormatError, "needs lanes"),
    "no JSON": (change('{"lanes"', '{lanes"'), FileFormatError, "line 3 holds no JSON"),
    "of tomorrow": (change("cornerforge case: 1", "cornerforge case: 2"), FileFormatError, "of version 2; 1 is read"),
    "semicolons": (
        lambda text: re.sub(r"(?m)^([^#].*)$", semicolons, text),
        FileFormatError,
        "holds no comma; put commas",
    ),
    "in km/h": (
        lambda text: text.replace(",6.000000,30.0", ",6.000000,72.0"),
        DataError,
        "slot 0 is not where its speed takes it",
    ),
    "no column": (change(",lane\n", ",lame\n"), FileFormatError, "each of these columns once: lane"),
    "endless": (row_changed(3, "frame", "700000"), DataError, "frame = 700000 in row 3"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_one_clear_error(tmp_path: Path, name: str) -> None:
    path = tmp_path / "t.csv"
    write_table(OutCase("case-1", cut_in(), FACTS), path)
    with_comments(path)
    changed, error, message = BAD[name]
    path.write_text(changed(path.read_text()))
    with pytest.raises(error, match=message):
        read_table(path)


@pytest.mark.parametrize(("x", "y"), [(50.0, RIGHT), (20.0, -12.0), (90.0, RIGHT)])
def test_a_class_that_no_vehicle_has_is_left_out_by_name_unless_it_is_in_the_way(
    tmp_path: Path, x: float, y: float
) -> None:
    path = tmp_path / "t.csv"
    scenario = cut_in()
    scenario.x[:, 1], scenario.y[:, 1] = scenario.x[:, 0] + x, y
    scenario.speed[:, 1] = scenario.speed[:, 0]
    write_table(OutCase("case-1", scenario, FACTS), path)
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *(re.sub(r"^(\d+,[^,]*,7,)[a-z]+", r"\1cyclist", row) for row in rows)]))
    if (x, y) == (50.0, RIGHT):
        with pytest.raises(
            DataError, match=r'slot 7, of class "cyclist", .* in the AV\'s way; it comes within 39\.4 m'
        ):
            read_table(path)
        return
    case = read_table(path)
    assert case.called == ("slot 0", "slot 3")
    [note] = case.notes
    assert re.search(
        r'slot 7, of class "cyclist", is left out: it is none that can be driven; it comes within \d+\.\d m of', note
    )


def test_a_road_of_one_lane_gets_another_and_says_so(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    write_table(OutCase("case-1", crash(Car(0.0, RIGHT, 30.0), Car(50.0, RIGHT, 20.0)), FACTS), path)
    assert read_table(path).notes == ()
    facts = tmp_path / "t.facts.json"
    facts.write_text(facts.read_text().replace('"lanes": 3', '"lanes": 1'))
    case = read_table(path)
    assert (case.odd.n_lanes, case.notes) == (2, (ONE_LANE,))


def test_other_endings_and_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.csv or \.parquet"):
        write_table(OutCase("case-1", cut_in(), {}), tmp_path / "t.xlsx")
    with pytest.raises(InputError, match=r"\.csv or \.parquet"):
        read_table(tmp_path / "t.xlsx")
    with pytest.raises(InputError, match="No file"):
        read_table(tmp_path / "t.csv")
    (tmp_path / "t.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match="no text in UTF-8"):
        read_table(tmp_path / "t.csv")


def test_bad_parquet_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.parquet"
    write_table(OutCase("case-1", cut_in(), {}), path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(FileFormatError, match="no whole Parquet file"):
        read_table(path)
    write_table(OutCase("case-1", cut_in(), {}), path)
    table = pq.read_table(path)
    x = table["x_m"].to_numpy().copy()
    x[3] = np.nan
    pq.write_table(table.set_column(table.column_names.index("x_m"), table.schema.field("x_m"), pa.array(x)), path)
    with pytest.raises(DataError, match="x_m = nan in row 4; allowed"):
        read_table(path)
    row = int(np.flatnonzero((table["slot"].to_numpy() == 0) & (table["frame"].to_numpy() == 7))[0])
    pq.write_table(pa.concat_tables([table[:row], table[row + 1 :]]), path)
    with pytest.raises(DataError, match="slot 0 has no row for frame 7, but for later ones"):
        read_table(path)
    x = table["x_m"].to_numpy().copy()
    x[row] += 40.0
    pq.write_table(table.set_column(table.column_names.index("x_m"), table.schema.field("x_m"), pa.array(x)), path)
    with pytest.raises(DataError, match="x_m of slot 0 jumps by more than 15 m after frame 6"):
        read_table(path)
    pq.write_table(pa.table({"frame": [1]}), path)
    with pytest.raises(FileFormatError, match="a case needs each of these columns once: time_s"):
        read_table(path)


def test_ten_thousand_vehicles_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    write_table(OutCase("case-1", cut_in(), {}), path)
    rows = "".join(f"0,0.0,{slot},car,5,2,{6 * slot},2,20,0,0,0\n" for slot in range(100, 9_999))
    path.write_text(path.read_text() + rows)
    with pytest.raises(InputError, match="There are 9,902 vehicles; 1 to 200"):
        read_table(path)


@settings(max_examples=100, deadline=None)
@given(at=st.integers(0, 100_000), put=st.sampled_from(["", "#", ",", "\n", "-", '"', "\x00", "é", "9e9", ",,"]))
def test_a_damaged_file_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, at: int, put: str) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.csv"
    write_table(OutCase("case-1", cut_in(), FACTS), path)
    with_comments(path)
    text = path.read_text()
    at %= len(text)
    path.write_text(text[:at] + put + text[at + 1 :], encoding="utf-8")
    message = ""
    try:
        case = read_table(path)
    except CornerForgeError as error:
        message = str(error)
    else:
        assert np.isfinite(case.poses[0, 0]).all()
    assert "\n" not in message
