"""docs/licences.md lists what is installed, and nothing whose licence is not allowed."""

from __future__ import annotations

import pytest
from licences import PAGE, ROOT, Facts, Row, allowed, brings, facts_installed, rows_of, table_rows
from sbom import FOR_DEVELOPERS, bundled, pins, plain_name

TEXT = PAGE.read_text(encoding="utf-8")


def differences(listed: list[Row], computed: list[Row], unknown: set[str]) -> list[str]:
    """Packages of which the page says something else than their metadata; extras unknown here are not compared."""
    by_name = {one.name: one for one in listed}

    def comparable(row: Row) -> Row:
        return row._replace(extras=tuple(extra for extra in row.extras if extra not in unknown))

    wrong = []
    for row in computed:
        on_page = by_name.get(row.name)
        if on_page is None or comparable(on_page) != comparable(row):
            wrong.append(f"{row} stands as {on_page}")
    return wrong


def test_the_page_is_what_the_installed_packages_say() -> None:
    facts = facts_installed(pins(ROOT / "constraints.txt"))
    assert len(facts) >= 80
    users, tools, unknown = rows_of(facts)
    of_unknown = {row.name for row in table_rows(TEXT) if {*row.extras} & unknown}  # extras that are not installed here
    known_tools = [row for row in tools if row.extras and row.name not in of_unknown]
    assert not unknown & {"learn", "analysis", "report", "query", "explorer", "gym", "onnx"}
    assert differences(table_rows(TEXT), [*users, *known_tools], unknown) == [], "run: make licences"
    changed = [row._replace(licence="GPL-3.0-only") if row.name == "rich" else row for row in users]
    assert [line for line in differences(table_rows(TEXT), changed, unknown) if "name='rich'" in line]


def test_the_page_has_every_version_that_is_tested_and_no_other() -> None:
    listed = {plain_name(row.name): row.version for row in table_rows(TEXT)}
    assert listed == pins(ROOT / "constraints.txt"), "run: make licences"
    assert all(row.extras != ("",) for row in table_rows(TEXT)), "a version is tested that nothing brings"


def test_no_licence_is_listed_that_is_not_allowed() -> None:
    for row in table_rows(TEXT):
        assert allowed(row.licence, tool={*row.extras} <= {*FOR_DEVELOPERS}), f"{row.name}: {row.licence}"


@pytest.mark.parametrize(
    ("licence", "as_part", "as_tool"),
    [
        ("MIT", True, True),
        ("Apache-2.0 WITH LLVM-exception AND MIT", True, True),
        ("GPL-3.0-only OR MIT", True, True),
        ("GPL-2.0-only", False, True),
        ("MIT AND GPL-3.0-only", False, False),
        ("not said", False, False),
        ("", False, False),
    ],
)
def test_what_is_allowed(licence: str, as_part: bool, as_tool: bool) -> None:
    assert (allowed(licence), allowed(licence, tool=True)) == (as_part, as_tool)


def test_an_extra_brings_what_its_requirements_bring() -> None:
    facts = {
        "a": Facts("a", "1", "MIT", ("b[fast]>=1", 'w; sys_platform == "win32"')),
        "b": Facts("b", "1", "MIT", ('c; extra == "fast"', 'd; extra == "slow"', "a")),
        "c": Facts("c", "1", "MIT", ()),
    }
    assert brings(facts, ["a"]) == {"a", "b", "c"}
    assert brings(facts, ["b[slow]"]) is None
    assert brings(facts, ["b"]) == {"a", "b", "c"}


def test_the_page_lists_the_scripts_of_the_wheel() -> None:
    inside = bundled(ROOT)
    if not inside:
        pytest.skip("the explorer's page is not built: make web")
    assert all(allowed(licence) for _, licence in inside.values())
    for name, (version, licence) in inside.items():
        assert f"| {name} | {version} | {licence} |" in TEXT, "run: make licences"
