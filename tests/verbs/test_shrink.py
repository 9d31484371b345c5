"""`shrink`: what is left of a case is the same crash, nothing more can go, and it is a case like any other."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reference.records import append, case_record

import cornerforge
from cornerforge.analysis.crash_types import STRIKERS, classify_crashes
from cornerforge.analysis.shrink import AV, BVS, NOBODY, Reproducer
from cornerforge.analysis.shrink import shrink as shrink_script
from cornerforge.cli import main
from cornerforge.drivers.avs import av_named, numbers_of_av
from cornerforge.drivers.mobil import MobilParams
from cornerforge.errors import CornerForgeError, InputError, OutputError, ReplayError, UnknownNameError
from cornerforge.experiment.setting import experiment
from cornerforge.library import CaseLibrary
from cornerforge.library.filling import MODEL_FILE
from cornerforge.results import ShrunkLibrary
from cornerforge.sim.recorder import scenario_digest
from cornerforge.sim.scripted import NATURAL, START_FIELDS, Script, ScriptDriver, scripted_start
from cornerforge.verbs.cases import experiment_of

pytestmark = pytest.mark.full

SIZES = ("vehicles", "decisions", "seconds", "deviating_actions")


@pytest.fixture(scope="module")
def shrunk(swerve_library: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ShrunkLibrary]:
    """All cases of the library shrunk, and what `shrink` said; read only."""
    out = tmp_path_factory.mktemp("shrunk") / "library"
    return out, cornerforge.shrink(swerve_library, "all", out=out)


def whole_script(library: Path, case_id: str) -> tuple[ScriptDriver, Script]:
    """A case of a library of tests as a script."""
    run = experiment_of(CaseLibrary.open(library))
    driver = ScriptDriver(run.setting, run.odd)
    seed, test = map(int, case_id.split(":"))
    scenario = run.recorder().record(seed, test)
    return driver, Script(scenario.slot, driver.start_of_test(seed, test), scenario.action)


def ids_of(library: Path) -> list[str]:
    return list(CaseLibrary.open(library).scalars(["case_id"])["case_id"].to_pylist())


def test_every_case_becomes_the_same_crash_and_no_larger(swerve_library: Path, shrunk: tuple[Path, Any]) -> None:
    out, said = shrunk
    whole, small = CaseLibrary.open(swerve_library), CaseLibrary.open(out)
    ids, history = whole.history()
    small_ids, small_history = small.history()
    assert small_ids == ids == [row.case for row in said.cases]
    before, after = classify_crashes(history[:, 0]), classify_crashes(small_history[:, 0])
    np.testing.assert_array_equal(after.code, before.code)
    np.testing.assert_array_equal(after.striker, before.striker)
    assert whole.scalars(["bv_slot"]) == small.scalars(["bv_slot"])
    for row, kind, striker in zip(said.cases, after.names, after.striker, strict=True):
        assert (row.crash_type, row.striker) == (kind, STRIKERS[striker])
        assert all(getattr(row.after, name) <= getattr(row.before, name) for name in SIZES)
        assert row.cause == NOBODY or row.after.deviating_actions > 0 or row.cause == AV
    stored = whole.scalars(["n_vehicles", "n_decisions", "crash_time_s"]).to_pydict()
    for name, column in (("vehicles", "n_vehicles"), ("decisions", "n_decisions"), ("seconds", "crash_time_s")):
        assert [getattr(row.before, name) for row in said.cases] == stored[column]
    half = {name: getattr(said.median.before, name) / 2 for name in SIZES}
    assert all(getattr(said.median.after, name) <= half[name] for name in SIZES), "it would hardly be worth the name"


def smaller_scripts(driver: ScriptDriver, script: Script) -> Iterator[tuple[str, Script]]:
    """All scripts that lack one more vehicle, second or deviating action, or have a likelier action instead of one.

    Made by hand, without the search: only what deviates is named, all else follows from it naturally.
    """
    _, chances = driver.record(script)
    deviating = script.action >= 0
    deviating[:, 0] = False
    deviating &= script.action != np.nan_to_num(chances).argmax(axis=2)
    free = replace(script, action=np.where(deviating, script.action, NATURAL).astype(np.int8))
    assert scenario_digest(driver.record(free)[0]) == scenario_digest(driver.record(script)[0])
    for column in range(1, script.slot.size):
        yield f"without vehicle {script.slot[column]}", free.of(np.arange(script.slot.size) != column)
        yield (
            f"without vehicle {script.slot[column]}, others as before",
            script.of(np.arange(script.slot.size) != column),
        )
    for decisions in range(1, len(script.action)):
        later = driver.later(free, decisions)
        assert later is not None
        yield f"{decisions} s later", later
    for k, i in np.argwhere(deviating):
        for action in (NATURAL, *np.flatnonzero(chances[k, i] > chances[k, i, script.action[k, i]])):
            changed = free.action.copy()
            changed[k, i] = action
            yield f"decision {k} of vehicle {script.slot[i]}: {action}", replace(free, action=changed)


def test_no_vehicle_second_or_deviating_action_can_go(swerve_library: Path, shrunk: tuple[Path, Any]) -> None:
    out, said = shrunk
    small = CaseLibrary.open(out)
    tried = 0
    for row in said.cases:
        driver, whole = whole_script(swerve_library, row.case)
        case = Reproducer(driver, whole)
        script = small.scenario(row.case).script
        assert script is not None
        assert case.cause == row.cause
        assert case.shows(script)
        for what, smaller in smaller_scripts(driver, script):
            if case.cause == NOBODY and "later" in what:
                continue
            gone = smaller.slot.tolist().count(case.kind[0]) == 0
            assert gone or not case.shows(smaller), f"case {row.case} can go {what}"
            tried += 1
    assert tried > 3 * len(said.cases)


def test_what_is_small_stays_as_it_is(shrunk: tuple[Path, Any], tmp_path: Path) -> None:
    """Shrinking shrunk cases gives the same cases, bit for bit."""
    out, said = shrunk
    again = cornerforge.shrink(out, "all", out=tmp_path / "again")
    columns = ["case_id", "trajectory_digest"]
    assert CaseLibrary.open(tmp_path / "again").scalars(columns) == CaseLibrary.open(out).scalars(columns)
    assert [row.after for row in again.cases] == [row.after for row in said.cases]
    assert [row.before for row in again.cases] == [row.after for row in said.cases]


def test_shrunk_cases_are_cases_like_any_other(shrunk: tuple[Path, Any]) -> None:
    out, said = shrunk
    replayed = cornerforge.replay(out, "all", check=True)
    assert replayed.identical is True
    assert replayed.cases == len(said.cases)
    one = said.cases[0]
    assert cornerforge.replay(out, one.case).crash_time_s == one.after.seconds
    assert cornerforge.analyse(out).cases == len(said.cases)
    rows = cornerforge.query(out, "select count(*), max(n_vehicles - source_n_vehicles) < 1 from cases").rows
    assert rows == ((len(said.cases), True),)


def test_a_replay_of_another_script_is_noticed(shrunk: tuple[Path, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Negative control of the check above: the same start, another AV."""
    out, _ = shrunk
    monkeypatch.setattr("cornerforge.verbs.cases.experiment_of", lambda *_: experiment(av="idm-mobil-d2rl"))
    assert cornerforge.replay(out, "all", check=True).identical is False


