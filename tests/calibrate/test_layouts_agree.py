"""The same traffic in every layout, and in every way to write text and numbers, gives the same decisions."""

from __future__ import annotations

import codecs
import gzip
import lzma
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cornerforge.errors import DataError
from cornerforge.ext.calibrate.layouts import LAYOUTS
from cornerforge.ext.calibrate.readers import Reading, guess_format, read_decisions

FEET = 0.3048
LENGTH = 4.9
"""The length that the readers take where a layout gives none [m]."""


@dataclass(frozen=True)
class Vehicle:
    """A vehicle that keeps its acceleration; the front bumper is at `at` when it comes, after `begin` seconds."""

    name: int
    begin: int
    seconds: int
    at: float
    speed: float
    acceleration: float
    lanes: tuple[int, int]
    change: int

    def front(self, time: float) -> float:
        since = time - self.begin
        return self.at + self.speed * since + 0.5 * self.acceleration * since * since

    def lane(self, time: float) -> int:
        return self.lanes[time >= self.begin + self.change - 1e-9]

    def is_there(self, time: float) -> bool:
        return self.begin - 1e-9 <= time <= self.begin + self.seconds + 1e-9


@dataclass(frozen=True)
class Moment:
    """A vehicle at a time, and the one ahead in its lane."""

    tick: int
    time: float
    vehicle: Vehicle
    leader: Vehicle | None


def moments(vehicles: list[Vehicle], per_second: int) -> list[Moment]:
    found = []
    for tick in range(per_second * max(one.begin + one.seconds for one in vehicles) + 1):
        time = tick / per_second
        there = [one for one in vehicles if one.is_there(time)]
        for one in there:
            ahead = [o for o in there if o.lane(time) == one.lane(time) and o.front(time) > one.front(time)]
            found.append(Moment(tick, time, one, min(ahead, key=lambda o: o.front(time), default=None)))
    return sorted(found, key=lambda moment: (moment.vehicle.name, moment.tick))


def pairs(moment: Moment) -> list[object] | None:
    if moment.leader is None:
        return None
    gap = moment.leader.front(moment.time) - LENGTH - moment.vehicle.front(moment.time)
    own, ahead = (one.speed + one.acceleration * (moment.time - one.begin) for one in (moment.vehicle, moment.leader))
    same_lane = moment.vehicle.lane(moment.time)
    return [same_lane, moment.vehicle.name, moment.leader.name, f"{moment.time:.1f}", own, ahead, gap]


def leaders(moment: Moment) -> list[object]:
    front = moment.vehicle.front(moment.time)
    led = ["", ""] if moment.leader is None else [moment.leader.name, moment.leader.front(moment.time) - front]
    return [moment.vehicle.name, f"{moment.time:.1f}", front, *led]


def lanes(moment: Moment) -> list[object]:
    one = moment.vehicle
    return [one.name, one.lane(moment.time), f"{moment.time:.1f}", one.front(moment.time) - LENGTH / 2.0, LENGTH]


def ngsim(moment: Moment) -> list[object]:
    one = moment.vehicle
    return [
        one.name, 1118846980200 + round(1000 * moment.time), one.front(moment.time) / FEET, one.lane(moment.time),
        LENGTH / FEET,
    ]  # fmt: skip


def tgsim(moment: Moment) -> list[object]:
    one = moment.vehicle
    centre = one.front(moment.time) - LENGTH / 2.0
    return [
        one.name,
        f"{moment.time:.1f}",
        3000.0 - centre,
        31.2 + one.lane(moment.time),
        one.lane(moment.time),
        LENGTH,
    ]


def highd(moment: Moment) -> list[object]:
    one = moment.vehicle
    return [moment.tick + 1, one.name, one.front(moment.time) - LENGTH, 21.7, LENGTH, one.lane(moment.time)]


Row = Callable[[Moment], list[object] | None]
WRITERS: dict[str, tuple[str, int, Row]] = {
    "car-following pairs": ("period,follower,leader,t_s,v_mps,vl_mps,gap_m", 10, pairs),
    "tracks with leaders": ("track,t_s,y_m,leader_track,spacing_m", 10, leaders),
    "tracks with lanes": ("veh_id,lane,t_s,s_m,length_m", 10, lanes),
    "official NGSIM": ("Vehicle_ID,Global_Time,Local_Y,Lane_ID,v_Length", 10, ngsim),
    "TGSIM": ("id,time,xloc-kf,yloc-kf,lane-kf,length-smoothed", 10, tgsim),
    "highD tracks": ("frame,id,x,y,width,laneId", 25, highd),
}
DECIMALS = 3
"""Decimals of what is written: positions are rounded to half a millimetre."""


