from __future__ import annotations

import gc
import json
import os
import shutil
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from edited_files import edit_object
from reference.records import CaseRecord, append, case_record

from cornerforge.errors import FileFormatError, InputError, OutputError, UnknownNameError
from cornerforge.experiment.roads import odd_on, road_named
from cornerforge.library import CaseLibrary, DamagedShardWarning
from cornerforge.library.manifest import read_manifest
from cornerforge.library.shards import ShardReader
from cornerforge.types import ODDS, Scenario

Identity = dict[str, str | int | float | bool | None]
Fill = Callable[[CaseLibrary, Sequence[Sequence[int]]], None]
ODD = ODDS["default"]


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def flip_a_byte(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def edit_manifest(folder: Path, **changes: Any) -> None:
    edit_object(folder / "manifest.json", **changes)


def test_what_is_appended_is_read_back(filled: Path, make_scenario: Callable[..., Scenario]) -> None:
    library = CaseLibrary.open(filled)
    assert (len(library), library.next_test, library.tests, library.crashes) == (6, 22, 22, 6)
    table = library.scalars()
    assert table.column("test").to_pylist() == [1, 4, 10, 12, 13, 20]
    assert table.column("log_prob_policy").to_pylist() == [-0.5 * test for test in (1, 4, 10, 12, 13, 20)]
    assert library.damaged == []
    assert library.verify() == []

    stored, original = library.scenario("7:12"), make_scenario(12)
    kept = list(stored.scenario.slot)
    np.testing.assert_array_equal(stored.scenario.x, original.x.astype(np.float32)[:, kept])
    assert stored.scenario.crash == original.crash
    assert stored.scalars == table.slice(3, 1).to_pylist()[0]
    assert stored.scalars["trajectory_digest"] == f"{12:064x}"


def test_what_is_read_lies_in_memory_of_arrow(filled: Path) -> None:
    # Were it a Python object, the thread of Arrow that frees it would need the GIL, and abort an interpreter that ends.
    manifest = read_manifest(filled)[0]
    shard = manifest.shards[0]
    files = (shard.cases_file, shard.tracks_file)
    gc.collect()  # what others left is not freed in between
    before = pa.total_allocated_bytes()
    contents_read = [ShardReader(filled, manifest).read(file) for file in files]
    assert pa.total_allocated_bytes() - before >= sum(file.size for file in files)
    for file, content in zip(files, contents_read, strict=True):
        assert content is not None
        assert bytes(content) == (filled / file.name).read_bytes()


def test_history_is_that_of_the_cases(filled: Path) -> None:
    library = CaseLibrary.open(filled)
    ids, history = library.history()
    assert ids == ["7:1", "7:4", "7:10", "7:12", "7:13", "7:20"]
    assert history.shape == (6, 16, 2, 4)
    for case_id, block in zip(ids, history, strict=True):
        stored = library.scenario(case_id)
        partner = list(stored.scenario.slot).index(stored.scalars["bv_slot"])
        np.testing.assert_array_equal(block, stored.history)
        np.testing.assert_array_equal(block[2, :, 0], stored.scenario.x[-21, [0, partner]])
        assert np.isnan(block[7:]).all()


def test_an_empty_library_answers(tmp_path: Path, identity: Identity) -> None:
    CaseLibrary.create(tmp_path / "new" / "library", identity, ODD)
    library = CaseLibrary.open(tmp_path / "new" / "library")
    ids, history = library.history()
    assert (len(library), ids, history.shape) == (0, [], (0, 16, 2, 4))
    assert library.scalars().num_rows == 0
    assert library.query("SELECT count(*) FROM cases") == (["count_star()"], [(0,)])
    with pytest.raises(InputError, match="holds no case yet"):
        library.scenario("7:1")


def test_a_shard_of_no_cases_commits_progress(filled: Path, identity: Identity) -> None:
    library = CaseLibrary.resume(filled, identity, ODD)
    append(library, [], next_test=500, tests=500, crashes=6)
    library.finish()
    again = CaseLibrary.open(filled)
    assert (len(again), again.next_test, again.finished) == (6, 500, True)


def test_a_killed_run_resumes_to_the_same_bytes(tmp_path: Path, identity: Identity, append_shards: Fill) -> None:
    shards = [[1, 4], [10, 12, 13], [20]]
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    append_shards(CaseLibrary.create(whole, identity, ODD), shards)

    library = CaseLibrary.create(broken, identity, ODD)
    append_shards(library, shards[:1])
    committed = (broken / "manifest.json").read_bytes()
    append_shards(library, [[10, 11]])
    # Killed before the commit: files of the shard in progress lie there, some half-written; the manifest is the old.
    (broken / "manifest.json").write_bytes(committed)
    (broken / ".manifest.json.part").write_bytes(b'{"format": "corn')
    (broken / ".tracks-000002.parquet.0f3c52b1.part").write_bytes(b"PAR1")
    assert CaseLibrary.open(broken).scalars(["test"]).column("test").to_pylist() == [1, 4]

    resumed = CaseLibrary.resume(broken, identity, ODD)
    assert sorted(contents(broken)) == ["cases-000000.parquet", "manifest.json", "tracks-000000.parquet"]
    assert resumed.next_test == 6
    append_shards(resumed, shards[1:])
    assert contents(broken) == contents(whole)


@pytest.mark.parametrize("nth", range(1, 4))
def test_death_in_any_write_loses_only_that_shard(
    filled: Path, identity: Identity, append_shards: Fill, monkeypatch: pytest.MonkeyPatch, nth: int
) -> None:
    class Killed(BaseException):
        pass

    calls = []
    replace_really = os.replace

    def dying(source: Path, target: Path) -> None:
        calls.append(target)
        if len(calls) == nth:
            raise Killed
        replace_really(source, target)

    expected = shutil.copytree(filled, filled.with_name("unbroken"))
    append_shards(CaseLibrary.resume(expected, identity, ODD), [[30, 31]])
    library = CaseLibrary.resume(filled, identity, ODD)
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", dying)
        with pytest.raises(Killed):
            append_shards(library, [[30, 31]])
    assert len(CaseLibrary.open(filled)) == 6
    append_shards(CaseLibrary.resume(filled, identity, ODD), [[30, 31]])
    assert contents(filled) == contents(expected)


def test_resume_starts_where_nothing_is(tmp_path: Path, identity: Identity) -> None:
    assert CaseLibrary.resume(tmp_path / "library", identity, ODD).next_test == 0


def test_a_library_of_a_road_goes_on_and_names_another_road(tmp_path: Path, identity: Identity) -> None:
    ramp, leaving = (odd_on(ODD, road_named(name)) for name in ("on-ramp", "exit"))
    CaseLibrary.create(tmp_path / "library", identity, ramp)
    assert CaseLibrary.resume(tmp_path / "library", identity, ramp).next_test == 0
    with pytest.raises(InputError, match=r"odd\.road is on-ramp there and exit here; use"):
        CaseLibrary.resume(tmp_path / "library", identity, leaving)
    assert ramp.road is not None
    slower = replace(ramp.road, lanes=tuple(replace(lane, limit=20.0) for lane in ramp.road.lanes))
    with pytest.raises(InputError, match=r"odd\.road is on-ramp there and another road of this name here; use"):
        CaseLibrary.resume(tmp_path / "library", identity, replace(ramp, road=slower))


def test_resume_leaves_the_files_of_others(filled: Path, identity: Identity) -> None:
    for name in ("notes.txt", "cases-000009.parquet.bak", "provenance.json"):
        (filled / name).write_text("mine")
    CaseLibrary.resume(filled, identity, ODD)
    assert {"notes.txt", "cases-000009.parquet.bak", "provenance.json"} <= set(contents(filled))


def test_create_refuses_a_library_of_the_same_run(filled: Path, identity: Identity) -> None:
    with pytest.raises(OutputError, match="--resume"):
        CaseLibrary.create(filled, identity, ODD)


@pytest.mark.parametrize("verb", [CaseLibrary.create, CaseLibrary.resume])
def test_the_library_of_another_run_is_refused(
    verb: Callable[..., CaseLibrary], filled: Path, identity: Identity
) -> None:
    before = contents(filled)
    with pytest.raises(InputError, match="av_hash is 'a1' there and 'b2' here"):
        verb(filled, identity | {"av_hash": "b2"}, ODD)
    with pytest.raises(InputError, match="ramp is None there and 3 here"):
        verb(filled, identity | {"ramp": 3}, ODD)
    with pytest.raises(InputError, match=r"odd\.n_lanes is 3 there and 4 here"):
        verb(filled, identity, replace(ODD, n_lanes=4))
    assert contents(filled) == before


@pytest.mark.parametrize("verb", [CaseLibrary.create, CaseLibrary.resume])
def test_a_foreign_folder_is_refused(verb: Callable[..., CaseLibrary], tmp_path: Path, identity: Identity) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(OutputError, match=r"holds something else \(thesis\.tex\)"):
        verb(tmp_path, identity, ODD)
    assert contents(tmp_path) == {"thesis.tex": b"mine"}


@pytest.mark.parametrize("verb", [CaseLibrary.create, CaseLibrary.resume])
def test_cases_without_a_manifest_are_no_leftovers(
    verb: Callable[..., CaseLibrary], filled: Path, identity: Identity
) -> None:
    """Who lost the manifest still has the cases; the first shard must not be overwritten."""
    (filled / "manifest.json").unlink()
    before = contents(filled)
    with pytest.raises(OutputError, match=r"holds cases \(cases-000000\.parquet\) but no manifest\.json, which says"):
        verb(filled, identity, ODD)
    assert contents(filled) == before


@pytest.mark.parametrize("verb", [CaseLibrary.create, CaseLibrary.resume])
def test_what_a_kill_leaves_of_the_first_manifest_is_overwritten(
    verb: Callable[..., CaseLibrary], tmp_path: Path, identity: Identity
) -> None:
    (tmp_path / ".manifest.json.0f3c52b1.part").write_text("{")
    (tmp_path / ".cornerforge.lock").write_text("")
    assert len(verb(tmp_path, identity, ODD)) == 0
    assert set(contents(tmp_path)) == {"manifest.json"}


@pytest.mark.parametrize("verb", [CaseLibrary.create, CaseLibrary.resume])
@pytest.mark.parametrize("below", [".", "library"])
def test_a_place_that_cannot_be_written_is_an_output_error(
    verb: Callable[..., CaseLibrary], tmp_path: Path, identity: Identity, below: str
) -> None:
    (tmp_path / "file").write_text("regular")
    with pytest.raises(OutputError, match="choose another place"):
        verb(tmp_path / "file" / below, identity, ODD)


@pytest.mark.parametrize(
    "identity", [{}, {"seed": "7"}, {"seed": True}, {"seed": 1, "x": [1]}, {"seed": 1, "x": float("nan")}]
)
def test_an_identity_that_is_not_flat_json_with_a_seed_is_refused(tmp_path: Path, identity: Any) -> None:
    with pytest.raises(InputError):
        CaseLibrary.create(tmp_path / "library", identity, ODD)
    assert not (tmp_path / "library").exists()


def test_open_refuses_what_is_no_library(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="holds no manifest"):
        CaseLibrary.open(tmp_path)
    (tmp_path / "manifest.json").write_text('{"name": "a web app"}')
    with pytest.raises(FileFormatError, match="not the manifest of a case library"):
        CaseLibrary.open(tmp_path)
    (tmp_path / "manifest.json").write_text('{"format": ')
    with pytest.raises(FileFormatError, match="damaged"):
        CaseLibrary.open(tmp_path)


def test_a_newer_schema_is_refused_with_advice(filled: Path, identity: Identity) -> None:
    edit_manifest(filled, schema_version=4, created_by="9.9.9")
    with pytest.raises(FileFormatError, match=r"schema 4, written by cornerforge 9\.9\.9; .* upgrade"):
        CaseLibrary.open(filled)
    with pytest.raises(FileFormatError, match="upgrade"):
        CaseLibrary.resume(filled, identity, ODD)


@pytest.mark.parametrize(
    "change",
    [{"shards": 3}, {"odd": {"n_lanes": 99}}, {"tests": "many"}, {"extra": {"a": "pickle"}}, {"run": None}],
)
def test_a_manifest_of_wrong_content_is_refused(filled: Path, change: dict[str, Any]) -> None:
    edit_manifest(filled, **change)
    with pytest.raises(FileFormatError, match="damaged"):
        CaseLibrary.open(filled)


def test_an_identity_holds_what_it_can_hold(tmp_path: Path, identity: dict[str, Any]) -> None:
    CaseLibrary.create(tmp_path, identity, ODD)
    for change, told in (({"av": "a\0"}, "a text without NUL"), ({"lanes": 99}, "at most 6")):
        edit_manifest(tmp_path, run=identity | change)
        with pytest.raises(FileFormatError, match=told):
            CaseLibrary.open(tmp_path)


def test_a_manifest_cannot_lead_out_of_its_folder(filled: Path) -> None:
    shards = json.loads((filled / "manifest.json").read_text())["shards"]
    shards[0]["cases_file"]["name"] = "../../secret.parquet"
    edit_manifest(filled, shards=shards)
    with pytest.raises(FileFormatError, match="secret"):
        CaseLibrary.open(filled)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("damage", [Path.unlink, truncate, flip_a_byte])
def test_a_damaged_shard_is_named_once_and_left_out(filled: Path, damage: Callable[[Path], None]) -> None:
    damage(filled / "cases-000001.parquet")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        library = CaseLibrary.open(filled)
        assert library.scalars(["test"]).column("test").to_pylist() == [1, 4, 20]
        assert library.history()[0] == ["7:1", "7:4", "7:20"]
        assert len(library) == 3
        assert library.query("SELECT count(*) FROM cases")[1] == [(3,)]
        assert library.scenario("7:20").scalars["test"] == 20
        with pytest.raises(FileFormatError, match="7:12 lies in a damaged shard: cases-000001"):
            library.scenario("7:12")
    assert [w.category for w in caught] == [DamagedShardWarning]
    assert "cases-000001.parquet" in str(caught[0].message)
    assert len(library.damaged) == 1


@pytest.mark.parametrize("damage", [Path.unlink, truncate, flip_a_byte])
def test_damaged_trajectories_leave_the_scalars(filled: Path, damage: Callable[[Path], None]) -> None:
    damage(filled / "tracks-000001.parquet")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DamagedShardWarning)
        library = CaseLibrary.open(filled)
        named = library.verify()
    assert [text.split()[0] for text in named] == ["tracks-000001.parquet"]
    assert len(library) == 6
    assert library.scalars().num_rows == 6
    with pytest.raises(FileFormatError, match="tracks-000001"):
        library.scenario("7:12")


