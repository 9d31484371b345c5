"""What the explorer's server answers, against what the files hold."""

from __future__ import annotations

import dataclasses
import io
import json
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import urlopen
from xml.etree import ElementTree

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from explorer.conftest import BRAKES, Running, asked, get, sent, started, stopped
from PIL import Image

import cornerforge
from cornerforge.analysis.prevented import CAREFULLY
from cornerforge.ext.explorer import serve as verb
from cornerforge.ext.explorer.driving import Driving
from cornerforge.ext.explorer.exhibit import Exhibit
from cornerforge.ext.explorer.sources import Analysis
from cornerforge.ext.explorer.start import cards, headline_of
from cornerforge.library import CaseLibrary
from cornerforge.library.case_file import read_case_file
from cornerforge.rates import weighted_interval
from cornerforge.report.cases import case_data
from cornerforge.report.judged import read_case_judgements, verdict
from cornerforge.verbs.drive_case import drive_case

pytestmark = pytest.mark.full


def columns(server: Running, *names: str) -> pa.Table:
    return pa.ipc.open_stream(get(server, f"api/columns?names={','.join(names)}")).read_all()


@pytest.fixture
def bare(place: Path) -> Iterator[tuple[Exhibit, Analysis]]:
    """The cases without an analysis, and the one of the natural cases, which may arrive."""
    found = verb._sources(place)
    made = Exhibit("run", [(one.source, None) for one in found], Driving((), found[0].source))
    assert found[0].analysis is not None
    yield made, found[0].analysis
    made.close()


def test_a_case_that_is_read_while_an_analysis_arrives(
    bare: tuple[Exhibit, Analysis], monkeypatch: pytest.MonkeyPatch
) -> None:
    exhibit, analysis = bare
    case = exhibit.table.first_of("natural")
    before = exhibit.case("natural", case)

    def slowly(*given: Any) -> Any:
        exhibit.analysed("natural", analysis)
        return case_data(*given)

    monkeypatch.setattr("cornerforge.ext.explorer.exhibit.case_data", slowly)
    assert exhibit.case("natural", case) == before
    monkeypatch.undo()
    assert len(exhibit.case("natural", case)["facts"]) > len(before["facts"])


def test_what_is_told_at_once_is_of_one_time(bare: tuple[Exhibit, Analysis], monkeypatch: pytest.MonkeyPatch) -> None:
    exhibit, analysis = bare
    before = exhibit.about()
    assert (before["revision"], before["start"]) == (1, [])
    assert "pc1" not in {one["name"] for one in before["columns"]}

    def slowly(sources: Any) -> str:
        exhibit.analysed("natural", analysis)
        return headline_of(sources)

    monkeypatch.setattr("cornerforge.ext.explorer.exhibit.headline_of", slowly)
    assert exhibit.about() == before
    monkeypatch.undo()
    after = exhibit.about()
    assert after["revision"] == 2
    assert after["start"]
    assert "pc1" in {one["name"] for one in after["columns"]}


def test_columns_are_those_of_the_files(server: Running, place: Path) -> None:
    told = asked(server, "api/about")
    table = columns(server, *(one["name"] for one in told["columns"]))
    assert [(one["name"], one["cases"]) for one in told["sources"]] == [("natural", 30), ("adversary", 40)]
    assert table["source"].to_pylist() == ["natural"] * 30 + ["adversary"] * 40
    library = CaseLibrary.open(place / "library").scalars()
    analysis = pq.read_table(place / "analysis" / "cases.parquet")
    rows = [analysis["case_id"].to_pylist().index(case) for case in library["case_id"].to_pylist()]
    for name in ("case_id", "av_speed_mps", "n_vehicles"):
        assert table[name].to_pylist()[30:] == library[name].to_pylist()
    for name in ("pc1", "impact_speed_mps", "fault", "prevented_by", "held_speed_prevents", "latest_any_s", "value"):
        assert table[name].to_pylist()[30:] == analysis[name].take(rows).to_pylist()
    kinds = {"number": pa.float64(), "integer": pa.int32(), "flag": pa.bool_(), "text": pa.string(),
             "category": pa.dictionary(pa.int16(), pa.string())}  # fmt: skip
    for one in told["columns"]:
        assert table.schema.field(one["name"]).type == kinds[one["type"]]
        assert one["meaning"], one
        if one["type"] == "category":
            assert set(one["values"]) == set(table[one["name"]].to_pylist()) - {None}