def cells(vehicles: list[Vehicle], layout: str) -> list[list[str]]:
    header, per_second, write = WRITERS[layout]
    rows = [row for moment in moments(vehicles, per_second) if (row := write(moment)) is not None]
    return [
        header.split(","),
        *([f"{v:.{DECIMALS}f}" if isinstance(v, float) else str(v) for v in row] for row in rows),
    ]


def states(path: Path, *, followers: bool) -> np.ndarray:
    """Speed, gap, range rate and acceleration of each decision, (n, 4)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (reading,) = read_decisions([path])
    assert reading.table.bad.total == 0
    found = reading.decisions
    kept = found.where(np.isfinite(found.gap)) if followers else found
    return np.stack([kept.speed, np.minimum(kept.gap, 1e3), kept.range_rate, kept.acceleration], axis=1)


@st.composite
def traffic(draw: st.DrawFn) -> list[Vehicle]:
    """A leader, its follower, and up to three others, which may change lanes; speeds of 10 to 20 m/s."""
    found = [Vehicle(0, 0, 8, 500.0, 11.0, 0.0, (1, 1), 4)]
    for name in range(1, draw(st.integers(2, 5))):
        lanes = (1, 1) if name == 1 else draw(st.sampled_from([(1, 1), (1, 3), (2, 2), (2, 3)]))
        found.append(
            Vehicle(
                name=name,
                begin=draw(st.integers(0, 2)),
                seconds=draw(st.integers(6, 9)),
                at=500.0 + 80.0 * name + draw(st.floats(0.0, 30.0)),
                speed=10.0 + name + draw(st.sampled_from([0.0, 0.37, 1.9])),
                acceleration=draw(st.sampled_from([0.0, 0.2, -0.4])),
                lanes=lanes,
                change=draw(st.integers(3, 5)),
            )
        )
    return found


def test_every_layout_is_written_here() -> None:
    assert set(WRITERS) == {layout.name for layout in LAYOUTS}


@given(vehicles=traffic())
@settings(max_examples=12, deadline=None)
def test_the_same_traffic_gives_the_same_decisions_in_every_layout(
    tmp_path_factory: pytest.TempPathFactory, vehicles: list[Vehicle]
) -> None:
    folder = tmp_path_factory.mktemp("layouts")
    found: dict[str, np.ndarray] = {}
    for layout in WRITERS:
        path = folder / f"{layout.replace(' ', '-')}.csv"
        path.write_text("".join(",".join(row) + "\n" for row in cells(vehicles, layout)), encoding="utf-8")
        found[layout] = states(path, followers=layout in ("car-following pairs", "tracks with leaders"))
    lanes = found["tracks with lanes"]
    for layout, table in found.items():
        wanted = lanes if layout not in ("car-following pairs", "tracks with leaders") else lanes[lanes[:, 1] < 1e3]
        assert table.shape == wanted.shape, layout
        # Layouts order their vehicles differently. highD's next row is 0.06 s earlier where a leader has left.
        rounding = 0.01 + 0.06 * np.array([0.4, np.abs(wanted[:, 2]).max(), 0.6, 0.0])
        apart = (np.abs(table[:, None] - wanted[None]) / rounding).max(axis=2)
        assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) <= 1.0, layout


FLEET = [
    Vehicle(1, 0, 8, 1200.0, 20.0, 0.2, (1, 1), 4), Vehicle(2, 0, 8, 1234.5, 19.0, 0.0, (1, 1), 4),
    Vehicle(3, 1, 7, 1270.0, 21.0, -0.4, (1, 2), 4), Vehicle(4, 0, 8, 1400.0, 20.0, 0.0, (2, 2), 4),
]  # fmt: skip


def grouped(cell: str) -> str:
    """The number with commas between thousands."""
    whole, point, rest = cell.partition(".")
    return f"{int(whole):,}{point}{rest}" if whole.isdigit() else cell


def german(cell: str) -> str:
    return grouped(cell).replace(",", "_").replace(".", ",").replace("_", ".")


TEXTS: dict[str, Callable[[list[list[str]]], bytes]] = {
    "UTF-8 with a mark": lambda rows: codecs.BOM_UTF8 + joined(rows).encode(),
    "UTF-16 with a mark": lambda rows: joined(rows).encode("utf-16"),
    "UTF-16, big end first, with a mark": lambda rows: codecs.BOM_UTF16_BE + joined(rows).encode("utf-16-be"),
    "UTF-16": lambda rows: joined(rows).encode("utf-16-le"),
    "UTF-16, big end first": lambda rows: joined(rows).encode("utf-16-be"),
    "CRLF": lambda rows: joined(rows, end="\r\n").encode(),
    "CR": lambda rows: joined(rows, end="\r").encode(),
    "a spreadsheet's word on the delimiter": lambda rows: b"sep=;\r\n" + joined(rows, ";", end="\r\n").encode(),
    "lines before the header": lambda rows: ("\n# of mine\n" + joined(rows)).encode("utf-16"),
    "a delimiter after each row": lambda rows: joined(rows, end=",\n").replace(",\n", "\n", 1).encode(),
    "a delimiter after each line": lambda rows: joined(rows, end=",\n").encode(),
    "capitals and blanks": lambda rows: joined([[f" {name.upper()} " for name in rows[0]], *rows[1:]]).encode(),
    "semicolons": lambda rows: joined(rows, ";").encode(),
    "tabs": lambda rows: joined(rows, "\t").encode(),
    "semicolons, decimal commas": lambda rows: joined(rows, ";", lambda cell: cell.replace(".", ",")).encode(),
    "tabs, decimal commas": lambda rows: joined(rows, "\t", lambda cell: cell.replace(".", ",")).encode(),
    "quoted decimal commas": lambda rows: joined(rows, ",", lambda cell: f'"{cell.replace(".", ",")}"').encode(),
    "quoted thousands": lambda rows: joined(rows, ",", lambda cell: f'"{grouped(cell)}"').encode(),
    "tabs, thousands": lambda rows: joined(rows, "\t", grouped).encode("utf-16"),
    "semicolons, thousands and decimal commas": lambda rows: joined(rows, ";", german).encode("latin1"),
}


def joined(rows: list[list[str]], delimiter: str = ",", write: Callable[[str], str] = str, end: str = "\n") -> str:
    header, *others = rows
    return "".join(delimiter.join(row) + end for row in [header, *(list(map(write, row)) for row in others)])


@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("layout", ["official NGSIM", "highD tracks", "tracks with leaders"])
def test_the_way_a_table_is_written_changes_no_decision(tmp_path: Path, text: str, layout: str) -> None:
    rows = cells(FLEET, layout)
    plain, other = tmp_path / "plain.csv", tmp_path / "other.csv"
    plain.write_text(joined(rows), encoding="utf-8")
    other.write_bytes(TEXTS[text](rows))
    assert guess_format([other]) == guess_format([plain])
    wanted = states(plain, followers=False)
    assert wanted.shape[0] > 5
    np.testing.assert_array_equal(states(other, followers=False), wanted)


def test_columns_that_are_empty_count_as_missing(tmp_path: Path) -> None:
    def read(name: str, *blank: str) -> Reading:
        header, *lines = ("scenario,veh_id,t_s,lane,s_m,length_m", *(f"a,1,{k / 10},1,{3 * k},6" for k in range(60)))
        empty = [column in blank for column in header.split(",")]
        cells = [["" if no else one for no, one in zip(empty, line.split(","), strict=True)] for line in lines]
        (tmp_path / name).write_text("\n".join([header, *map(",".join, cells)]), encoding="utf-8")
        return read_decisions([tmp_path / name])[0]

    assert read("all.csv").rows_used == read("neither.csv", "scenario", "length_m").rows_used == 60
    with pytest.raises(DataError, match="no usable row; first fault: lane is not a number"):
        read("lanes.csv", "lane")


def test_the_line_of_a_fault_counts_the_lines_before_the_header(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    rows = [f"1,{k / 10},1,{3 * k}" for k in range(60)]
    path.write_text("# of mine\n\nveh_id,t_s,lane,s_m\n" + "\n".join([*rows[:5], "1,2", *rows[5:], "1,x,1,9"]), "utf-8")
    bad = read_decisions([path])[0].table.bad
    assert bad.reasons == {"wrong number of fields": (1, 9), "t_s is not a number": (1, 65)}


STRANGE = {
    "gzip": (gzip.compress(b"veh_id,t_s\n1,2\n"), "is no text; unpack it"),
    "xz": (lzma.compress(b"veh_id,t_s\n1,2\n"), "is no text; unpack it"),
    "UTF-32": ("veh_id,t_s\n1,2\n".encode("utf-32"), "is no text; unpack it"),
    "bars": (b"\nveh_id|t_s\n1|2\n", "has one field in line 2; put commas, semicolons or tabs between"),
    "other rows": (b"veh_id,t_s,lane,s_m\n1;2;3;4\n", r"no row with the 4 fields of its header \(line 2 has others"),
}


@pytest.mark.parametrize("what", STRANGE)
def test_a_file_that_is_no_such_table_is_told_what_helps(tmp_path: Path, what: str) -> None:
    content, words = STRANGE[what]
    (tmp_path / "t.csv").write_bytes(content)
    with pytest.raises(DataError, match=words):
        read_decisions([tmp_path / "t.csv"])


def test_times_in_milliseconds_are_asked_about(tmp_path: Path) -> None:
    rows = [f"1,{100 * k},1,{3 * k}" for k in range(9)]
    (tmp_path / "t.csv").write_text("\n".join(["veh_id,t_s,lane,s_m", *rows]), encoding="utf-8")
    with pytest.warns(UserWarning, match=r"cut at 8 place.* Are times in other units\?"):
        read_decisions([tmp_path / "t.csv"])


def test_lanes_numbered_from_0_are_noted(tmp_path: Path) -> None:
    rows = [f"{lane},{k / 10},{lane},{3 * k}" for lane in (0, 1) for k in range(60)]
    (tmp_path / "t.csv").write_text("\n".join(["veh_id,t_s,lane,s_m", *rows]), encoding="utf-8")
    with pytest.warns(UserWarning, match="vehicles are in lane 0 throughout, .* number lanes from 1"):
        read_decisions([tmp_path / "t.csv"])


def test_how_commas_were_read_is_said(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(joined(cells(FLEET, "highD tracks"), ";", lambda cell: cell.replace(".", ",")), encoding="utf-8")
    with pytest.warns(UserWarning, match="commas in numbers, as in 1195,100, were read as separators of decimals"):
        read_decisions([path])


REFUSED = {
    "exiD": "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,laneWidth,"
    "laneletId,leadId",
    "inD": "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,yVelocity",
    "INTERACTION": "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width",
    "pNEUMA": "track_id; type; traveled_d; avg_speed; lat; lon; speed; lon_acc; lat_acc; time",
    "SUMO's FCD output": "timestep_time;vehicle_angle;vehicle_id;vehicle_lane;vehicle_pos;vehicle_speed;vehicle_x",
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_layout_that_is_not_read_is_named_with_what_helps(tmp_path: Path, name: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(REFUSED[name] + "\n1,2,3\n", encoding="utf-8")
    for data_format in (None, "ngsim"):
        with pytest.raises(DataError, match=rf"looks like {name}.*not read: .*as tracks with lanes: columns veh_id"):
            read_decisions([path], data_format)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_xml_is_named(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "fcd.xml"
    path.write_text('<?xml version="1.0"?>\n<fcd-export>\n<timestep time="0.00"/>\n</fcd-export>\n', encoding=encoding)
    with pytest.raises(DataError, match="looks like SUMO's FCD output"):
        read_decisions([path])
    path.write_text("<html/>", encoding=encoding)
    with pytest.raises(DataError, match="is XML; trajectories are read from tables"):
        read_decisions([path])


def test_a_format_that_a_file_does_not_have_is_told_from_the_one_it_has(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(joined(cells(FLEET, "highD tracks"), ";"), encoding="utf-8")
    with pytest.raises(DataError, match=r"format ngsim: missing .* It looks like highD tracks: --format highd"):
        read_decisions([path], "ngsim")
