"""The fit report of `site fit`: what each law rests on, what the data have, and how well the laws fit to it."""

from __future__ import annotations

from html import escape
from pathlib import Path

import numpy as np

from cornerforge._files import writing
from cornerforge.ext.calibrate.site_data import SITE_FILES
from cornerforge.ext.calibrate.site_people import STATES, EncounterFit
from cornerforge.report.drawing import BLUE, ORANGE, inline, new_figure, page, png_of, table
from cornerforge.results.site_laws import SiteFitted

__all__ = ["write_site_page"]


def write_site_page(result: SiteFitted, encounters: EncounterFit | None, path: Path) -> None:
    """Write the report as one HTML page that needs nothing else; the same fit gives the same bytes.

    Raises:
        OutputError: The page cannot be written there.
    """
    head = ["law", "value", "95 % interval, or span of sources", "n", "rests on", "source", "leaves out"]
    credits = [[file.name, file.what, file.credit] for file in SITE_FILES]
    facts = [
        [
            one.fact, f"{one.found:g} {one.unit}", _span(one.interval95), f"{one.n:,}",
            "" if one.laws is None else f"{one.laws:g}", "" if one.stated is None else f"{one.stated:g}", one.source,
        ]
        for one in result.facts
    ]  # fmt: skip
    parts = [
        "<h1>Laws of drivers and people at a site</h1>",
        "<h2>What to know</h2><ul>" + "".join(f"<li>{escape(note)}</li>" for note in result.notes) + "</ul>",
        "<h2>The laws</h2>" + table(head, _law_cells(result)),
        "<h2>What the data have</h2>"
        + table(["fact", "found", "95 % interval", "n", "by the laws", "stated of the whole file", "source"], facts),
        "" if encounters is None else "<h2>Who goes first</h2>" + _encounters(encounters),
        "<h2>Data</h2>" + table(["file", "what", "whose"], credits),
    ]
    with writing(path, "the fit report") as part:
        part.write_text(page("Laws at a site", "".join(parts)), encoding="utf-8")


def _law_cells(result: SiteFitted) -> list[list[str]]:
    """Give the rows of the laws as texts: name, value, interval or span, n, what it rests on, source, doubts."""
    return [
        [
            law.name, f"{', '.join(f'{one:g}' for one in law.values)} {law.unit}".strip(),
            _span(law.interval95 or law.span), f"{law.n:,} of {law.groups}" if law.n else "", law.rests_on, law.source,
            law.leaves_out,
        ]
        for law in result.laws
    ]  # fmt: skip


def _span(ends: tuple[float, float] | None) -> str:
    return "" if ends is None else f"{ends[0]:g} to {ends[1]:g}"


def _encounters(fit: EncounterFit) -> str:
    """Draw seen and expected encroachment times by state of the signal; negative: the vehicle goes first."""
    drawing, panels = new_figure(1, 3, 11.0, 3.2)
    time = np.concatenate([-np.arange(10, 0, -1), np.arange(1, 11)])
    for panel, name, seen, chance in zip(panels, STATES, fit.counted, fit.expected, strict=True):
        for counts, draw in ((seen, True), (chance * seen.sum(), False)):
            both = np.concatenate([(counts[0] + counts[1])[::-1], counts[2]])
            if draw:
                panel.bar(time, both, color=BLUE, alpha=0.5, label="seen")
            else:
                panel.plot(time, both, "o-", color=ORANGE, markersize=3, label="laws")
        panel.set_title(f"{name}, {seen.sum():.0f} encounters", fontsize=9)
        panel.set_xlabel("encroachment time [s]", fontsize=9)
    panels[0].legend(fontsize=8)
    return inline(
        png_of(drawing), "Time from one to the other at the conflict point; negative: the vehicle goes first."
    )
