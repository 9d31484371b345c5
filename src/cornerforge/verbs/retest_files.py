"""Files of `retest` for machines that run tests: JUnit XML, and SARIF 2.1.0 (OASIS)."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from cornerforge._files import writing
from cornerforge.experiment.output import version, write_json
from cornerforge.results.retest import Retested, RetestedCase

__all__ = ["write_junit", "write_sarif"]

_SCHEMA = "https://raw.githubusercontent.com/oasis-tcs/sarif-spec/main/sarif-2.1/schema/sarif-schema-2.1.0.json"
_RULES = {
    "new-crash": ("error", "The AV crashes in a case in which the baseline does not."),
    "still-crashing": ("warning", "The AV crashes in a case in which the baseline crashes too."),
    "failed": ("error", "The AV raised, hung or gave no usable answer in a case."),
}
_TAGS = {"new-crash": "failure", "failed": "error", "still-crashing": "skipped"}


def _found(one: RetestedCase) -> str | None:
    """Name the worst of what became of a case; None: the AV does not crash in it."""
    names = {"new": "new-crash", "failed": "failed", "still crashing": "still-crashing"}
    return next((name for kind, name in names.items() if kind in (one.recorded, one.reacting)), None)


def _words(one: RetestedCase) -> str:
    reacting = "" if one.reacting is None else f"; others who react: {one.reacting}"
    told = one.failure or one.words
    happened = "" if told is None else f" {told.rstrip('.')}."
    return f"Case {one.case}: others as recorded: {one.recorded}{reacting}.{happened}"


def write_junit(file: Path, result: Retested) -> None:
    """Write a test for each case: new crashes fail; those that go on are skipped, so that they do not hide new ones.

    Raises:
        OutputError: The file cannot be written.
    """
    kinds = [_found(one) for one in result.each]
    suite = ElementTree.Element(
        "testsuite", name=f"cornerforge retest {result.library}", tests=str(len(kinds)),
        failures=str(kinds.count("new-crash")), skipped=str(kinds.count("still-crashing")),
        errors=str(kinds.count("failed")),
        time=str(result.seconds),
    )  # fmt: skip
    for one, kind in zip(result.each, kinds, strict=True):
        case = ElementTree.SubElement(suite, "testcase", classname=result.av, name=f"case {one.case}")
        if kind is not None:
            ElementTree.SubElement(case, _TAGS[kind], message=_words(one))
    tree = ElementTree.ElementTree(suite)
    ElementTree.indent(tree)
    with writing(file) as part:
        tree.write(part, encoding="utf-8", xml_declaration=True)


def write_sarif(file: Path, result: Retested) -> None:
    """Write a result for each case in which the AV crashes.

    Raises:
        OutputError: The file cannot be written.
    """
    results: list[dict[str, Any]] = []
    for one in result.each:
        kind = _found(one)
        if kind is not None:
            place = {"physicalLocation": {"artifactLocation": {"uri": Path(result.library).as_posix()}}}
            results.append(
                {
                    "ruleId": kind,
                    "level": _RULES[kind][0],
                    "message": {"text": f"{result.av}: {_words(one)}"},
                    "locations": [place | {"logicalLocations": [{"name": one.case, "kind": "member"}]}],
                    "partialFingerprints": {"case/v1": one.case},
                }
            )
    rules = [{"id": name, "shortDescription": {"text": text}} for name, (_, text) in _RULES.items()]
    driver = {"name": "cornerforge", "version": version(), "rules": rules}
    write_json(
        file, {"$schema": _SCHEMA, "version": "2.1.0", "runs": [{"tool": {"driver": driver}, "results": results}]}
    )
