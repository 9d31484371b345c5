"""The bill of materials of the wheel, as CycloneDX 1.6 in JSON: what code of others is in it, and what it requires.

The scripts of others in the explorer's page have versions: they are in the wheel. Requirements have none, since pip
picks them where the wheel is installed; what pyproject.toml allows is a property of each, and so is the version of
constraints.txt, with which cornerforge is tested.
"""

from __future__ import annotations

import json
import re
import time
import tomllib
import uuid
from pathlib import Path
from typing import Any

__all__ = ["BOM", "FOR_DEVELOPERS", "bill_of_materials", "bom_text", "bundled", "pins", "plain_name", "requirements"]

BOM = "sboms/cornerforge.cdx.json"
"""Its place below the wheel's .dist-info (PEP 770)."""
FOR_DEVELOPERS = ("bench", "browser", "docs", "dev")
"""Extras that bring tools, not parts of what users run."""
STATIC = "src/cornerforge/ext/explorer/static"
_REQUIREMENT = re.compile(r"([A-Za-z0-9][A-Za-z0-9._-]*)(\[[^\]]*\])?\s*((?:[<>=!~][^;@]*)?)")
_HEAD = re.compile(r"^((?:@[\w.-]+/)?[\w.-]+) (\d+\.\d+\.\d+\S*)\n\n", flags=re.MULTILINE)


def plain_name(name: str) -> str:
    """Give the one spelling of a package's name that indexes compare."""
    return re.sub(r"[-_.]+", "-", name).lower()


def pins(constraints: Path) -> dict[str, str]:
    """Read constraints.txt, or another file like it: versions by plain name."""
    lines = constraints.read_text(encoding="utf-8").splitlines()
    pairs = (line.split("==") for line in lines if line and not line.startswith("#"))
    return {plain_name(name): version for name, version in pairs}


def requirements(project: dict[str, Any]) -> dict[str, dict[str, str]]:
    """List what a `[project]` table requires: by plain name, the allowed versions for each extra; "" is no extra.

    Raises:
        ValueError: A requirement is written in a way that this does not read (a marker, an address).
    """
    found: dict[str, dict[str, str]] = {}
    for extra, lines in {"": project["dependencies"], **project["optional-dependencies"]}.items():
        for line in lines:
            match = _REQUIREMENT.fullmatch(line)
            if match is None:
                raise ValueError(f"{line!r} of pyproject.toml: supply/sbom.py cannot read that; teach it.")
            if plain_name(match[1]) != plain_name(project["name"]):
                found.setdefault(plain_name(match[1]), {})[extra] = match[3]
    return found


def bundled(root: Path) -> dict[str, tuple[str, str]]:
    """List the packages whose code is in the explorer's page: version and licence by name; {} where it is not built."""
    texts = root / STATIC / "LICENSES.txt"
    if not texts.exists():
        return {}
    locked = json.loads((root / "web" / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    found = {}
    for name, version in _HEAD.findall(texts.read_text(encoding="utf-8")):
        of_lock = locked[f"node_modules/{name}"]
        if of_lock["version"] != version:
            raise ValueError(f"The page holds {name} {version}, web/package-lock.json {of_lock['version']}: make web")
        found[name] = (version, of_lock["license"])
    return found


def bill_of_materials(root: Path, when: int) -> dict[str, Any]:
    """Make the bill of the project in a folder, as of a time [s since 1970]; the same twice for the same files."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    tested = pins(root / "constraints.txt")
    ours = f"pkg:pypi/{project['name']}@{project['version']}"
    inside: list[dict[str, Any]] = [
        {
            "type": "library",
            "bom-ref": f"pkg:npm/{name.replace('@', '%40')}@{version}",
            "name": name,
            "version": version,
            "description": "Its code is in the explorer's page, which the wheel holds.",
            "scope": "optional",
            "licenses": [{"license": {"id": licence}}],
            "purl": f"pkg:npm/{name.replace('@', '%40')}@{version}",
        }
        for name, (version, licence) in sorted(bundled(root).items())
    ]
    inside.append(
        {
            "type": "data",
            "bom-ref": "pkg:github/esmini/esmini",
            "name": "e6mini.xodr",
            "description": "The road e6mini, which the wheel holds, is made of it.",
            "licenses": [{"license": {"id": "MPL-2.0"}}],
            "purl": "pkg:github/esmini/esmini",
        }
    )
    required: list[dict[str, Any]] = [
        {
            "type": "library",
            "bom-ref": f"pkg:pypi/{name}",
            "name": name,
            "description": "Required, not in the wheel; its version is chosen where the wheel is installed.",
            "scope": "required" if "" in wanted else "optional",
            "purl": f"pkg:pypi/{name}",
            "properties": [
                *(
                    {"name": f"cornerforge:requires:{extra}" if extra else "cornerforge:requires", "value": versions}
                    for extra, versions in sorted(wanted.items())
                ),
                *([{"name": "cornerforge:tested-with", "value": tested[name]}] if name in tested else []),
            ],
        }
        for name, wanted in sorted(requirements(project).items())
        if not wanted.keys() <= {*FOR_DEVELOPERS}
    ]
    bill: dict[str, Any] = {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "timestamp": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(when)),
            "lifecycles": [{"phase": "build"}],
            "component": {
                "type": "application",
                "bom-ref": ours,
                "name": project["name"],
                "version": project["version"],
                "description": project["description"],
                "licenses": [{"license": {"id": project["license"]}}],
                "purl": ours,
            },
        },
        "components": [*inside, *required],
        "dependencies": [{"ref": ours, "dependsOn": [one["bom-ref"] for one in [*inside, *required]]}],
        "compositions": [
            {"aggregate": "complete", "assemblies": [ours]},
            {"aggregate": "incomplete", "dependencies": [one["bom-ref"] for one in required]},
        ],
    }
    bill["serialNumber"] = f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, json.dumps(bill, sort_keys=True))}"
    return bill


def bom_text(bill: dict[str, Any]) -> bytes:
    """Write a bill down."""
    return (json.dumps(bill, indent=2, ensure_ascii=False) + "\n").encode()
