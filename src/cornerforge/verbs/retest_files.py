"""JUnit XML of `retest`, for machines that run tests."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from cornerforge._files import writing
from cornerforge.results.retest import Retested, RetestedCase

__all__ = ["write_junit"]

_TAGS = {"new-crash": "failure", "failed": "error", "still-crashing": "skipped", "rounded": "skipped"}


def _found(one: RetestedCase) -> str | None:
    """Name the worst of what became of a case; None: the AV does not crash in it."""
    names = {"new": "new-crash", "failed": "failed", "still crashing": "still-crashing", "rounded": "rounded"}
    return next((name for kind, name in names.items() if kind in (one.recorded, one.reacting)), None)


def _words(one: RetestedCase) -> str:
    reacting = "" if one.reacting is None else f"; others who react: {one.reacting}"
    told = one.failure or one.words
    happened = "" if told is None else f" {told.rstrip('.')}."
    rounded = " (the same AV: rounding of its script, ADR 40)" if one.recorded == "rounded" else ""
    return f"Case {one.case}: others as recorded: {one.recorded}{rounded}{reacting}.{happened}"


def write_junit(file: Path, result: Retested) -> None:
    """Write a test for each case: new crashes fail; those that go on are skipped, so that they do not hide new ones.

    Raises:
        OutputError: The file cannot be written.
    """
    kinds = [_found(one) for one in result.each]
    suite = ElementTree.Element(
        "testsuite", name=f"cornerforge retest {result.library}", tests=str(len(kinds)),
        failures=str(kinds.count("new-crash")), skipped=str(sum(_TAGS.get(kind or "") == "skipped" for kind in kinds)),
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
