"""The plugin of pytest, as a user has it: in a run of pytest of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest
from avs_by_hand import AVS

import cornerforge
import cornerforge.pytest_plugin
from cornerforge.drivers.rails import ACCELERATION, LANE, POSE_NUMBERS, SPEED, X, Y
from cornerforge.library.case_file import Happened, of_moving
from cornerforge.library.out_case import MovingCase, straight_road

pytestmark = pytest.mark.full

EXAMPLES = Path(__file__).parent.parent / "examples"
TESTS = """
import pytest


@pytest.mark.cornerforge("cases/*.json", av="avs/mine.py:Heedless")
def test_heedless(case):
    case.check()


@pytest.mark.cornerforge("cases/near.json", "cases/far.json", av="avs/mine.py:Coward")
class TestCoward:
    def test_stops(self, case):
        assert not case.drive().crashed

    def test_is_the_file(self, case):
        assert case.read().name == case.name


@pytest.mark.cornerforge("cases/near.json")
def test_says_it_itself(case):
    assert case.drive(av="recorded").crashed
    assert not case.drive(av="idm-mobil").crashed
"""


def stopped_truck(name: str, gap: float) -> MovingCase:
    """The AV, at 20 m/s, has a standing truck before it."""
    poses = np.zeros((40, 2, POSE_NUMBERS))
    poses[:, :, Y], poses[:, :, LANE], poses[:, :, ACCELERATION] = 1.75, 0, 0.0
    poses[:, 0, X], poses[:, 0, SPEED] = 2.0 * np.arange(40), 20.0
    poses[:, 1, X] = gap + 8.5
    odd = straight_road(lanes=2, lane_width=3.5, vehicles=2, seconds=4.0, fastest=20.0, av_size=(5.0, 2.0))
    return MovingCase(name, odd, np.array([0, 1], np.int8), np.array([5.0, 12.0]), np.array([2.0, 2.5]), poses)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Tests of a user, beside the cases."""
    place = tmp_path / "project" / "tests"
    for name, gap in (("near", 50.0), ("far", 59.0)):
        case = of_moving(stopped_truck(name, gap))
        cornerforge.write_case_file(replace(case, av="old", happened=Happened()), place / "cases" / f"{name}.json")
    (place / "avs").mkdir()
    (place / "avs" / "mine.py").write_text(AVS, encoding="utf-8")
    (place / "test_mine.py").write_text(TESTS, encoding="utf-8")
    return place.parent


