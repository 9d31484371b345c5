"""Case files of real crashes crash again to the bit; moving cases become libraries that all commands take."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from avs_by_hand import AVS

import cornerforge
from cornerforge import cli
from cornerforge.drivers.rails import ACCELERATION, LANE, POSE_NUMBERS, SPEED, X, Y
from cornerforge.errors import FileFormatError, InputError, OutputError
from cornerforge.ext.explorer.columns import case_table
from cornerforge.ext.explorer.sources import Source
from cornerforge.ext.interchange.library_case_files import CaseFilesOf
from cornerforge.ext.interchange.moving_cases import CRASH, NO_CRASH, UNKNOWN, library_of
from cornerforge.library import CaseLibrary
from cornerforge.library.case_file import CaseFile, Happened, of_moving
from cornerforge.library.out_case import MovingCase, straight_road
from cornerforge.verbs.drive_case import CaseDriver, drive_case
from cornerforge.verbs.sentences.retest import retest_text
from cornerforge.world_options import WorldOptions

pytestmark = pytest.mark.full


def braking_leader(name: str = "braking", gap: float = 16.3, av: float = 4.6, lanes: int = 3) -> MovingCase:
    """The leader, a truck, brakes at 6 m/s2 to a stand; who was in the AV's seat kept 25 m/s."""
    frames, lane = 58, min(1, lanes - 1)
    time = 0.1 * np.arange(frames)
    stop = np.minimum(time, 25.0 / 6.0)
    poses = np.zeros((frames, 2, POSE_NUMBERS))
    poses[:, :, Y], poses[:, :, LANE] = (lane + 0.5) * 3.5, lane
    poses[:, 0, X], poses[:, 0, SPEED] = 25.0 * time, 25.0
    poses[:, 1, X] = gap + 0.5 * (av + 12.0) + 25.0 * stop - 3.0 * stop**2
    poses[:, 1, SPEED], poses[:, 1, ACCELERATION] = 25.0 - 6.0 * stop, np.where(time < 25.0 / 6.0, -6.0, 0.0)
    odd = straight_road(lanes=lanes, lane_width=3.5, vehicles=2, seconds=0.1 * frames, fastest=25.0, av_size=(av, 1.8))
    size = np.array([av, 12.0]), np.array([1.8, 2.5])
    return MovingCase(name, odd, np.array([0, 1], np.int8), *size, poses, {"source": "made up"})


def contact_of(case: CaseFile) -> tuple[int | None, int | None, bytes]:
    assert case.happened is not None
    return case.happened.frame, case.happened.partner, case.happened.pose.tobytes()  # type: ignore[union-attr]


