"""Lines of the source by folder (docs/adr/0059-sizes.md): a budget may fall, and rises only with a line in that ADR."""

from __future__ import annotations

from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "cornerforge"
TOP = "modules beside the folders"
BUDGETS = {
    "adversary": 3_795, "analysis": 5_765, "cli": 1_265, "counterfactual": 1_590, "drivers": 1_725, "envs": 30,
    "experiment": 1_490, "ext": 31_330, "foreign": 5_075, "library": 3_615, "metrics": 720,
    "ndd": 830, "rates": 4_785, "report": 3_420, "results": 3_025, "road": 1_155, "sim": 9_025, "site": 585,
    "verbs": 5_945, "work": 780, TOP: 5_340,
}  # fmt: skip
LONGEST = 640
"""Lines of a file, at most."""


def lines(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def sizes() -> dict[str, int]:
    found = {TOP: sum(map(lines, SOURCE.glob("*.py")))}
    for folder in sorted(one for one in SOURCE.iterdir() if (one / "__init__.py").exists()):
        found[folder.name] = sum(map(lines, folder.rglob("*.py")))
    return found


@pytest.mark.parametrize("folder", BUDGETS)
def test_a_folder_keeps_its_budget(folder: str) -> None:
    size = sizes()[folder]
    assert size <= BUDGETS[folder]
    assert size > 0.9 * BUDGETS[folder] - 20, "the budget falls with the folder"


def test_every_folder_has_a_budget() -> None:
    assert set(sizes()) == set(BUDGETS)


def test_no_file_is_long() -> None:
    assert {str(path.relative_to(SOURCE)): n for path in SOURCE.rglob("*.py") if (n := lines(path)) > LONGEST} == {}
