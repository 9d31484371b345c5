"""Lines of the source by folder (docs/adr/0059-sizes.md): a budget may fall, and rises only with a line in that ADR."""

from __future__ import annotations

from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "cornerforge"
TOP = "modules beside the folders"
BUDGETS = {
    "adversary": 3_835, "analysis": 7_308, "cli": 1_265, "counterfactual": 1_987, "drivers": 1_780, "envs": 30,
    "experiment": 1_673, "ext": 32_868, "foreign": 5_560, "library": 3_653, "metrics": 745,
    "ndd": 830, "rates": 5_003, "report": 3_731, "results": 3_085, "road": 1_173, "sim": 11_857, "site": 1_217,
    "verbs": 6_013, "work": 780, TOP: 5_401,
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