def test_a_library_with_a_damaged_shard_can_grow(filled: Path, identity: Identity, append_shards: Fill) -> None:
    flip_a_byte(filled / "cases-000000.parquet")
    library = CaseLibrary.resume(filled, identity, ODD)
    append_shards(library, [[30]])
    with pytest.warns(DamagedShardWarning):
        assert CaseLibrary.open(filled).scalars(["test"]).column("test").to_pylist() == [10, 12, 13, 20, 30]


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("7:11", "7:10"),
        ("7:2", "7:1"),
        ("7:21", "7:20"),
        ("8:20", "7:20"),
        ("first", "Known: 7:1, 7:4 and 4 others; to list them"),
    ],
)
def test_an_unknown_case_is_refused_with_the_nearest(filled: Path, name: str, hint: str) -> None:
    with pytest.raises(UnknownNameError, match=f'No case "{name}".*{hint}'):
        CaseLibrary.open(filled).scenario(name)


def test_an_unknown_column_is_refused(filled: Path) -> None:
    with pytest.raises(UnknownNameError, match='Did you mean "av_speed_mps"'):
        CaseLibrary.open(filled).scalars(["av_speed"])


def test_append_refuses_what_does_not_continue(
    filled: Path, identity: Identity, make_record: Callable[[int], CaseRecord], make_scenario: Callable[..., Scenario]
) -> None:
    before = contents(filled)
    library = CaseLibrary.resume(filled, identity, ODD)

    def add(cases: list[CaseRecord], **progress: int) -> None:
        append(library, cases, **{"next_test": 50, "tests": 50, "crashes": 9} | progress)

    for tests in ([20], [31, 30], [50]):
        with pytest.raises(InputError, match="do not continue the library"):
            add([make_record(test) for test in tests])
    with pytest.raises(InputError, match="next_test = 3"):
        add([], next_test=3)
    with pytest.raises(InputError, match="tests = 3"):
        add([], tests=3)
    other = replace(make_scenario(30), seed=8)
    with pytest.raises(InputError, match=r"of seeds \[8\] do not continue"):
        add([case_record(other, trajectory_digest="", extra={"log_prob_policy": 0.0})])
    with pytest.raises(InputError, match="extra columns"):
        add([case_record(make_scenario(30), trajectory_digest="")])
    with pytest.raises(InputError, match="extra columns"):
        add([case_record(make_scenario(30), trajectory_digest="", extra={"log_prob_policy": "low"})])
    assert contents(filled) == before


