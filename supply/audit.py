"""Looks for known faults in what cornerforge is made of: python supply/audit.py [CONSTRAINTS]; see `make audit`.

Three lists of packages: the versions that are tested together (constraints.txt), the lowest that pyproject.toml allows,
and those of the explorer's page (web/package-lock.json). Each is compared with supply/advisories.toml, which is as old
as it says. Where a service answers, it is asked too: OSV or PyPI by pip-audit, npm's registry by `npm audit`. With each
question goes a version that is known to be bad: who does not find that one knows nothing, whatever it says of others.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Sequence
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

from packaging.specifiers import SpecifierSet
from packaging.version import Version
from sbom import FOR_DEVELOPERS, pins, plain_name, requirements

ROOT = Path(__file__).resolve().parents[1]
SERVICES = ("osv", "pypi")
KNOWN_BAD = ("django", "3.0")
KNOWN_BAD_OF_NPM = ("minimist", "0.0.8")


class Package(NamedTuple):
    """A version that somebody may install; `name` begins with npm: for a package of the page."""

    name: str
    version: str
    place: str


class Finding(NamedTuple):
    """An advisory that holds for a package."""

    package: Package
    ids: tuple[str, ...]
    about: str


def read_advisories() -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Read the list: the advisories, and why some do not reach us, by number."""
    content = tomllib.loads((ROOT / "supply" / "advisories.toml").read_text(encoding="utf-8"))
    return content["advisories"], {one["id"]: one["why"] for one in content["accepted"]}


def pinned(constraints: Path) -> list[Package]:
    """List the versions of a file like constraints.txt."""
    return [Package(name, version, constraints.name) for name, version in pins(constraints).items()]


def lowest(pyproject: str) -> list[Package]:
    """List the lowest versions that a pyproject.toml allows its users; "0" where it names no lowest."""
    found = []
    for name, wanted in requirements(tomllib.loads(pyproject)["project"]).items():
        texts = [text for extra, text in wanted.items() if extra not in FOR_DEVELOPERS]
        limits = [one.version for text in texts for one in SpecifierSet(text) if one.operator in (">=", "==")]
        found += [Package(name, min(limits, key=Version, default="0"), "allowed by pyproject.toml")] if texts else []
    return found


def of_the_page(lock: dict[str, Any]) -> list[Package]:
    """List the packages of a package-lock.json."""
    return [
        Package("npm:" + path.rpartition("node_modules/")[2], about["version"], "web/package-lock.json")
        for path, about in lock["packages"].items()
        if path
    ]


def known(packages: Iterable[Package], advisories: Iterable[dict[str, Any]]) -> list[Finding]:
    """Find the advisories of the list that hold for packages."""
    return [
        Finding(package, (one["id"],), one["about"])
        for package in packages
        for one in advisories
        if one["package"] == package.name
        and any(SpecifierSet(text).contains(package.version, prereleases=True) for text in one["affected"])
    ]


# --- services ---


def ask_pip_audit(service: str, packages: Sequence[Package]) -> list[Finding] | None:
    """Ask a service about packages of PyPI; None if it does not know what is known, or left one out."""
    lines = [f"{name}=={version}" for name, version in [KNOWN_BAD, *((one.name, one.version) for one in packages)]]
    with tempfile.TemporaryDirectory() as folder:
        asked = Path(folder) / "requirements.txt"
        asked.write_text("\n".join(lines), encoding="utf-8")
        command = [sys.executable, "-m", "pip_audit", "-s", service, "-r", str(asked), "--no-deps", "--disable-pip",
                   "--progress-spinner", "off", "--format", "json", "--desc", "off", "--aliases", "on"]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    try:
        answers = {plain_name(one["name"]): one for one in json.loads(done.stdout)["dependencies"]}
    except (ValueError, KeyError):
        return None
    if not answers.get(KNOWN_BAD[0], {}).get("vulns") or any("vulns" not in one for one in answers.values()):
        return None
    return [
        Finding(
            package, (fault["id"], *fault["aliases"]), f"mended in {', '.join(fault['fix_versions']) or 'no version'}"
        )
        for package in packages
        for fault in answers[package.name]["vulns"]
    ]


def ask_npm(lock: dict[str, Any]) -> list[Finding] | None:
    """Ask npm's registry about a package-lock.json; None if it does not know what is known, or there is no npm."""
    if shutil.which("npm") is None:
        return None
    bad, version = KNOWN_BAD_OF_NPM
    root = {**lock["packages"][""]}
    root["dependencies"] = {**root["dependencies"], bad: version}
    packages = {**lock["packages"], "": root, f"node_modules/{bad}": {"version": version}}
    with tempfile.TemporaryDirectory() as folder:
        for name, content in (("package.json", root), ("package-lock.json", {**lock, "packages": packages})):
            (Path(folder) / name).write_text(json.dumps(content), encoding="utf-8")
        command = ["npm", "audit", "--json", "--package-lock-only"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    try:
        faults = json.loads(done.stdout)["vulnerabilities"]
    except (ValueError, KeyError):
        return None
    if bad not in faults:
        return None
    place = "web/package-lock.json"
    return [
        Finding(Package(f"npm:{name}", about["range"], place), (via["url"].rpartition("/")[2],), via["title"])
        for name, about in faults.items()
        for via in about["via"]
        if name != bad and isinstance(via, dict)
    ]


def main() -> int:
    """Look everywhere and say what was found; 1 if there is a fault that reaches us."""
    constraints = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "constraints.txt"
    advisories, accepted = read_advisories()
    lock = json.loads((ROOT / "web" / "package-lock.json").read_text(encoding="utf-8"))
    installed, allowed = pinned(constraints), lowest((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    page = of_the_page(lock)
    newest = max(one["published"] for one in advisories)
    age = (date.today() - newest).days
    print(f"Compared: {len(installed)} versions of {constraints.name}, {len(allowed)} lowest ones, {len(page)} of npm.")
    print(f"supply/advisories.toml: {len(advisories)} advisories, the newest of {newest}, {age} days old.")
    found = known([*installed, *allowed, *page], advisories)

    hits = {number for one in found for number in one.ids}
    idle = sorted(accepted.keys() - hits) if constraints == ROOT / "constraints.txt" else []
    service = next((one for one in SERVICES if ask_pip_audit(one, []) is not None), None)
    for packages in (installed, allowed) if service else ():
        newer = ask_pip_audit(str(service), packages)
        if newer is None:
            service = None
            break
        found += newer
    of_npm = ask_npm(lock)
    found += of_npm or []
    for name, knows in ((service or "OSV and PyPI", service), ("npm's registry", of_npm is not None)):
        print(
            f"{name}: "
            + ("asked too." if knows else f"NOT REACHED; what became known in these {age} days is not looked for.")
        )

    wrong = 0
    for package, ids, about in dict.fromkeys(found):
        why = next((accepted[number] for number in ids if number in accepted), None)
        wrong += why is None
        verdict = f"does not reach us: {why}" if why else "FAULT"
        print(f"{package.name} {package.version} ({package.place}): {' '.join(ids)}, {about}. {verdict}")
    for number in idle:
        print(f"supply/advisories.toml accepts {number}, which no version has any more; take it out.")
    print(f"{wrong} faults that reach us." if wrong else "No known fault reaches us.")
    return int(bool(wrong or idle))


if __name__ == "__main__":
    sys.exit(main())
