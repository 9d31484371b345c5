"""A case that plays inside a notebook: a page of its own in a frame, which asks nothing from the network."""

from __future__ import annotations

from html import escape
from typing import Any

from cornerforge.analysis.in_words import what_happened
from cornerforge.errors import MissingExtraError, printable
from cornerforge.report import text
from cornerforge.report.cases import case_data
from cornerforge.report.rendering import PLAYER, content_policy, environment, template
from cornerforge.types import Scenario
from cornerforge.verbs.drive_case import told

__all__ = ["player"]

HEIGHT, SITE_HEIGHT = 350, 560
"""Of the frame, on a road and at a site, of which more is seen across [CSS px]."""


def player(case_id: str, scenario: Scenario) -> str:
    """Write a case as HTML: the picture and the button of the report's first screen.

    Args:
        case_id: Name of the case.
        scenario: The case.

    Returns:
        A frame with the page; without jinja2 what to install.
    """
    crashed = scenario.partner is not None
    title = text.capital(text.plain(text.sentence(what_happened(scenario)))) if crashed else "The AV does not crash"
    # No vehicle is shown as one that an adversary drives: a recording alone does not say whether one did.
    case: dict[str, Any] = case_data(case_id, scenario) | {"title": title, "critical": [], "action": [], "p_nde": []}
    script = template(PLAYER)
    try:
        from markupsafe import Markup

        made = environment().get_template("case.html.j2")
        page: str = made.render(
            case=case,
            told=printable(told(scenario)[2].partition(" (")[0]),
            style=Markup(template("report.css")),
            script=Markup(script),
            policy=content_policy([script]),
        )
    except (ImportError, MissingExtraError):
        return f"<p>{escape(str(MissingExtraError('jinja2', 'report')))}</p>"
    height = HEIGHT if scenario.odd.site is None else SITE_HEIGHT
    frame = f'sandbox="allow-scripts" width="100%" height="{height}" style="border:0"'
    return f'<iframe title="{escape(printable(title))}" {frame} srcdoc="{escape(page)}"></iframe>'