def test_two_writers_are_noticed(filled: Path, identity: Identity, append_shards: Fill) -> None:
    one, two = (CaseLibrary.resume(filled, identity, ODD) for _ in range(2))
    append_shards(one, [[30]])
    with pytest.raises(OutputError, match="Another process"):
        append_shards(two, [[31]])
    append_shards(one, [[40]])
    assert CaseLibrary.open(filled).scalars(["test"]).column("test").to_pylist()[-2:] == [30, 40]


def test_an_opened_library_is_for_reading(filled: Path) -> None:
    with pytest.raises(OutputError, match="open for reading"):
        CaseLibrary.open(filled).append_shard(None, next_test=50, tests=50, crashes=6)


def test_a_reader_sees_the_library_as_it_was_opened(filled: Path, identity: Identity, append_shards: Fill) -> None:
    reader = CaseLibrary.open(filled)
    append_shards(CaseLibrary.resume(filled, identity, ODD), [[30]])
    assert reader.scalars(["test"]).num_rows == 6


def test_a_case_is_found_in_every_row_group(
    tmp_path: Path, identity: Identity, make_scenario: Callable[..., Scenario]
) -> None:
    records = [
        case_record(make_scenario(t, n_frames=11, n_vehicles=4), trajectory_digest=str(t)) for t in range(0, 500, 2)
    ]
    library = CaseLibrary.create(tmp_path / "library", identity, ODD)
    append(library, records, next_test=500, tests=500, crashes=250)
    assert pq.ParquetFile(tmp_path / "library" / "tracks-000000.parquet").num_row_groups == 3
    for test in (0, 198, 200, 398, 400, 498):
        stored = library.scenario(f"7:{test}")
        assert stored.scalars["trajectory_digest"] == str(test)
        np.testing.assert_array_equal(
            stored.scenario.speed[:, 0], np.float32(make_scenario(test, n_frames=11, n_vehicles=4).speed[:, 0])
        )