# --- whose driving makes the crash ---


def road(av: dict[str, float], *vehicles: tuple[float, float]) -> tuple[ScriptDriver, Script]:
    """An AV that never changes lanes, in the middle lane, and BVs (x, speed) in it too; all hold their speed."""
    run = experiment()
    model = av_named("idm-mobil")
    model = replace(model, idm=replace(model.idm, **av), mobil=MobilParams(min_gain=10.0))
    driver = ScriptDriver(run.setting._replace(av=numbers_of_av(model)), run.odd)
    fields = np.zeros((len(vehicles), len(START_FIELDS)))
    for row, (x, speed) in zip(fields, vehicles, strict=True):
        values = {"x": x, "y": 5.49, "speed": speed, "target_lane": 1, "lanes": 2, "length": 5.0, "width": 2.0}
        values |= {"quantile": 0.5, "habit": 0.5, "desired_speed": speed}  # everybody wants the speed that it has
        row[:] = [values.get(name, 0.0) for name in START_FIELDS]
    slots = np.arange(len(vehicles), dtype=np.int16)
    return driver, Script(slots, scripted_start(fields), np.full((9, len(vehicles)), 22, dtype=np.int8))


def test_a_crash_that_nobody_could_help_keeps_its_window() -> None:
    driver, script = road({}, (240.0, 38.0), (275.0, 0.0), (900.0, 30.0))
    small = shrink_script(driver, script)
    assert (small.cause, small.crash_type, small.striker) == (NOBODY, "rear-end by AV", "av")
    assert (small.after.vehicles, small.after.deviating_actions) == (2, 0)
    assert small.after.decisions == small.before.decisions