def pytest_in(folder: Path, *words: str) -> tuple[int, str]:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-rA", "--strict-markers", "-c", os.devnull]
    is_installed = entry_points(group="pytest11", name="cornerforge")  # not yet where the environment is older than it
    loaded = () if is_installed else ("-p", "cornerforge.pytest_plugin")
    done = subprocess.run(
        [*command, "--rootdir", str(folder), *loaded, *words], cwd=folder, env=environment, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout + done.stderr


def test_a_test_of_ones_own_av(project: Path) -> None:
    status, told = pytest_in(project, "tests")
    assert status == 1
    assert "1 failed" not in told
    assert "2 failed, 5 passed" in told
    assert "FAILED tests/test_mine.py::test_heedless[cases/near]" in told
    # 50 m at 20 m/s: 2.5 s, seen at the next tenth.
    assert (
        "Case tests/cases/near.json, AV tests/avs/mine.py:Heedless: crash after 2.6 s: the AV, at 20.0 m/s, strikes "
        "the truck" in told
    )
    assert "As the file says, old did not crash." in told
    seen = "cornerforge retest tests/cases/near.json --av tests/avs/mine.py:Heedless --page seen.html"
    assert f"To see it: {seen}" in told
    assert "PASSED tests/test_mine.py::TestCoward::test_stops[cases/far]" in told


def test_a_failed_assert_says_what_happened(project: Path) -> None:
    text = TESTS.replace("avs/mine.py:Coward", "avs/mine.py:Heedless")
    (project / "tests" / "test_mine.py").write_text(text, encoding="utf-8")
    status, told = pytest_in(project, "tests", "-k", "stops and near")
    assert status == 1
    assert "1 failed, 6 deselected" in told
    assert (
        "<case near, AV tests/avs/mine.py:Heedless: crash after 2.6 s: the AV, at 20.0 m/s, strikes the truck" in told
    )


def test_it_works_with_xdist(project: Path) -> None:
    pytest.importorskip("xdist")
    status, told = pytest_in(project, "tests", "-n", "2", "-k", "says or is_the_file")
    assert status == 0
    assert "3 passed" in told


WRONG = [
    ('"nothing/*.json", av="idm-mobil"', "case", "no file nothing/*.json (looked in"),
    ('av="idm-mobil"', "case", 'name case files, such as "cases/*.json"'),
    ('"", av="idm-mobil"', "case", 'name case files, such as "cases/*.json"'),
    ('"cases/*.json", speed=3', "case", "speed is not known; known: av, av_actions"),
    ('"cases/*.json", av="idm-mobil"', "", "the test must take the argument `case`"),
    ('"cases/near.json"', "case", "Name the AV: @pytest.mark.cornerforge"),
    ('"cases/near.json", av="idm-mobl"', "case", 'No AV "idm-mobl". Did you mean "idm-mobil"?'),
    ('"avs/mine.py", av="idm-mobil"', "case", "mine.py is no case file"),
    ('"cases/near.json", av="avs/mine.py:Fails"', "case", "raised RuntimeError(lost my way)"),
    ('"cases/near.json", av="avs/gone.py:Fails"', "case", "No AV file "),
    ('"cases/near.json", av="avs/mine.py:Fail"', "case", 'No class in mine.py "Fail". Did you mean "Fails"?'),
]


def test_what_is_wrong_with_a_marker_is_told(project: Path) -> None:
    names = [f"tests/test_wrong{number}.py" for number in range(len(WRONG))]
    for name, (marker, argument, _) in zip(names, WRONG, strict=True):
        test = f"def test_it({argument}):\n    {argument or 'case'}.check()\n"
        (project / name).write_text(f"import pytest\n\n@pytest.mark.cornerforge({marker})\n{test}", encoding="utf-8")
    status, told = pytest_in(project, "--continue-on-collection-errors", *names)
    assert status == 1
    assert "passed" not in told
    for _, _, message in WRONG:
        assert message in told
    assert "Traceback" not in told
    assert "src/cornerforge" not in told
    assert len(told.splitlines()) < 8 * len(WRONG)


def test_who_strikes_may_decide(project: Path) -> None:
    case = of_moving(stopped_truck("near", 50.0))
    poses = np.array(case.script.poses)
    poses[:, 1, X], poses[:, 1, SPEED] = 2.0 * np.arange(len(poses)) - 14.0, 20.0
    start = case.script.start.copy()
    start["x"][1], start["speed"][1] = -14.0, 20.0
    behind = replace(case, name="behind", script=replace(case.script, poses=poses, start=start))
    cornerforge.write_case_file(behind, project / "tests" / "behind" / "behind.json")
    text = "\n\n".join(
        f"def test_{name}(case):\n    case.check({words})" for name, words in (("any", ""), ("av", "count='av'"))
    )
    mark = 'pytestmark = pytest.mark.cornerforge("behind/*.json", av="avs/mine.py:Coward")'
    (project / "tests" / "test_behind.py").write_text(f"import pytest\n\n{mark}\n\n{text}\n", encoding="utf-8")
    (project / "tests" / "behind" / "provenance.json").write_text("{}", encoding="utf-8")  # as `export` leaves it
    status, told = pytest_in(project, "tests/test_behind.py")
    assert status == 1
    assert "1 failed, 1 passed" in told
    assert "PASSED tests/test_behind.py::test_av[behind/behind]" in told
    assert "strikes the AV, at" in told


OTHER = """
import sys
import pytest

@pytest.fixture
def case():
    return 3

def test_it(case):
    assert case == 3
    ours = {one for one in sys.modules if one.partition(".")[0] == "cornerforge"}
    assert ours <= {"cornerforge", "cornerforge._doors", "cornerforge.pytest_plugin"}, ours
    assert "numpy" not in sys.modules
"""


def test_others_do_not_notice_it(tmp_path: Path) -> None:
    """A suite without the marker: no module of cornerforge but the plugin, and a fixture `case` of its own."""
    (tmp_path / "test_other.py").write_text(OTHER, encoding="utf-8")
    status, told = pytest_in(tmp_path, ".")
    assert status == 0, told
    status, told = pytest_in(tmp_path, "--markers")
    assert "@pytest.mark.cornerforge(files, ..., av): run the test once for each case file" in told


def test_pytest_finds_it_where_it_is_installed() -> None:
    project = tomllib.loads((EXAMPLES.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"]["pytest11"] == {"cornerforge": cornerforge.pytest_plugin.__name__}


def test_the_example_works(tmp_path: Path) -> None:
    for name in ("my_av.py", "test_my_av.py"):
        (tmp_path / name).write_text((EXAMPLES / name).read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "cases").symlink_to(EXAMPLES / "cases")
    status, told = pytest_in(tmp_path, "test_my_av.py")
    assert status == 0, told
    assert "PASSED test_my_av.py::test_my_av_does_not_crash[cases/hard-braking]" in told
