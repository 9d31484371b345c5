"""A case as a strip of snapshots for a paper: the road from above at some moments, all to one scale."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

from cornerforge.errors import InputError
from cornerforge.ext.pictures.printing import POINTS, printed
from cornerforge.ext.pictures.road_view import PRINT, across, draw_moment
from cornerforge.report.moments import Moments
from cornerforge.types import FRAME_S, Scenario

__all__ = ["MOST", "key_moments", "strip_figure"]

MOST = 12
"""Most snapshots of a strip."""
_FEWEST, _NEAR_S = 4, 0.25
_BRAKES_MPS2 = -1.0
_BEHIND_M, _AHEAD_M, _ROOM_M, _LONGEST_M = -12.0, 16.0, 9.0, 110.0
_MARGIN_M = 0.6
_SITE_M = 50.0
"""Width of a snapshot of a site [m]."""
_CAPTION_IN, _GAP_IN, _SCALE_IN = 0.17, 0.05, 0.2
_PANELS_IN = 3.6
"""Width above which snapshots stand in two columns [in]."""


def key_moments(scenario: Scenario, known: Mapping[float, str]) -> dict[float, str]:
    """Choose the moments that explain a crash: known moments, the AV's first braking, the contact, and some between.

    Args:
        scenario: The crash.
        known: What happens at a time before the contact [s], such as the begin of the manoeuvre.

    Returns:
        Seconds before the contact, falling, and what happens then ("" for a moment between two others). Of two moments
        less than 0.25 s apart, the one nearer to the contact also says what happens at the other.
    """
    moments = Moments(scenario)
    if moments.contact is None:
        raise InputError(f"Test {scenario.case_id} holds no crash of the AV; name moments by --times.")
    found = {round(before, 1): what for before, what in known.items() if 0.0 < before <= moments.contact}
    since = max(found, default=3.0)
    brakes = _first_braking(scenario, moments.contact, since)
    if brakes is not None:
        found[brakes] = "; ".join(filter(None, (found.get(brakes), "the AV brakes")))
    kept: dict[float, str] = {}
    for before in sorted({**found, 0.0: "contact"}, reverse=True):
        what = "contact" if before == 0.0 else found[before]
        previous = min(kept, default=math.inf)
        if previous - before < _NEAR_S:
            what = f"{kept.pop(previous)}; {what}"
        kept[before] = what
    if len(kept) == 1:
        kept[round(min(3.0, moments.contact), 1)] = ""
    while len(kept) < _FEWEST:
        falling = sorted(kept, reverse=True)
        wide, first = max((a - b, a) for a, b in itertools.pairwise(falling))
        if wide < 2.0 * FRAME_S:
            break
        kept[round(first - 0.5 * wide, 1)] = ""
    return {before: kept[before] for before in sorted(kept, reverse=True)}


def _first_braking(scenario: Scenario, contact: float, since: float) -> float | None:
    """Seconds before the contact at which the AV begins to brake, not before `since`; None if it does not."""
    first, last = (round((contact - before) / FRAME_S) for before in (since, 0.0))
    held = scenario.acceleration[max(first, 0) : last, 0]
    for frame, value in enumerate(held, start=max(first, 0)):
        if value <= _BRAKES_MPS2:
            return round(contact - frame * FRAME_S, 1)
    return None


def strip_figure(scenario: Scenario, times_before: Mapping[float, str] | Sequence[float], *, width: float) -> Any:
    """Draw a case at some moments, one below the other (in two columns on a page's width).

    Args:
        scenario: The case.
        times_before: Seconds before the contact (before the recording's end where there is none), and what happens
            then.
        width: Width of the figure [in].

    Returns:
        A figure of matplotlib; a metre is as long everywhere in it. `printing.print_of` makes a file of it.

    Raises:
        InputError: A moment lies outside the recording, or there are none or too many.
    """
    from matplotlib.figure import Figure

    moments = Moments(scenario)
    said = dict(times_before) if isinstance(times_before, Mapping) else dict.fromkeys(times_before, "")
    if not 1 <= len(said) <= MOST:
        raise InputError(f"{len(said)} moments; a strip has 1 to {MOST}.")
    for before in said:
        if not (0.0 <= before <= moments.end + 1e-6 or -1e-6 <= moments.end - before <= moments.last + 1e-6):
            raise InputError(
                f"The moment {-before:g} s is outside the recording, which goes from {-moments.end:.1f} to "
                f"{moments.last - moments.end:.1f} s; 0 is the contact."
            )
    with printed():
        columns = 1 if width <= _PANELS_IN else 2
        rows = math.ceil(len(said) / columns)
        wide = (width - (columns - 1) * 2 * _GAP_IN) / columns
        span = _span(moments, list(said))
        inches_per_metre = wide / (span[1] - span[0])
        odd = scenario.odd
        # A label beside a vehicle in an outer lane ends beyond the road.
        margin = max(_MARGIN_M, 1.4 * POINTS / 72.0 / inches_per_metre - 0.5)
        road = (across(odd, span[1] - span[0]) + 2 * margin) * inches_per_metre
        row = _CAPTION_IN + road + _GAP_IN
        height = rows * row + _SCALE_IN
        drawing = Figure(figsize=(width, height))
        for place, (before, what) in enumerate(said.items()):
            left = (place // rows) * (wide + 2 * _GAP_IN)
            top = height - (place % rows) * row
            axes = drawing.add_axes((left / width, (top - _CAPTION_IN - road) / height, wide / width, road / height))
            draw_moment(
                axes, moments, moments.end - before, span, PRINT, points_per_metre=72.0 * inches_per_metre,
                margin=(margin, margin),
            )  # fmt: skip
            drawing.text(
                (left + 0.02) / width, (top - 0.5 * _CAPTION_IN) / height, _caption(place, before, what), va="center",
                fontsize=POINTS,
            )  # fmt: skip
        _draw_scale(drawing, inches_per_metre)
    return drawing


def _caption(place: int, before: float, what: str) -> str:
    when = "0 s" if before == 0.0 else f"{-before:+.1f} s".replace("-", "−")
    return f"({chr(ord('a') + place)}) {when}" + (f": {what}" if what else "")


def _span(moments: Moments, times_before: Sequence[float]) -> tuple[float, float]:
    """How far all snapshots reach from the AV, behind and ahead [m], so that its partner is in them."""
    low, high = _BEHIND_M, _AHEAD_M
    if moments.scenario.odd.site is not None:
        return -0.5 * _SITE_M, 0.5 * _SITE_M
    if moments.partner is not None:
        for before in times_before:
            moment = moments.at(moments.end - before)
            ahead = float(moment.place[moments.partner]) - float(moment.place[0])
            if not math.isnan(ahead):
                reach = 0.5 * float(moments.scenario.length[moments.partner]) + _ROOM_M
                low, high = min(low, ahead - reach), max(high, ahead + reach)
    wide = max(high - low, 50.0)
    low -= 0.5 * (wide - (high - low))
    return (low, low + wide) if wide <= _LONGEST_M else (max(low, -0.5 * _LONGEST_M), min(low + wide, 0.5 * _LONGEST_M))


def _draw_scale(drawing: Any, inches_per_metre: float) -> None:
    width, height = drawing.get_size_inches()
    from matplotlib.lines import Line2D

    y, right = 0.5 * _SCALE_IN / height, 1.0 - 0.05 / width
    left = right - 10.0 * inches_per_metre / width
    drawing.add_artist(Line2D([left, right], [y, y], color="black", linewidth=1.5, solid_capstyle="butt"))
    drawing.text(left - 0.05 / width, y, "10 m", ha="right", va="center", fontsize=POINTS)