def test_what_follows_from_the_columns(server: Running) -> None:
    table = columns(server, "prevention", "prevented_by", "held_speed_prevents", "way_out", "time_to_react_s", "often",
                    "crash_type", "side", "striker", "manoeuvre")  # fmt: skip
    for row in table.to_pylist():
        by_braking = row["prevented_by"] not in (None, "nobody") and not row["held_speed_prevents"]
        assert (row["prevention"] in ("by braking", "models differ")) == by_braking
        assert (row["prevention"] == "by braking") == (by_braking and row["prevented_by"].count(",") >= 2)
        if row["time_to_react_s"] is not None and row["time_to_react_s"] >= 0.0:
            in_time = "after 1 s" if row["time_to_react_s"] > 0.999999 else "with a faster reaction"
            own = row["manoeuvre"] in ("av-moves", "av-brakes")
            assert row["way_out"] == ("by leaving it out" if own else in_time)
        assert row["side"] == {"rear-end by AV": "front", "rear-end by BV": "rear"}.get(row["crash_type"], row["side"])
        if row["crash_type"] in ("rear-end by AV", "rear-end by BV"):
            assert row["striker"] == row["crash_type"][-2:].lower()
    # 30 crashes in a million tests of 400 m, each of the same weight
    often = table["often"].to_pylist()
    assert often[:30] == pytest.approx([1e9 * 1609.344 / 400.0 * 30 / 10**6 / 30] * 30)
    assert often[30:] == [None] * 40


def test_a_case_is_that_of_the_library_and_the_report(server: Running, place: Path) -> None:
    ids = CaseLibrary.open(place / "library").scalars(["case_id"])["case_id"].to_pylist()
    judged = read_case_judgements(place / "analysis", ids, "")
    for case in ids[:5]:
        told = asked(server, f"api/case/adversary/{case}")
        scenario = CaseLibrary.open(place / "library").scenario(case).scenario
        data = case_data(f"adversary/{case}", scenario, judged[case].way_out)
        assert {name: told[name] for name in data} == json.loads(json.dumps(data))
        assert told["key"] == f"adversary/{case}"
        assert told["title"]
        assert told["verdict"].replace("\u2212", "-").replace("\u00a0m/s²", " m/s2") == verdict(judged[case])
        facts = {fact["name"]: fact["value"] for fact in told["facts"]}
        assert facts["fault"] == judged[case].fault


def test_ghosts_do_what_was_judged(server: Running) -> None:
    table = columns(server, "prevented_by").to_pylist()
    for row in table[::4]:
        key = f"{row['source']}/{row['case_id']}"
        case, ghosts = asked(server, f"api/case/{key}"), asked(server, f"api/case/{key}/ghosts")["drivers"]
        if row["prevented_by"] is None:
            continue
        prevents = [name for name, one in ghosts.items() if one["prevents"]]
        assert (", ".join(prevents) or "nobody") == row["prevented_by"]
        av = case["vehicles"][0]
        for one in ghosts.values():
            motion = one["motion"]
            begin = motion["from"] - av["from"]
            # It takes over from the AV where that is: the same place and speed at first.
            assert motion["x"][0] == pytest.approx(av["x"][begin], abs=0.01)
            assert motion["v"][0] == pytest.approx(av["v"][begin], abs=0.01)
            assert motion["from"] + len(motion["x"]) <= case["frames"]


def test_the_av_that_made_a_case_drives_it_again(server: Running) -> None:
    row = columns(server, "crash_time_s").to_pylist()[-1]
    key = f"{row['source']}/{row['case_id']}"
    again = asked(server, f"api/case/{key}/with/idm-mobil")
    stored = asked(server, f"api/case/{key}")
    assert (again["key"], again["crash"]) == (f"{key}@idm-mobil", stored["crash"])
    assert again["vehicles"][0]["x"][: stored["frames"]] == pytest.approx(stored["vehicles"][0]["x"], abs=0.01)
    with pytest.raises(HTTPError, match="404"):
        asked(server, f"api/case/{key}/with/nobody")


