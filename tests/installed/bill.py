"""What `make wheel` checks of the bill of materials: python tests/installed/bill.py DIST.

The bill in the wheel keeps to CycloneDX's own schema, says of requirements what the wheel's metadata say, and of the
page's scripts what lies in the wheel. A copy is laid beside the wheel.
"""

from __future__ import annotations

import email
import json
import re
import sys
import zipfile
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

FOR_DEVELOPERS = ("bench", "browser", "docs", "dev")


def said_by_metadata(text: str) -> set[tuple[str, str, SpecifierSet]]:
    """Requirements of a wheel's METADATA: name, extra ("" for none) and allowed versions."""
    found = set()
    for line in email.message_from_string(text).get_all("Requires-Dist") or []:
        one = Requirement(line)
        extras = re.findall(r'extra == "([\w-]+)"', str(one.marker or "")) or [""]
        if one.name != "cornerforge" and extras[0] not in FOR_DEVELOPERS:
            found.add((one.name.lower(), extras[0], one.specifier))
    return found


def said_by_bill(bill: dict[str, Any]) -> set[tuple[str, str, SpecifierSet]]:
    """The same of a bill of materials."""
    return {
        (
            one["name"],
            property["name"].removeprefix("cornerforge:requires").removeprefix(":"),
            SpecifierSet(property["value"]),
        )
        for one in bill["components"]
        for property in one.get("properties", [])
        if property["name"].startswith("cornerforge:requires")
    }


def faults(files: dict[str, bytes]) -> list[str]:
    """What is wrong with the bill in a wheel, whose files are given by name."""
    from cyclonedx.schema import SchemaVersion  # of the environment of `make audit`
    from cyclonedx.validation.json import JsonStrictValidator

    named = {
        name.partition(".dist-info/")[2]: content.decode() for name, content in files.items() if ".dist-info/" in name
    }
    text = named["sboms/cornerforge.cdx.json"]
    wrong = JsonStrictValidator(SchemaVersion.V1_6).validate_str(text)
    if wrong is not None:
        return [f"the bill breaks CycloneDX 1.6: {' '.join(str(wrong).split())[:300]}"]
    bill = json.loads(text)
    differing = said_by_metadata(named["METADATA"]) ^ said_by_bill(bill)
    found = [f"bill and metadata differ: {name} {extra} {versions}" for name, extra, versions in differing]
    licences = files.get("cornerforge/ext/explorer/static/LICENSES.txt", b"").decode()
    for one in bill["components"]:
        if one["purl"].startswith("pkg:npm/") and f"{one['name']} {one['version']}\n" not in licences:
            found.append(f"the wheel lacks the licence of {one['name']} {one['version']}")
    if licences and not any(one["purl"].startswith("pkg:npm/") for one in bill["components"]):
        found.append("the bill names no script of the explorer's page")
    return found


if __name__ == "__main__":
    (wheel,) = Path(sys.argv[1]).glob("*.whl")
    with zipfile.ZipFile(wheel) as opened:
        content = {name: opened.read(name) for name in opened.namelist()}
    found = faults(content)
    print("\n".join(found) or "The bill of materials is valid CycloneDX 1.6, and says what the wheel's metadata say.")
    bill = next(content[name] for name in content if name.endswith("sboms/cornerforge.cdx.json"))
    wheel.with_suffix(".cdx.json").write_bytes(bill)
    sys.exit(bool(found))