def test_resume_says_when_it_cannot_tidy(filled: Path, identity: Identity) -> None:
    (filled / "cases-000777.parquet").mkdir()  # cannot be unlinked, by root neither
    with pytest.raises(OutputError, match="Cannot tidy"):
        CaseLibrary.resume(filled, identity, ODD)


def in_steps(library: CaseLibrary, steps: Sequence[Sequence[int]], make_record: Callable[[int], CaseRecord]) -> None:
    """Save cases of these tests, four to a shard, a commit for each step."""
    crashes = library.crashes
    for tests in steps:
        crashes += len(tests)
        done = tests[-1] + 2
        append(library, [make_record(t) for t in tests], next_test=done, tests=done, crashes=crashes, shard_cases=4)


STEPS: list[list[list[int]]] = [
    [[1], [4, 10], [12, 14, 16, 18, 20], [24]],
    [[1, 4, 10, 12], [14], [16], [18], [20, 24]],
    [[1, 4], [10, 12], [14, 16, 18, 20, 24]],
]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("steps", STEPS)
def test_files_do_not_depend_on_when_cases_are_saved(
    tmp_path: Path, identity: Identity, make_record: Callable[[int], CaseRecord], steps: list[list[int]]
) -> None:
    whole, cut, resumed = (tmp_path / name for name in ("whole", "cut", "resumed"))
    library = CaseLibrary.create(whole, identity, ODD)
    everything = [test for step in steps for test in step]
    in_steps(library, [everything], make_record)
    library.finish()
    assert [shard.cases for shard in read_manifest(whole)[0].shards] == [4, 4, 1]
    names = [f"{kind}-00000{n}.parquet" for kind in ("cases", "tracks") for n in range(3)]
    assert sorted(contents(whole)) == sorted(["manifest.json", *names])

    library = CaseLibrary.create(cut, identity, ODD)
    in_steps(library, steps, make_record)
    assert library.scalars(["test"]).column("test").to_pylist() == everything
    library.finish()
    assert contents(cut) == contents(whole)

    for n in range(len(steps)):  # a new process for each step, and one that thought itself finished on the way
        library = CaseLibrary.resume(resumed, identity, ODD)
        in_steps(library, steps[n : n + 1], make_record)
        if n == 1:
            library.finish()
        assert library.scenario(f"7:{steps[n][-1]}").scalars["test"] == steps[n][-1]
    library.finish()
    assert contents(resumed) == contents(whole)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("nth", range(1, 7))
