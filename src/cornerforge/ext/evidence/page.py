"""`report --evidence`: one page and one JSON file that answer an assessor's questions from stored results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cornerforge.experiment.output import write_json
from cornerforge.ext.evidence.answers import evidence_of
from cornerforge.ext.evidence.material import gather, read_beside
from cornerforge.report import text
from cornerforge.report.artefacts import Artefacts
from cornerforge.report.page import known_of
from cornerforge.report.rendering import content_policy, environment, template, write_page
from cornerforge.results import as_json

__all__ = ["write_evidence"]


def write_evidence(artefacts: Artefacts, beside: Sequence[Path]) -> tuple[Path, Path]:
    """Write `evidence.html` and `evidence.json` beside the page of a run or library.

    Args:
        artefacts: What the page shows.
        beside: Files or folders of other results of the same AV.

    Returns:
        Both files, the page first.

    Raises:
        InputError: A place holds no such result, or one of another AV or traffic model.
        FileFormatError: A file is missing or damaged.
        OutputError: A file cannot be written.
    """
    found = evidence_of(gather(artefacts, known_of(artefacts), read_beside(beside)))
    data, page = artefacts.out / "evidence.json", artefacts.out / "evidence.html"
    write_json(data, as_json(found))
    from markupsafe import Markup

    pages = environment()
    pages.filters["per_million"] = lambda value: text.rate(value, 2)
    rendered = pages.get_template("evidence.html.j2").render(
        e=found, command=artefacts.command, style=Markup(template("report.css")), policy=content_policy([])
    )
    return write_page(str(rendered), page), data