def test_a_crash_that_a_natural_driver_avoids_is_the_avs() -> None:
    """An AV that cannot brake runs into a slower lead; the window begins where a natural driver still helps it."""
    driver, script = road({"max_braking": 0.3}, (240.0, 30.0), (300.0, 22.0), (900.0, 30.0))
    long = replace(script, action=np.full((20, 3), 22, dtype=np.int8))
    small = shrink_script(driver, long)
    assert (small.cause, small.crash_type) == (AV, "rear-end by AV")
    assert small.after.vehicles == 2
    assert small.after.decisions < small.before.decisions
    case = Reproducer(driver, long)
    for decisions in range(1, len(small.script.action)):
        later = driver.later(small.script, decisions)
        assert later is not None
        assert case.is_lost(later)


def test_a_bv_that_brakes_for_nothing_is_the_cause() -> None:
    driver, script = road({"max_braking": 2.0, "time_gap": 0.5}, (240.0, 30.0), (260.0, 30.0), (200.0, 30.0))
    action = script.action.copy()
    action[2:, 1] = 2
    small = shrink_script(driver, replace(script, action=action))
    assert (small.cause, small.crash_type, small.after.vehicles) == (BVS, "rear-end by AV", 2)
    assert 0 < small.after.deviating_actions <= 7
    assert (small.script.action[:, 1] >= 2).all()


def test_only_crashes_of_the_av_can_be_shrunk() -> None:
    driver, script = road({}, (240.0, 30.0), (340.0, 30.0))
    with pytest.raises(InputError, match="does not end in a crash of the AV"):
        shrink_script(driver, script)


# --- the library ---


def test_libraries_of_tests_stay_readable_by_older_versions(swerve_library: Path, shrunk: tuple[Path, Any]) -> None:
    versions = [
        json.loads((path / "manifest.json").read_text(encoding="utf-8"))["schema_version"]
        for path in (swerve_library, shrunk[0])
    ]
    assert versions == [1, 2]
    assert CaseLibrary.open(swerve_library).scenario(ids_of(swerve_library)[0]).script is None


def test_scripted_cases_and_tests_are_kept_apart(shrunk: tuple[Path, Any], tmp_path: Path) -> None:
    source = CaseLibrary.open(shrunk[0])
    stored = source.scenario(ids_of(shrunk[0])[0])
    assert stored.script is not None
    plain = CaseLibrary.create(tmp_path / "plain", {"seed": stored.scenario.seed}, source.odd)
    scripted = CaseLibrary.create(tmp_path / "new", {"seed": stored.scenario.seed, "scripted": True}, source.odd)
    digest = stored.scalars["trajectory_digest"]
    test = stored.scenario.test
    for library, start in ((plain, stored.script.start), (scripted, None)):
        record = case_record(stored.scenario, trajectory_digest=digest, start=start)
        with pytest.raises(InputError, match="keep the two apart"):
            append(library, [record], next_test=test + 1, tests=1, crashes=1)
    append(scripted,
        [case_record(stored.scenario, trajectory_digest=digest, start=stored.script.start)],
        next_test=test + 1, tests=1, crashes=1,
    )  # fmt: skip
    back = CaseLibrary.open(tmp_path / "new").scenario(ids_of(shrunk[0])[0]).script
    assert back is not None
    assert back.start.tobytes() == stored.script.start.tobytes()


def test_an_interrupt_keeps_what_is_done_and_a_resume_goes_on(
    swerve_library: Path, shrunk: tuple[Path, Any], tmp_path: Path
) -> None:
    ids = ids_of(swerve_library)[:8]

    def stop(stage: str, done: float, total: float) -> None:
        assert (stage, total) == ("shrink", 8)
        if done == 3:
            raise KeyboardInterrupt

    out = tmp_path / "library"
    with pytest.raises(KeyboardInterrupt):
        cornerforge.shrink(swerve_library, ids, out=out, progress=stop)
    assert ids_of(out) == ids[:3]
    with pytest.raises(OutputError, match="--resume"):
        cornerforge.shrink(swerve_library, ids, out=out)
    said = cornerforge.shrink(swerve_library, ids[::-1], out=out, resume=True)
    assert [row.case for row in said.cases] == ids
    assert said.cases == shrunk[1].cases[:8]
    columns = ["case_id", "trajectory_digest"]
    assert CaseLibrary.open(out).scalars(columns) == CaseLibrary.open(shrunk[0]).scalars(columns).slice(0, 8)


