"""Writes docs/licences.md, which lists the licences of all that comes with cornerforge; see `make licences`.

python supply/licences.py REPORT: what `pip install --dry-run --no-deps --report` says of constraints.txt.
"""

from __future__ import annotations

import importlib.metadata
import json
import sys
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from packaging.requirements import Requirement
from sbom import FOR_DEVELOPERS, bundled, pins, plain_name

__all__ = ["ALLOWED", "PAGE", "Facts", "Row", "allowed", "brings", "facts_installed", "page", "rows_of", "table_rows"]

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "licences.md"
ALLOWED = frozenset(
    {"0BSD", "Apache-2.0", "BSD", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "CC0-1.0", "ISC", "MIT", "MIT-0",
     "MIT-CMU", "MPL-2.0", "PSF-2.0", "Zlib"}
)  # fmt: skip
"""Licences that ask for no more than their text and notices, and MPL-2.0, whose own files stay open. BSD: some BSD."""
TOOLS_ONLY = frozenset({"GPL-2.0-only", "LGPL-2.1"})
"""Allowed besides for tools of developers, which are called and not given on."""
PLAIN = {
    "Apache 2.0": "Apache-2.0",
    "Apache License, Version 2.0": "Apache-2.0",
    "Apache Software License": "Apache-2.0",
    "3-Clause BSD License": "BSD-3-Clause",
    "BSD 3-Clause License": "BSD-3-Clause",
    "BSD 2-Clause License": "BSD-2-Clause",
    "BSD License": "BSD",
    "ISC License": "ISC",
    "ISC License (ISCL)": "ISC",
    "LGPL v2.1": "LGPL-2.1",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
}
"""How metadata without an SPDX expression say it, in the field License or in a classifier."""
NOTES = {
    "imageio-ffmpeg": "its wheel holds a build of ffmpeg, a program under the GPL; so `video` is not part of `all`",
    "numpy, scipy": "their wheels hold OpenBLAS and GNU Fortran's library (GPL with GCC's exception for its users)",
    "torch": "on Linux, PyPI's own build brings NVIDIA's libraries under NVIDIA's licence; a CPU build does not",
}
# The extras are worked out for the platform that the tests run on, whatever machine this runs on.
_PLACE = {
    "implementation_name": "cpython", "os_name": "posix", "platform_machine": "x86_64", "platform_system": "Linux",
    "platform_python_implementation": "CPython", "python_full_version": "3.11.0", "python_version": "3.11",
    "sys_platform": "linux",
}  # fmt: skip


class Facts(NamedTuple):
    """What a package says of itself; `requires` as in its metadata."""

    name: str
    version: str
    licence: str
    requires: tuple[str, ...]


class Row(NamedTuple):
    """A line of the table; `extras` names what brings the package, "core" if it always comes."""

    name: str
    version: str
    licence: str
    extras: tuple[str, ...]


def _licence(expression: str | None, field: str | None, classifiers: Iterable[str]) -> str:
    """Give the SPDX expression, or what else the metadata say, in one spelling; "not said" if nothing."""
    said = [
        expression,
        (field or "").strip(),
        *(one.rpartition(" :: ")[2] for one in classifiers if one.startswith("License")),
    ]
    for one in said:
        text = PLAIN.get(one or "", one or "")
        if text and (expression or allowed(text, tool=True)):
            return text
    return "not said"


def facts_of_report(report: Mapping[str, list[dict[str, dict[str, object]]]]) -> dict[str, Facts]:
    """Read pip's report."""
    found = {}
    for one in report["install"]:
        about: dict[str, object] = one["metadata"]
        texts = {key: value if isinstance(value, list) else [] for key, value in about.items()}
        name, field = str(about["name"]), about.get("license")
        licence = _licence(
            str(about["license_expression"]) if "license_expression" in about else None,
            str(field) if field else None, texts.get("classifier", []),
        )  # fmt: skip
        version = str(about["version"]).partition("+")[0]
        found[plain_name(name)] = Facts(name, version, licence, tuple(texts.get("requires_dist", [])))
    return found


def _field(about: importlib.metadata.PackageMetadata, name: str) -> str | None:
    return about[name] if name in about else None  # noqa: SIM401  (its type has no get)


def facts_installed(names: Iterable[str]) -> dict[str, Facts]:
    """Read the metadata of those packages that are installed here."""
    found = {}
    for name in names:
        try:
            about = importlib.metadata.metadata(name)
        except importlib.metadata.PackageNotFoundError:
            continue
        licence = _licence(
            _field(about, "License-Expression"), _field(about, "License"), about.get_all("Classifier") or []
        )
        version = about["Version"].partition("+")[0]
        found[plain_name(name)] = Facts(about["Name"], version, licence, tuple(about.get_all("Requires-Dist") or []))
    return found


def brings(facts: Mapping[str, Facts], wanted: Iterable[str]) -> set[str] | None:
    """List by plain name what requirements bring with all that they require; None where some of it is unknown here."""
    found: set[str] = set()
    seen: set[str] = set()
    waiting = [(Requirement(line), "") for line in wanted]
    while waiting:
        requirement, extra = waiting.pop()
        if requirement.marker and not requirement.marker.evaluate({**_PLACE, "extra": extra}):
            continue
        name = plain_name(requirement.name)
        if name not in facts:
            return None
        found.add(name)
        for one in ("", *requirement.extras):
            if f"{name}[{one}]" not in seen:
                seen.add(f"{name}[{one}]")
                waiting += [(Requirement(line), one) for line in facts[name].requires]
    return found


