"""Known faults are found in the versions that are tested, in those that are allowed, and in those of the page."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from audit import ROOT, Package, known, lowest, of_the_page, pinned, read_advisories
from packaging.specifiers import SpecifierSet
from sbom import pins


def test_every_advisory_can_hit_and_is_of_a_package_of_ours() -> None:
    advisories, accepted = read_advisories()
    names = {*pins(ROOT / "constraints.txt")}
    locked = json.loads((ROOT / "web" / "package-lock.json").read_text(encoding="utf-8"))
    names |= {package.name for package in of_the_page(locked)}
    assert len({one["id"] for one in advisories}) == len(advisories) >= 50
    assert {one["package"] for one in advisories} <= names
    assert accepted.keys() <= {one["id"] for one in advisories}
    for one in advisories:
        assert one["id"].startswith("GHSA-")
        for text in one["affected"]:
            first = [limit.version for limit in SpecifierSet(text) if limit.operator == ">="] or ["0"]
            assert known([Package(one["package"], first[0], "")], [one]), one["id"]


@pytest.mark.parametrize(
    ("name", "version", "number"),
    [("jinja2", "2.10", "GHSA-cpwx-vrp4-4pq7"), ("npm:preact", "10.28.1", "GHSA-36hm-qxxp-pg3m")],
)
def test_a_bad_version_is_found_and_the_first_good_one_is_not(name: str, version: str, number: str) -> None:
    advisories, _ = read_advisories()
    assert number in {one.ids[0] for one in known([Package(name, version, "")], advisories)}
    assert known([Package(name, {"jinja2": "3.1.6"}.get(name, "10.28.2"), "")], advisories) == []


def test_the_lowest_version_is_what_users_may_get() -> None:
    text = """[project]
    name = "cornerforge"
    dependencies = ["numpy>=2.0", "anything"]
    [project.optional-dependencies]
    learn = ["torch>=2.4"]
    all = ["cornerforge[learn]", "torch>=2.10"]
    dev = ["pytest>=8.2"]
    """
    assert [one[:2] for one in lowest(text)] == [("numpy", "2.0"), ("anything", "0"), ("torch", "2.4")]
    found = known(lowest(text), read_advisories()[0])
    assert ("torch", "GHSA-53q9-r3pm-6pq6") in {(one.package.name, one.ids[0]) for one in found}


def test_no_known_fault_reaches_us_by_the_list() -> None:
    """What `make audit` says where no service is reached; it also asks services, and a test does not."""
    advisories, accepted = read_advisories()
    allowed = lowest((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    locked = of_the_page(json.loads((ROOT / "web" / "package-lock.json").read_text(encoding="utf-8")))
    found = known([*pinned(ROOT / "constraints.txt"), *allowed, *locked], advisories)
    assert [one for one in found if one.ids[0] not in accepted] == []
    assert {one.ids[0] for one in found} == accepted.keys(), "an advisory is accepted that no version has any more"


def test_the_program_fails_for_a_bad_version_and_tells_its_age(tmp_path: Path) -> None:
    bad = tmp_path / "bad.txt"
    bad.write_text("# tested together\nJinja2==2.10\n", encoding="utf-8")
    # Without addresses of services: a proxy that nobody runs.
    environment = {"PATH": "", "https_proxy": "http://127.0.0.1:9", "HOME": str(tmp_path)}
    command = [sys.executable, str(ROOT / "supply" / "audit.py"), str(bad)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr
    assert "days old" in done.stdout
    assert "NOT REACHED" in done.stdout
    assert "jinja2 2.10 (bad.txt): GHSA-cpwx-vrp4-4pq7" in done.stdout
    assert "FAULT" in done.stdout
