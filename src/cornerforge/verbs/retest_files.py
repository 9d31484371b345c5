"""JUnit XML of `retest` and `suite run`, for machines that run tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from cornerforge._files import writing
from cornerforge.results.retest import Retested, RetestedCase

__all__ = ["write_junit", "write_tests"]

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
    tests = []
    for one in result.each:
        kind = _found(one)
        tests.append((f"case {one.case}", None if kind is None else _TAGS[kind], _words(one)))
    write_tests(file, f"cornerforge retest {result.library}", result.av, tests, result.seconds)


def write_tests(
    file: Path, name: str, of: str, tests: Sequence[tuple[str, str | None, str]], seconds: float
) -> None:  # fmt: skip
    """Write tests `of` an AV: name, what became of it ("failure", "error", "skipped"; None: it passed), words for that.

    Raises:
        OutputError: The file cannot be written.
    """
    tags = [tag for _, tag, _ in tests]
    suite = ElementTree.Element(
        "testsuite", name=name, tests=str(len(tests)), failures=str(tags.count("failure")),
        skipped=str(tags.count("skipped")), errors=str(tags.count("error")), time=str(seconds),
    )  # fmt: skip
    for test, tag, words in tests:
        case = ElementTree.SubElement(suite, "testcase", classname=of, name=test)
        if tag is not None:
            ElementTree.SubElement(case, tag, message=words)
    tree = ElementTree.ElementTree(suite)
    ElementTree.indent(tree)
    with writing(file) as part:
        tree.write(part, encoding="utf-8", xml_declaration=True)
