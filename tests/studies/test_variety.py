"""`variety` and `plausibility`: what they say agrees with what libraries and policies do."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import cornerforge
from cornerforge._checksums import with_checksum
from cornerforge.errors import InputError, OutputError
from cornerforge.experiment.policy_file import load_policy
from cornerforge.ext.studies.plausibility import plausibility_text
from cornerforge.ext.studies.variety import variety_text
from cornerforge.library import CaseLibrary
from cornerforge.results import Plausibility, as_json

pytestmark = pytest.mark.full


def test_a_librarys_row_counts_its_cases(swerve_library: Path, tmp_path: Path) -> None:
    cornerforge.simulate(tests=5, out=tmp_path / "empty")
    found = cornerforge.variety(libraries=[swerve_library, tmp_path / "empty"])
    row, empty = found.rows
    library = CaseLibrary.open(swerve_library)
    assert (row.cases, row.tests, row.av_crashes) == (60, library.tests, 60)
    assert sum(row.cells.values()) == 60
    assert row.filled == len(row.cells) > 1
    types = cornerforge.analyse(swerve_library).crash_types
    by_type = dict.fromkeys(map(str, types), 0)
    for cell, n in row.cells.items():
        by_type[cell.split(" | ")[0]] += n
    assert by_type == types
    assert (empty.cases, empty.filled, empty.entropy) == (0, 0, None)
    assert "60 cases in" in variety_text(found)


def test_policies_are_compared_on_the_same_tests(some_policy: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.safetensors"
    other.write_bytes(some_policy.read_bytes())
    ways = {"policies": [some_policy, other], "tests": 150, "odd": "paper", "acting": "softmax:0.5", "seed": 3}
    found = cornerforge.variety(**ways, threads=2)  # type: ignore[arg-type]
    assert found == cornerforge.variety(**ways, threads=1)  # type: ignore[arg-type]
    names = [row.name for row in found.rows]
    assert [name.rpartition(", ")[2] for name in names] == ["greedy", "softmax:0.5"] * 3
    assert names[4:] == ["mixture of 2, greedy", "mixture of 2, softmax:0.5"]
    assert all(row.tests == 150 for row in found.rows)
    nameless = [replace(row, name="") for row in found.rows]
    greedy, at_random = nameless[:2]
    # Both policies are the same one, so their mixture is it too; acting at random is something else.
    assert nameless[2] == nameless[4] == greedy
    assert nameless[3] == nameless[5] == at_random
    assert at_random != greedy


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "either libraries or policies"),
        ({"libraries": ["a"], "policies": ["b"]}, "either libraries or policies"),
        ({"policies": ["swerve"]}, "A mixture is of policy files|needs a policy"),
        ({"policies": ["x"], "acting": "greedy"}, "shown anyway"),
        ({"policies": ["x"], "acting": "softmax:0"}, "temperature"),
        ({"policies": ["x"], "acting": "softmax:warm"}, "no number"),
        ({"policies": ["x"], "acting": "softly"}, "softmax"),
        ({"policies": ["x"], "tests": 0}, "tests"),
    ],
)
def test_wrong_arguments_are_named(arguments: dict[str, object], message: str, some_policy: Path) -> None:
    if arguments.get("policies") == ["x"]:
        arguments = arguments | {"policies": [some_policy]}
    with pytest.raises(InputError, match=message):
        cornerforge.variety(**arguments)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def curve(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Plausibility]:
    out = tmp_path_factory.mktemp("plausibility") / "curve"
    return out, cornerforge.plausibility(out=out, budgets=[30.0, 0.0], seeds=1, decisions=100_000, tests=400)


def test_the_curve_has_every_mask_and_keeps_its_policies(curve: tuple[Path, Plausibility]) -> None:
    out, found = curve
    rows = found.rows
    assert [(row.budget, row.bounded) for row in rows] == [(0.0, True), (30.0, True), (None, True), (None, False)]
    for row in rows:
        (run,) = row.runs
        assert run.tests == 400
        if row.bounded and run.shortfall_per_test is not None:
            assert run.log_prob_per_decision is not None
            assert run.implausible_per_test == 0.0
            assert run.log_prob_per_decision < 0.0
        if row.budget is not None:
            assert (run.shortfall_per_test or 0.0) <= row.budget
    unbounded = rows[3].runs[0].implausible_per_test
    assert unbounded is not None
    assert unbounded > 0.0
    assert load_policy(out / "30-0.safetensors").budget == 30.0
    assert load_policy(out / "bounded-0.safetensors").budget is None
    assert not load_policy(out / "unbounded-0.safetensors").bounded
    assert (out / "plausibility.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((out / "plausibility.json").read_text(encoding="utf-8")) == with_checksum(as_json(found))
    natural = found.natural
    assert -4.0 < natural.log_prob_per_decision < -1.0
    assert natural.shortfall_per_test > 0.0
    text = plausibility_text(found)
    assert text.count("\n") == 4
    assert "unbounded" in text


def test_a_budget_of_excess_is_one_of_the_policies(tmp_path: Path) -> None:
    out = tmp_path / "curve"
    cornerforge.plausibility(out=out, budgets=[8.0], budget_of="excess", seeds=1, decisions=512, tests=100)
    assert load_policy(out / "8-0.safetensors").budget_of == "excess"
    assert load_policy(out / "bounded-0.safetensors").budget_of == "shortfall"


def timeless(found: Plausibility) -> Plausibility:
    rows = [replace(row, runs=tuple(replace(run, seconds=0.0) for run in row.runs)) for row in found.rows]
    return replace(found, rows=tuple(rows))


def test_the_curve_is_taken_up_where_it_stopped(curve: tuple[Path, Plausibility]) -> None:
    out, found = curve
    (out / "30-0.json").unlink()
    times = {path.name: path.stat().st_mtime_ns for path in out.glob("*.safetensors")}
    again = cornerforge.plausibility(out=out, budgets=[0.0, 30.0], seeds=1, decisions=100_000, tests=400, resume=True)
    changed = {path.name for path in out.glob("*.safetensors") if path.stat().st_mtime_ns != times[path.name]}
    assert changed == {"30-0.safetensors"}
    assert timeless(again) == timeless(found)
    with pytest.raises(InputError, match="budgets"):
        cornerforge.plausibility(out=out, budgets=[0.0], seeds=1, decisions=100_000, tests=400, resume=True)
    with pytest.raises(OutputError, match="--resume"):
        cornerforge.plausibility(out=out, budgets=[0.0, 30.0], seeds=1, decisions=100_000, tests=400)


@pytest.mark.parametrize(
    "arguments", [{"budgets": [-1.0]}, {"budgets": [1.0, 1.0]}, {"seeds": 0}, {"tests": 0}, {"decisions": 0}]
)
def test_a_wrong_curve_makes_no_folder(arguments: dict[str, object], tmp_path: Path) -> None:
    with pytest.raises(InputError):
        cornerforge.plausibility(out=tmp_path / "curve", **arguments)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())