def test_a_case_that_comes_too_early_asks_for_another_place(swerve_library: Path, tmp_path: Path) -> None:
    ids = ids_of(swerve_library)
    cornerforge.shrink(swerve_library, ids[5], out=tmp_path / "library")
    with pytest.raises(InputError, match=rf"Case {ids[2]} comes before .* --out"):
        cornerforge.shrink(swerve_library, ids[2], out=tmp_path / "library", resume=True)


def test_bad_wishes_are_named_before_anything_is_written(swerve_library: Path, tmp_path: Path) -> None:
    ids = ids_of(swerve_library)
    for wish, error, message in (
        ([], InputError, "no case to shrink"),
        ([ids[0], "5:99999999"], UnknownNameError, "No case .* Known"),
        (["nonsense"], UnknownNameError, "No case"),
    ):
        with pytest.raises(error, match=message):
            cornerforge.shrink(swerve_library, wish, out=tmp_path / "library")
    with pytest.raises(InputError, match="--out FOLDER"):
        cornerforge.shrink(swerve_library, "all")
    assert not (tmp_path / "library").exists()


def copied(library: Path, to: Path) -> Path:
    to.mkdir(parents=True)
    for file in library.iterdir():
        (to / file.name).write_bytes(file.read_bytes())
    return to


def test_a_damaged_case_is_named_before_anything_is_written(swerve_library: Path, tmp_path: Path) -> None:
    library = copied(swerve_library, tmp_path / "library")
    tracks = library / "tracks-000000.parquet"
    tracks.write_bytes(tracks.read_bytes()[:-100])
    with pytest.warns(UserWarning, match="left out"), pytest.raises(CornerForgeError, match="damaged shard"):
        cornerforge.shrink(library, ids_of(swerve_library)[0], out=tmp_path / "shrunk")
    assert not (tmp_path / "shrunk").exists()


def test_a_case_that_drives_otherwise_is_named_before_anything_is_written(swerve_library: Path, tmp_path: Path) -> None:
    source = CaseLibrary.open(swerve_library)
    (tmp_path / "library").mkdir()
    library = CaseLibrary.create(tmp_path / "library", source.identity, source.odd)
    (tmp_path / "library" / MODEL_FILE).write_bytes((swerve_library / MODEL_FILE).read_bytes())
    test = int(ids_of(swerve_library)[0].partition(":")[2])
    scenario = experiment_of(source).recorder().record(int(str(source.identity["seed"])), test)
    append(library, [case_record(scenario, trajectory_digest="0" * 64)], next_test=test + 1, tests=test + 1, crashes=1)
    with pytest.raises(ReplayError, match="is not what is stored"):
        cornerforge.shrink(tmp_path / "library", "all", out=tmp_path / "shrunk")
    assert not (tmp_path / "shrunk").exists()


def test_the_command_line(swerve_library: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    library = copied(swerve_library, tmp_path / "library")
    first, second = ids_of(library)[:2]
    assert main(["shrink", str(library), first, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    place = tmp_path / f"library-shrunk-{first.replace(':', '-')}"
    assert said["library"] == str(place)
    assert {"library", "seconds", "cases", "median"} <= set(said)
    assert set(said["cases"][0]["after"]) == {*SIZES, "log_prob_nde"}
    assert json.loads((place / "provenance.json").read_text(encoding="utf-8"))["identity"]["scripted"] is True
    assert main(["replay", str(place), first, "--check"]) == 0
    capsys.readouterr()
    assert main(["shrink", str(library), first]) == 2
    assert "--resume" in capsys.readouterr().err
    assert main(["shrink", str(library), second, first, "--out", str(tmp_path / "both")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(",")[0] for line in lines[:2]] == [f"Case {first}", f"Case {second}"]
    assert lines[2].startswith("Median of 2 cases: ")
    assert lines[0].split(": ")[-1].count(" -> ") == 3
