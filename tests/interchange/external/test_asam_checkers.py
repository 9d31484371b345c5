"""ASAM's own checkers find no issue in what is written, and another reader reads it.

They need an environment of their own (`make test-interchange` makes it and names its Python in ASAM_PYTHON).
"""

from __future__ import annotations

import json
import os
import subprocess
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crashes_by_hand import mirrored
from openscenario_read_back import real_crashes

from cornerforge.experiment.roads import odd_on, road_named
from cornerforge.ext.interchange.openscenario import MODES, VERSIONS, write_openscenario
from cornerforge.library.out_case import Fact, OutCase
from cornerforge.road.shipped import SHIPPED
from cornerforge.types import Odd, Scenario

pytestmark = pytest.mark.interchange

JUDGE = Path(__file__).with_name("asam_judge.py")
CASES = 3
"""Real crashes of each ODD, in each version and mode, and two that are made of them."""
FACTS: dict[str, Fact] = {
    "case_id": "0:1",
    "av": 'a "b" <c> & d',
    "rate_per_mile": 1.5e-7,
    "licence": None,
    "prevented": True,
}


@pytest.fixture(scope="module")
def python() -> str:
    given = os.environ.get("ASAM_PYTHON", "")
    if not given:
        pytest.skip("ASAM_PYTHON names no environment; run `make test-interchange`")
    return given


def judge(python: str, folder: Path, *read: str) -> dict[str, Any]:
    run = subprocess.run([python, JUDGE, folder, *read], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr[-2000:]
    found: dict[str, Any] = json.loads(run.stdout)
    return found


def size(scenario: Scenario) -> int:
    return int(scenario.x.size)


def some_absent(scenario: Scenario) -> Scenario:
    """The last vehicle comes late, the one before it is away for a while; the AV's partner stays."""
    assert scenario.crash is not None
    free = [column for column in range(1, scenario.slot.size) if scenario.slot[column] != scenario.crash.slot_b]
    present = scenario.present.copy()
    present[:4, free[-1]] = False
    present[3:6, free[-2]] = False
    return replace(scenario, present=present, x=np.where(present, scenario.x, np.nan))


def test_the_checkers_find_nothing(python: str, tmp_path: Path) -> None:
    written = 0
    for odd in ("default", "mixed"):
        crashes = sorted((scenario for scenario in real_crashes(odd) if len(scenario.x) > 10), key=size)[:CASES]
        for number, scenario in enumerate((*crashes, mirrored(crashes[0]), some_absent(crashes[1]))):
            for version in VERSIONS:
                for mode in MODES:
                    case = OutCase(f"{odd}-{number}", scenario, FACTS)
                    write_openscenario(case, tmp_path / f"{version}-{mode}", version=version, mode=mode)
                    written += 1
    found = judge(python, tmp_path, "mixed-0")
    scenarios = [about for name, about in found.items() if name.endswith(".xosc")]
    roads = [about for name, about in found.items() if name.endswith(".xodr")]
    assert (len(scenarios), len(roads)) == (written, len(VERSIONS) * len(MODES))
    assert {name: about["issues"] for name, about in found.items() if about["issues"]} == {}
    assert {name: about["failed"] for name, about in found.items() if about["failed"]} == {}
    assert {name: about["unread"] for name, about in found.items() if about["unread"]} == {}
    assert sum(about["read"] for about in scenarios) == len(VERSIONS) * len(MODES)
    # 17 checkers know 1.2 and 1.3, five of them the older ones too; of 23 of roads one is for 1.8 only.
    assert {(name[:3], about["completed"]) for name, about in found.items() if name.endswith(".xosc")} == {
        ("1.0", 5), ("1.1", 5), ("1.2", 17), ("1.3", 17),
    }  # fmt: skip
    assert {about["completed"] for about in roads} == {22}


def test_the_checkers_find_nothing_in_roads_on_which_lanes_end(python: str, tmp_path: Path) -> None:
    scenario = real_crashes("default")[0]
    for road in sorted(SHIPPED):
        on_it = replace(scenario, odd=odd_on(Odd(), road_named(road)))
        write_openscenario(OutCase(road, on_it, FACTS), tmp_path, version="1.3")
    found = judge(python, tmp_path, *SHIPPED)
    assert len(found) == 2 * len(SHIPPED)
    assert {name: about["issues"] for name, about in found.items() if about["issues"]} == {}
    assert {name: about for name, about in found.items() if about["failed"] or about["unread"]} == {}
    assert {about["completed"] for name, about in found.items() if name.endswith(".xodr")} == {22}


@pytest.mark.parametrize(
    ("spoil", "rule"),
    [
        (lambda text: text.replace("<CatalogLocations/>\n", ""), "asam.net:xosc:1.0.0:xml.valid_schema"),
        (
            lambda text: text.replace('<Private entityRef="Ego">', '<Private entityRef="Nobody">'),
            "asam.net:xosc:1.2.0:reference_control.resolvable_entity_references",
        ),
    ],
)
def test_the_checkers_would_find_something(spoil: Any, rule: str, python: str, tmp_path: Path) -> None:
    scenario = real_crashes("default")[0]
    write_openscenario(OutCase("case", scenario, {}), tmp_path)
    file = tmp_path / "case.xosc"
    file.write_text(spoil(file.read_text()))
    assert rule in {issue[0] for issue in judge(python, tmp_path)["case.xosc"]["issues"]}


def test_the_programs_themselves_say_the_same(python: str, tmp_path: Path) -> None:
    names = write_openscenario(OutCase("case", real_crashes("default")[0], FACTS), tmp_path)
    for name, program, bundle in zip(names, ("qc_openscenario", "qc_opendrive"), ("xosc", "xodr"), strict=True):
        config, result = tmp_path / "config.xml", tmp_path / f"{bundle}.xqar"
        config.write_text(
            f'<Config><Param name="InputFile" value="{tmp_path / name}"/><CheckerBundle application="{bundle}Bundle">'
            f'<Param name="resultFile" value="{result}"/></CheckerBundle></Config>'
        )
        subprocess.run([Path(python).with_name(program), "-c", config], check=True, capture_output=True, cwd=tmp_path)
        checkers = list(ET.parse(result).getroot().iter("Checker"))
        assert len(checkers) > 10
        assert "error" not in {checker.get("status") for checker in checkers}
        assert not list(ET.parse(result).getroot().iter("Issue"))