def test_death_while_a_shard_grows_loses_only_what_was_new(
    tmp_path: Path,
    identity: Identity,
    make_record: Callable[[int], CaseRecord],
    monkeypatch: pytest.MonkeyPatch,
    nth: int,
) -> None:
    """Two writes and a commit for the step, three more to settle the names."""

    class Killed(BaseException):
        pass

    calls = []
    replace_really = os.replace

    def dying(source: Path, target: Path) -> None:
        calls.append(target)
        if len(calls) == nth:
            raise Killed
        replace_really(source, target)

    whole, broken = tmp_path / "whole", tmp_path / "broken"
    for folder in (whole, broken):
        in_steps(CaseLibrary.create(folder, identity, ODD), [[1, 4]], make_record)
    library = CaseLibrary.resume(whole, identity, ODD)
    in_steps(library, [[10]], make_record)
    library.finish()
    library = CaseLibrary.resume(broken, identity, ODD)
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", dying)
        with pytest.raises(Killed):  # noqa: PT012  (it dies in one of the two)
            in_steps(library, [[10]], make_record)
            library.finish()
    left = CaseLibrary.open(broken)
    assert left.verify() == []
    assert left.scalars(["test"]).column("test").to_pylist() == ([1, 4] if nth <= 3 else [1, 4, 10])
    library = CaseLibrary.resume(broken, identity, ODD)
    if library.next_test < 12:
        in_steps(library, [[10]], make_record)
    library.finish()
    assert contents(broken) == contents(whole)