def rows_of(facts: Mapping[str, Facts]) -> tuple[list[Row], list[Row], set[str]]:
    """Make the rows of what users get and of what only developers get, and name the extras that are unknown here."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    optional: dict[str, list[str]] = project["optional-dependencies"]
    of_extras = (f'{line}; extra == "{extra}"' for extra, lines in optional.items() for line in lines)
    ours = Facts("cornerforge", project["version"], project["license"], (*project["dependencies"], *of_extras))
    all_facts = {**facts, "cornerforge": ours}
    core = brings(all_facts, ["cornerforge"]) or set()
    closures = {extra: brings(all_facts, [f"cornerforge[{extra}]"]) for extra in optional if extra != "all"}
    unknown = {extra for extra, closure in closures.items() if closure is None}

    def row(name: str, of: Iterable[str]) -> Row:
        found = ("core",) if name in core else tuple(extra for extra in of if name in (closures[extra] or ()))
        return Row(*facts[name][:3], found)

    users = [extra for extra in closures if extra not in FOR_DEVELOPERS]
    rows = [row(name, users) for name in sorted(facts)]
    tools = [row(name, FOR_DEVELOPERS) for name in sorted(facts)]
    return [one for one in rows if one.extras], [t for r, t in zip(rows, tools, strict=True) if not r.extras], unknown


def allowed(licence: str, *, tool: bool = False) -> bool:
    """Say whether a licence is on the list: all parts of it, or all of one of its alternatives."""
    names = ALLOWED | TOOLS_ONLY if tool else ALLOWED
    alternatives = (alternative.split(" AND ") for alternative in licence.split(" OR "))
    return any(all(part.removesuffix(" WITH LLVM-exception") in names for part in parts) for parts in alternatives)


def page(users: Iterable[Row], tools: Iterable[Row]) -> str:
    """Write the page."""

    def table(rows: Iterable[Row]) -> str:
        lines = [f"| {one.name} | {one.version} | {one.licence} | {', '.join(one.extras)} |" for one in rows]
        return "\n".join(["| package | version | licence | with |", "| --- | --- | --- | --- |", *lines])

    inside = "\n".join(
        f"| {name} | {version} | {licence} |" for name, (version, licence) in sorted(bundled(ROOT).items())
    )
    notes = "\n".join(f"- {name}: {note}." for name, note in NOTES.items())
    return f"""# Licences

cornerforge is under [Apache-2.0](../LICENSE). This page lists what comes with it. It is made by `make licences` from
what the packages say of themselves, in the versions of [constraints.txt](../constraints.txt), on Linux and Python 3.11;
on other systems a few small packages more or fewer come. Names are those of SPDX; *BSD* is said by packages that do not
say which.

A test fails if the page is older than the versions, or if a licence is none of these: {", ".join(sorted(ALLOWED))};
for tools of developers also {", ".join(sorted(TOOLS_ONLY))}.

## Packages that pip installs beside it

They are not in the wheel: pip gets each from its makers, with its licence. *core* always comes, others with an extra.

{table(users)}

A package's own wheel may hold code of others again, under licences that it says itself:

{notes}

## Code of others in the wheel

The explorer's page, built by `make web`, holds code of these packages. Their licences and notices lie beside it in the
wheel, `cornerforge/ext/explorer/static/LICENSES.txt`; the explorer shows them at `/assets/LICENSES.txt`.

| package | version | licence |
| --- | --- | --- |
{inside}

The road `e6mini` is made of esmini's road of this name, which is under MPL-2.0, and so is
`cornerforge/road/e6mini.json`; where it comes from and its licence stand in `e6mini.LICENSE.txt` beside it.

Pages with charts that cornerforge writes hold plotly's script, whose licence (MIT) stands at its head.

## Tools of developers

They are installed by `make` for tests, checks and documentation. No user gets them. Tools in environments of their own
(`supply/requirements.txt`, `tests/interchange/external/`), and those that build the explorer's page, are not listed.

{table(tools)}
"""


def table_rows(text: str) -> list[Row]:
    """Read the rows of the page's tables of four columns back."""
    cells = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("| ")
    ]
    return [
        Row(one[0], one[1], one[2], tuple(one[3].split(", ")))
        for one in cells
        if len(one) == 4 and one[0] not in ("package", "---")
    ]


if __name__ == "__main__":
    found = facts_of_report(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
    missing = sorted(pins(ROOT / "constraints.txt").keys() - found.keys())
    if missing or not bundled(ROOT):
        sys.exit(
            f"Not in the report: {', '.join(missing)}" if missing else "The explorer's page is not built: make web"
        )
    of_users, of_developers, unknown = rows_of(found)
    idle = [one.name for one in of_developers if not one.extras]
    if unknown or idle:
        sys.exit(
            f"constraints.txt lacks a version for {', '.join(sorted(unknown))}, or has idle ones: {', '.join(idle)}"
        )
    PAGE.write_text(page(of_users, of_developers), encoding="utf-8")