@pytest.fixture(scope="module")
def files(swerve_library: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first 12 cases of a library as case files."""
    place = tmp_path_factory.mktemp("files")
    cases = CaseLibrary.open(swerve_library)
    made = CaseFilesOf(cases)
    for case_id in cases.scalars(["case_id"])["case_id"].to_pylist()[:12]:
        case = made.of(case_id)
        cornerforge.write_case_file(case, place / f"{case.name}.json")
    return place


def test_a_file_of_a_real_crash_crashes_again_to_the_bit(files: Path, swerve_library: Path) -> None:
    library = CaseLibrary.open(swerve_library)
    with CaseDriver(WorldOptions(av="idm-mobil")) as driver:
        for path in sorted(files.iterdir()):
            case = cornerforge.read_case_file(path)
            ending = driver.drive(case)
            assert ending.pose is not None
            assert (ending.frame, ending.partner, ending.pose.tobytes()) == contact_of(case)
            stored = library.scenario(case.name.replace("-", ":"))
            assert round(10 * stored.scalars["crash_time_s"]) == ending.frame
            assert stored.scalars["bv_slot"] == ending.partner
            recorded = case.recorded
            assert recorded is not None
            np.testing.assert_array_equal(recorded[:, X], stored.scenario.x[:, 0])


def test_a_case_on_rails_crashes_again_to_the_bit(tmp_path: Path) -> None:
    moving = [braking_leader(f"b{k}", gap=12.0 + k) for k in range(3)]
    library = CaseLibrary.open(library_of(moving, tmp_path / "library").libraries[0])
    case = CaseFilesOf(library).of("0:1", name="again")
    assert case.av == "recorded"
    driven = drive_case(case, av="recorded")
    assert driven.crashed
    assert driven.happened.pose is not None
    assert (driven.happened.frame, driven.happened.partner, driven.happened.pose.tobytes()) == contact_of(case)
    assert not drive_case(case, av="idm-mobil").crashed


def test_what_happened_is_told_in_words() -> None:
    case = of_moving(braking_leader())
    # 16.3 m = 3 t^2: 2.331 s, seen in frame 24; the truck drives 25 - 6 * 2.4 = 10.6 m/s.
    told = drive_case(case, av="recorded").words
    assert told.startswith("crash after 2.4 s: the AV, at 25.0 m/s, strikes the truck in slot 1, at 10.6 m/s")
    assert "brakes with -6.0 m/s2" in told
    assert drive_case(case, av="idm-mobil").words.startswith("no crash of the AV in ")


def test_a_case_says_what_it_cannot(files: Path, tmp_path: Path) -> None:
    case = cornerforge.read_case_file(min(files.iterdir()))
    with pytest.raises(InputError, match="does not say what the AV did"):
        drive_case(case, av="recorded")
    with pytest.raises(InputError, match=r"naturalistic model 0123456789abcdef.*model\.npz"):
        drive_case(replace(case, model="0123456789abcdef"))
    with pytest.raises(FileFormatError, match="No such file"):
        drive_case(tmp_path / "none.json")


def test_the_model_may_lie_beside_the_file(reckless_model: Path, tmp_path: Path) -> None:
    cornerforge.generate(policy="swerve", cases=2, model=reckless_model, out=tmp_path / "library")
    cases = CaseLibrary.open(tmp_path / "library")
    case = CaseFilesOf(cases).of(cases.scalars(["case_id"])["case_id"][0].as_py())
    path = cornerforge.write_case_file(case, tmp_path / "case.json")
    with pytest.raises(InputError, match="naturalistic model"):
        drive_case(path)
    (tmp_path / "model.npz").write_bytes(reckless_model.read_bytes())
    driven = drive_case(path)
    assert driven.happened.frame == contact_of(case)[0]


def test_what_was_not_recorded_is_no_crash(tmp_path: Path) -> None:
    """The recording ends 0.3 s before the AV would touch the truck that stands before it, had it gone on."""
    moving = braking_leader(gap=90.0)
    touch = next(f for f in range(58) if 90.0 + moving.poses[f, 1, X] - moving.poses[0, 1, X] - 25.0 * 0.1 * f <= 0.0)
    for frames, outcome in ((touch - 3, NO_CRASH), (touch, NO_CRASH), (touch + 1, CRASH)):
        short = replace(moving, poses=moving.poses[:frames])
        made = library_of([short], tmp_path / f"{frames}")
        assert made.cases[0].outcome == outcome, frames
        assert drive_case(of_moving(short), av="recorded").crashed == (outcome == CRASH)
        with CaseDriver(WorldOptions(av="recorded")) as driver:
            assert (driver.drive(of_moving(short)).pose is not None) == (outcome == CRASH)
    assert cornerforge.replay(tmp_path / f"{touch + 1}", "all", check=True).identical


def test_a_suite_says_whose_case_it_is(swerve_library: Path, tmp_path: Path) -> None:
    cornerforge.generate(policy="swerve", cases=20, out=tmp_path / "other", av="idm-mobil-d2rl", seed=6)
    cornerforge.suite_build([swerve_library, tmp_path / "other"], out=tmp_path / "suite", size=4)
    suite = CaseLibrary.open(tmp_path / "suite")
    rows = suite.scalars(["case_id", "source_av"]).to_pylist()
    made = CaseFilesOf(suite)
    for row in rows:
        case = made.of(row["case_id"])
        assert (case.av, case.av_hash) == (row["source_av"], None)
        assert drive_case(case, av=row["source_av"]).happened.frame == contact_of(case)[0]


# Moving cases


def test_moving_cases_become_a_library(tmp_path: Path) -> None:
    unknown = braking_leader("unknown")
    unknown.poses[1:, 0] = np.nan
    moving = [braking_leader("near"), unknown, braking_leader("far", gap=110.0), braking_leader("long", av=5.4)]
    made = library_of(moving, tmp_path / "library")
    assert [one.outcome for one in made.cases] == [CRASH, UNKNOWN, NO_CRASH, CRASH]
    assert made.crashes == 2
    assert made.libraries == (tmp_path / "library",)
    assert [one.case_id for one in made.cases] == ["0:0", None, None, "0:3"]
    library = CaseLibrary.open(tmp_path / "library")
    assert (library.tests, library.crashes, len(library), library.finished) == (4, 2, 2, True)
    rows = library.scalars(["name", "origin", "crash_time_s"]).to_pylist()
    assert [(row["name"], row["origin"]) for row in rows] == [("near", "made up"), ("long", "made up")]
    np.testing.assert_array_equal(library.sizes()[0], [[4.6, 12.0], [5.4, 12.0]])
    assert library.odd.vehicle_length == 5.4
    stored = library.scenario("0:3")
    assert stored.script is not None
    assert stored.script.poses is not None
    np.testing.assert_array_equal(stored.script.poses[:58], moving[3].poses)


def test_all_commands_take_it(tmp_path: Path) -> None:
    place = library_of([braking_leader(f"b{k}", gap=10.0 + k) for k in range(4)], tmp_path / "library").libraries[0]
    again = cornerforge.replay(place, "all", check=True)
    assert again.identical
    assert again.cases == 4
    said = cornerforge.retest(place, av="idm-mobil", baseline="recorded")
    assert (said.fixed, said.still_crashing, said.natural) == (4, 0, None)
    assert said.baseline == "recorded"
    with pytest.raises(InputError, match="no natural tests of it"):
        cornerforge.retest(place, av="idm-mobil", baseline="recorded", natural_tests=10)
    told = cornerforge.analyse(place, steps=1, out=tmp_path / "analysis", avoidability="all")
    assert told.crash_types["rear-end by AV"] == 4
    page = cornerforge.make_report(place, out=tmp_path / "report", avoidability="none").report
    assert "recorded" in Path(page).read_text(encoding="utf-8")
    suite = cornerforge.suite_build(place, out=tmp_path / "suite", zoo=["recorded", "idm-mobil"], size=2)
    assert suite.cases > 0
    assert CaseLibrary.open(tmp_path / "suite").on_rails
    assert cornerforge.replay(tmp_path / "suite", "all", check=True).identical
    # the explorer's own column `source` says from which library a case is, whatever own column the library has
    source = Source("scripted", "Scripted cases", CaseLibrary.open(tmp_path / "suite"), False, None, "")
    assert set(case_table([(source, None)]).table["source"].to_pylist()) == {"scripted"}


def test_each_road_has_a_library_of_its_own(tmp_path: Path) -> None:
    moving = [braking_leader("a"), braking_leader("b", lanes=2), braking_leader("c")]
    made = library_of(moving, tmp_path / "out")
    assert made.libraries == (tmp_path / "out" / "road-1", tmp_path / "out" / "road-2")
    assert [one.case_id for one in made.cases] == ["0:0", "0:1", "0:2"]
    assert [one.library for one in made.cases] == [made.libraries[0], made.libraries[1], made.libraries[0]]
    for place, cases in zip(made.libraries, (2, 1), strict=True):
        assert cornerforge.replay(place, "all", check=True).cases == cases


def test_nothing_is_written_where_nothing_crashes_or_something_is(tmp_path: Path) -> None:
    made = library_of([braking_leader(gap=110.0)], tmp_path / "out")
    assert (made.libraries, made.crashes) == ((), 0)
    assert not (tmp_path / "out").exists()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError):
        library_of([braking_leader()], tmp_path / "full")
    with pytest.raises(InputError, match="no case to drive"):
        library_of([], tmp_path / "none")
    beside = braking_leader()
    beside.poses[3, 1, LANE] = 3
    with pytest.raises(InputError, match="vehicle 1 is in lane 3 in frame 3; the road has lanes 0 to 2"):
        library_of([beside], tmp_path / "none")


# retest on case files


def test_retest_takes_case_files(files: Path, tmp_path: Path) -> None:
    said = cornerforge.retest(files, av="idm-mobil-d2rl", page=tmp_path / "page.html")
    assert said.cases == 12
    assert said.baseline == "idm-mobil"
    assert (said.new_crashes, said.got_worse, said.reacting) == (0, False, None)
    assert said.fixed + said.still_crashing == 12
    with CaseDriver(WorldOptions(av="idm-mobil-d2rl")) as driver:
        for one in said.each:
            crashed = driver.drive(cornerforge.read_case_file(files / f"{one.case}.json")).pose is not None
            assert one.recorded == ("still crashing" if crashed else "fixed")
    assert said.each[0].case in (tmp_path / "page.html").read_text(encoding="utf-8")
    one_file = min(files.iterdir())
    again = cornerforge.retest(one_file, av="idm-mobil")
    assert [(one.case, one.recorded) for one in again.each] == [(one_file.stem, "still crashing")]


def test_a_new_crash_in_a_case_file_fails_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An AV from outside that heeds nobody, in a case that the old one survived."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "heedless.py").write_text(AVS, encoding="utf-8")
    survived = replace(of_moving(braking_leader()), av="idm-mobil", happened=Happened())
    cornerforge.write_case_file(survived, tmp_path / "cases" / "braking.json")
    words = ["retest", "cases", "--av", "heedless:Heedless", "--junit", "found.xml", "--json"]
    assert cli.main(words) == 1
    told = json.loads(capsys.readouterr().out)
    assert (told["new_crashes"], told["got_worse"]) == (1, True)
    suite = ElementTree.parse(tmp_path / "found.xml").getroot()
    assert (suite.get("tests"), suite.get("failures")) == ("1", "1")


def test_what_retest_cannot_do_with_case_files(tmp_path: Path, files: Path) -> None:
    cornerforge.write_case_file(of_moving(braking_leader()), tmp_path / "a" / "open.json")
    with pytest.raises(InputError, match=r"open does not say what became of the case.*--baseline, such as recorded"):
        cornerforge.retest(tmp_path / "a", av="idm-mobil")
    said = cornerforge.retest(tmp_path / "a", av="idm-mobil", baseline="recorded")
    assert (said.fixed, said.natural) == (1, None)
    with pytest.raises(InputError, match="tell of no traffic"):
        cornerforge.retest(files, av="idm-mobil-d2rl", natural_tests=10)
    (tmp_path / "a" / "other.json").write_text("{}", encoding="utf-8")
    with pytest.raises(FileFormatError, match=r"other\.json is no case file"):
        cornerforge.retest(tmp_path / "a" / "other.json", av="idm-mobil")
    said = cornerforge.retest(tmp_path / "a", av="idm-mobil", baseline="recorded")
    assert (said.cases, said.note) == (1, "Left out: other.json is no case file.")
    assert "Left out: other.json" in retest_text(said)
    damaged = (tmp_path / "a" / "open.json").read_text(encoding="utf-8")[:-100]
    (tmp_path / "a" / "damaged.json").write_text(damaged, encoding="utf-8")
    with pytest.raises(FileFormatError, match=r"damaged\.json is no case file"):
        cornerforge.retest(tmp_path / "a", av="idm-mobil", baseline="recorded")
    with pytest.raises(FileFormatError, match=r"none\.json: No such file"):
        cornerforge.retest(tmp_path / "none.json", av="idm-mobil")
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "notes.json").write_text("{}", encoding="utf-8")
    with pytest.raises(FileFormatError, match="is no case library"):
        cornerforge.retest(tmp_path / "b", av="idm-mobil")


def test_what_export_writes_is_what_retest_takes(swerve_library: Path, tmp_path: Path) -> None:
    """The pair that docs/interchange.md names: the folder holds provenance.json too."""
    assert cli.main(["export", str(swerve_library), "all", "--to", "json", "--out", str(tmp_path / "cases")]) == 0
    assert (tmp_path / "cases" / "provenance.json").exists()
    assert cli.main(["retest", str(tmp_path / "cases"), "--av", "idm-mobil"]) == 0
    said = cornerforge.retest(tmp_path / "cases", av="idm-mobil")
    assert (said.cases, said.still_crashing, said.note) == (60, 60, None)
    with pytest.raises(FileFormatError, match=r"provenance\.json is no case file"):
        cornerforge.retest(tmp_path / "cases" / "provenance.json", av="idm-mobil")


def tailgated(name: str = "tailgated") -> MovingCase:
    """A truck on rails follows the AV, 10 m behind, both at 25 m/s."""
    poses = np.zeros((58, 2, POSE_NUMBERS))
    poses[:, :, Y], poses[:, :, LANE], poses[:, :, SPEED] = 1.75, 0, 25.0
    poses[:, :, X] = 2.5 * np.arange(58)[:, None] + [0.0, -18.3]
    odd = straight_road(lanes=2, lane_width=3.5, vehicles=2, seconds=5.8, fastest=25.0, av_size=(4.6, 1.8))
    return MovingCase(name, odd, np.array([0, 1], np.int8), np.array([4.6, 12.0]), np.array([1.8, 2.5]), poses)


@pytest.fixture
def struck(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """AVs from outside, and two cases that the old AV survived: one brakes ahead, one follows."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "avs.py").write_text(AVS, encoding="utf-8")
    for moving in (braking_leader(), tailgated()):
        case = replace(of_moving(moving), av="idm-mobil", happened=Happened())
        cornerforge.write_case_file(case, tmp_path / "cases" / f"{moving.name}.json")
    return tmp_path / "cases"


@pytest.mark.usefixtures("in_memory")
def test_who_strikes_is_told_and_may_decide(struck: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["retest", "cases", "--av", "avs.py:Coward"]) == 1
    told = capsys.readouterr().out
    # 10 m = 0.533 m while braking grows at 12.65 m/s3 to 8 m/s2, then 2.53 t + 4 t^2: 0.63 s and 1.25 s.
    found = "tailgated: crash after 1.9 s: the truck in slot 1, at 25.0 m/s, strikes the AV, at"
    assert f"  New crashes in 1 case:\n    {found}" in told
    assert "In 1 of 1 another vehicle strikes the AV; --count av leaves such out." in told
    assert cli.main(["retest", "cases", "--av", "avs.py:Coward", "--count", "av"]) == 0
    told = capsys.readouterr().out
    assert "Not counted, as another vehicle strikes the AV in 1 case:\n    tailgated: crash after" in told
    each = cornerforge.retest(struck, av="avs.py:Heedless", count="av").each
    assert [(one.case, one.recorded, one.striker) for one in each] == [
        ("braking", "new", "av"), ("tailgated", "never", None)
    ]  # fmt: skip
    assert str(each[1].words).startswith("no crash of the AV in ")
    # What the old AV did counts by the same rule.
    case = cornerforge.read_case_file(struck / "tailgated.json")
    happened = drive_case(case, av="avs.py:Coward").happened
    cornerforge.write_case_file(replace(case, happened=happened), struck / "tailgated.json", overwrite=True)
    for count, kind in (("any", "fixed"), ("av", "never")):
        assert cornerforge.retest(struck, av="avs.py:Heedless", count=count).each[1].recorded == kind
    with pytest.raises(InputError, match='No count "bv"'):
        cornerforge.retest(struck, av="idm-mobil", count="bv")


@pytest.mark.usefixtures("in_memory")
def test_an_av_that_fails_in_a_case_file_fails_the_command(struck: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["retest", str(struck), "--av", "avs.py:Fails"]
    assert cli.main([*words, "--junit", "found.xml"]) == 1
    told = capsys.readouterr().out
    assert "The AV failed in 2 cases:\n    braking: The AV avs.py:Fails raised RuntimeError(lost my way)" in told
    assert "It got WORSE." in told
    suite = ElementTree.parse("found.xml").getroot()
    assert (suite.get("tests"), suite.get("errors"), suite.get("failures")) == ("2", "2", "0")
    error = suite.find("testcase/error")
    assert error is not None
    assert "lost my way" in str(error.get("message"))
    # A baseline that fails tells nothing of the AV.
    said = cornerforge.retest(struck, av="idm-mobil", baseline="avs.py:Fails")
    assert (said.got_worse, said.recorded.left_out, said.each[0].failure) == (False, 2, None)


def test_errors_of_a_drive_name_the_case() -> None:
    case = of_moving(braking_leader("crowded"))
    script = replace(case.script, start=case.script.start.copy())
    script.start["length"][1] = 99.0
    with CaseDriver(WorldOptions(av="idm-mobil")) as driver:
        for drive in (driver.drive, driver.record):
            with pytest.raises(InputError, match=r"^Case crowded: Vehicle 1 of the script is 99 m long"):
                drive(replace(case, script=script))


def test_which_crashes_count_is_for_case_files(swerve_library: Path) -> None:
    with pytest.raises(InputError, match="count = 'av' is for case files"):
        cornerforge.retest(swerve_library, av="idm-mobil", count="av")