def test_a_damaged_last_shard_is_left_as_it_is(
    tmp_path: Path, identity: Identity, make_record: Callable[[int], CaseRecord]
) -> None:
    in_steps(CaseLibrary.create(tmp_path, identity, ODD), [[1, 4]], make_record)
    flip_a_byte(tmp_path / "cases-000000.parquet")
    damaged = (tmp_path / "cases-000000.parquet").read_bytes()
    library = CaseLibrary.resume(tmp_path, identity, ODD)
    with pytest.warns(DamagedShardWarning, match="has been changed"):
        assert library.open_cases(4) == 0
    in_steps(library, [[10]], make_record)
    library.finish()
    assert library.scalars(["test"]).column("test").to_pylist() == [10]
    assert (tmp_path / "cases-000000.parquet").read_bytes() == damaged


def test_cases_that_do_not_follow_are_refused_before_anything_is_written(
    tmp_path: Path, identity: Identity, make_record: Callable[[int], CaseRecord]
) -> None:
    library = CaseLibrary.create(tmp_path, identity, ODD)
    in_steps(library, [[1, 4]], make_record)
    before = contents(tmp_path)
    for cases in ([make_record(4)], [make_record(12), make_record(10)]):
        with pytest.raises(InputError, match=r"continue the library|out of order"):
            append(library, cases, next_test=20, tests=20, crashes=9, shard_cases=4)
    assert contents(tmp_path) == before


@pytest.mark.full
def test_many_threads_read_one_library(
    tmp_path: Path, identity: dict[str, Any], make_record: Callable[[int], CaseRecord]
) -> None:
    """With one reader for all of them Arrow lost what it had buffered, or the process ended."""
    records = [make_record(test) for test in range(200)]
    library = CaseLibrary.create(tmp_path / "library", identity, ODD)
    append(library, records, next_test=200, tests=200, crashes=200, shard_cases=200)
    ids = [record.case_id for record in records]
    reader = CaseLibrary.open(tmp_path / "library")
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(reader.scenario, ids * 4))
    assert [one.scalars["case_id"] for one in found] == ids * 4