def test_another_av_is_measured_against_the_same_vehicle(
    server: Running, place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An AV that brakes from the start touches nobody; its time to collision is with the one that the first touched."""
    (tmp_path / "slow_av.py").write_text(BRAKES, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    running = started(place, "--port", 0, "--with", "slow_av:Brakes")
    free = 0
    for row in columns(server, "crash_time_s").to_pylist()[::3]:
        key = f"{row['source']}/{row['case_id']}"
        stored, other = asked(server, f"api/case/{key}"), asked(running, f"api/case/{key}/with/slow_av:Brakes")
        slot = stored["vehicles"][stored["partner"]]["slot"]
        if other["partner"] >= 0:
            continue
        free += 1
        (same,) = [vehicle for vehicle in other["vehicles"] if vehicle["slot"] == slot]
        assert len(other["ttc"]) == len(other["ttcPlane"]) == other["frames"]
        assert other["ttc"][0] == stored["ttc"][0]  # it begins alike
        av = other["vehicles"][0]
        for frame, seconds in enumerate(other["ttc"]):
            if seconds is not None:
                at = frame - same["from"]
                closing = (av["v"][frame] - same["v"][at]) * (1 if same["x"][at] > av["x"][frame] else -1)
                assert closing > 0.0
                gap = abs(same["x"][at] - av["x"][frame]) - 0.5 * (av["length"] + same["length"])
                assert seconds == pytest.approx(max(gap, 0.0) / closing, rel=0.02, abs=0.02)
    assert free > 0
    assert stopped(running) == (0, "")


def test_a_download_is_an_attachment(server: Running) -> None:
    with urlopen(server.url + "api/case/adversary/3:0/download/numbers") as answer:
        assert answer.headers["content-disposition"] == 'attachment; filename="adversary-3-0.json"'
        assert json.load(answer)["id"] == "adversary/3:0"


def test_a_case_can_be_taken_to_other_tools(server: Running, tmp_path: Path) -> None:
    """What is taken away says of itself what it is, and a case file drives."""
    offered = {one["format"] for one in asked(server, "api/about")["downloads"]}
    assert {"openscenario", "commonroad", "csv", "parquet", "json"} <= offered
    with urlopen(server.url + "api/case/adversary/3:0/download/openscenario") as answer:
        assert answer.headers["content-disposition"] == 'attachment; filename="adversary-3-0.zip"'
        pack = zipfile.ZipFile(io.BytesIO(answer.read()))
    scenario, road = sorted(pack.namelist())
    logic = ElementTree.fromstring(pack.read(scenario)).find("RoadNetwork/LogicFile")
    assert logic is not None
    assert logic.get("filepath") == road
    with urlopen(server.url + "api/case/adversary/3:0/download/json") as answer:
        (tmp_path / "case.json").write_bytes(answer.read())
    av = read_case_file(tmp_path / "case.json").av
    assert av is not None
    assert drive_case(tmp_path / "case.json", av=av).crashed


def test_a_video_can_be_taken_away(server: Running) -> None:
    """A GIF needs no program besides; its frames are read back."""
    offered = {one["format"] for one in asked(server, "api/about")["downloads"]}
    assert {"gif", "numbers"} <= offered
    with urlopen(server.url + "api/case/adversary/3:0/download/gif") as answer:
        assert answer.headers["content-type"] == "image/gif"
        picture = Image.open(io.BytesIO(answer.read()))
    assert getattr(picture, "n_frames", 1) > 10


def test_a_machine_without_ffmpeg_offers_what_it_can(exhibit: Exhibit, monkeypatch: pytest.MonkeyPatch) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")

    def none() -> str:
        raise RuntimeError("No ffmpeg exe could be found.")

    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", none)
    offered = [one["format"] for one in exhibit.about()["downloads"]]
    assert offered[:2] == ["gif", "numbers"]
    assert not {"mp4", "webm"} & set(offered)


def test_sql_gives_a_bit_for_each_row(server: Running) -> None:
    table = columns(server, "impact_speed_mps", "fault")
    speed, fault = table["impact_speed_mps"].to_numpy(), np.array(table["fault"].to_pylist())
    expected = (speed > 3.0) & (fault == "bv")
    assert 0 < expected.sum() < expected.size
    whole = "SELECT case_id, source FROM cases WHERE impact_speed_mps > 3 AND fault = 'bv'"
    for where in ("impact_speed_mps > 3 and fault = 'bv' -- a comment", whole):
        bits = np.frombuffer(sent(server, "POST", "api/sql", {"where": where}), np.uint8)
        assert (np.unpackbits(bits, bitorder="little")[: expected.size] == expected).all()
    for wrong in (
        "fault = ",
        "select 1",
        "1; select 1",
        "no_column > 1",
        "fault in (select content from read_text('/etc/hosts'))",
    ):
        with pytest.raises(HTTPError, match="400") as caught:
            sent(server, "POST", "api/sql", {"where": wrong})
        assert "\n" not in json.load(caught.value)["error"]


def test_half_a_character_is_refused_in_one_line(server: Running) -> None:
    for content in ({"where": "fault = '\ud800'"}, {"where": "true", "\ud800": 1}, "\udfff\ud800"):
        with pytest.raises(HTTPError, match="400") as caught:
            sent(server, "POST", "api/sql", content)
        assert json.load(caught.value) == {"error": "The body is not JSON."}
    assert sent(server, "POST", "api/sql", {"where": "fault <> '\U0001f697'"})  # a pair of halves is a character


def test_notes_of_earlier_versions_are_named_and_left(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(place / "library", tmp_path / "lib")
    monkeypatch.chdir(tmp_path / "lib")
    assert verb._warnings(tmp_path / "lib", verb._sources(Path())) == []
    file = tmp_path / "lib-notes.json"
    file.write_text("of the user", encoding="utf-8")
    (told,) = verb._warnings(tmp_path / "lib", verb._sources(Path()))
    assert told == f"Notes are no longer shown; those on cases of lib stay in {file}, a text file for any editor."
    assert file.read_text(encoding="utf-8") == "of the user"


@pytest.mark.parametrize(("inside", "name"), [("", "."), ("deeper", "..")])
def test_a_library_may_be_the_folder_one_is_in(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, inside: str, name: str
) -> None:
    library = tmp_path / "lib"
    shutil.copytree(place / "library", library)
    (library / inside).mkdir(exist_ok=True)
    monkeypatch.chdir(library / inside)
    running = started(name, "--port", 0)
    told = asked(running, "api/about")
    assert told["name"] == "lib"
    assert told["sources"][0]["replay"] == f"cornerforge replay {library}"
    assert stopped(running) == (0, "")
    assert verb._sources(library)[0].folder == tmp_path / "lib-analysis"
    assert not list((library / inside).glob("*-analysis"))


# --- what to look at first ---


def two(value: float) -> str:
    """Two digits, without a power of ten."""
    return f"{float(f'{value:.1e}'):g}"


def test_the_first_card_is_the_most_frequent_that_a_careful_driver_prevents(exhibit: Exhibit) -> None:
    """The judges call every second case one that a careful driver prevents; of these cases, they call none so."""
    seen = exhibit.table.table
    words = pa.array([CAREFULLY[row % 2] if row % 4 < 2 else "nobody" for row in range(seen.num_rows)])
    place = seen.column_names.index("prevention")
    changed = seen.set_column(place, "prevention", words.dictionary_encode())
    table = changed.to_pydict()
    natural = [row for row in range(30) if table["prevention"][row] in CAREFULLY]
    kinds = [table["mechanism"][row] for row in natural]
    most = max(set(kinds), key=kinds.count)
    rows = [row for row, kind in zip(natural, kinds, strict=True) if kind == most]
    first = cards(list(exhibit._state.sources.values()), dataclasses.replace(exhibit.table, table=changed))[0]
    both = "|".join(CAREFULLY)
    assert first["filters"] == {"f.source": "natural", "f.mechanism": most, "f.prevention": both}
    assert first["case"] in {f"natural/{table['case_id'][row]}" for row in rows}
    each = table["often"][0]
    low, high = weighted_interval([each] * len(rows), each)
    miles, shortest = (1e9 / (each * len(rows)), 1e9 / high)
    assert f"once in {two(miles / 1e3)} thousand miles" in first["often"]
    assert f"{two(shortest / 1e3)} thousand" in first["often"]
    assert low < each * len(rows)
    assert "BV" not in first["text"]


@pytest.mark.parametrize(
    ("word", "title", "told"),
    [
        ("by leaving it out", "that a careful driver would have prevented", "would have left out what the AV began"),
        ("nobody", "No crash here would have been prevented by a careful driver", "the most frequent one of 30"),
        ("not judged", "The most frequent crash", "Nobody looked whether"),
    ],
)
def test_the_first_card_is_honest(exhibit: Exhibit, word: str, title: str, told: str) -> None:
    table = exhibit.table.table
    column = pa.array([word] * table.num_rows).dictionary_encode()
    changed = table.set_column(table.column_names.index("prevention"), "prevention", column)
    first = cards(list(exhibit._state.sources.values()), dataclasses.replace(exhibit.table, table=changed))[0]
    assert title in first["title"]
    assert told in first["text"]


def test_crashes_of_trees_are_natural_ones(small_trees: None, tmp_path: Path) -> None:  # noqa: ARG001 - it patches
    """What `run` and `rate` leave is stored as scripts with weights; it is shown as traffic, with its rate."""
    cornerforge.rate(av="idm-mobil-blind", method="splitting", max_tests=5_000, seed=1, out=tmp_path / "r")
    (found,) = verb._sources(tmp_path / "r")
    source = found.source
    assert (source.name, source.natural, source.cases.scripted) == ("natural", True, True)
    assert source.weights is not None
    assert 0.0 < sum(source.weights.values()) < 1e-3


def test_every_column_has_words_of_its_own(exhibit: Exhibit) -> None:
    """FINDINGS 4.17: "least TTC cc human", "blame axis" and "relative lon" stood in the list of columns."""
    labels = {one["name"]: one["label"] for one in exhibit.about()["columns"]}
    assert len(set(labels.values())) == len(labels) > 60
    raw = {name for name, label in labels.items() if label == name.replace("_", " ")}
    assert raw <= {"cluster", "policy", "seed", "test", "value", "physically_plausible"}
