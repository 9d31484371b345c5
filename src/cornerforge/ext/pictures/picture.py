"""Pictures of a crash beside its way out, by matplotlib, and films; the same numbers give the same bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.avoidability import Avoidability
from cornerforge.analysis.in_words import avoidance_in_words, case_in_words
from cornerforge.errors import InputError
from cornerforge.experiment.output import check_new_file, writing
from cornerforge.ext.pictures.film import check_film, film
from cornerforge.ext.pictures.road_view import SCREEN, draw_moment
from cornerforge.geometry import Box
from cornerforge.report.drawing import BLUE, GREEN, GREY, ORANGE, check_matplotlib, new_figure, png_of, svg_of
from cornerforge.report.moments import Moments, corners_of
from cornerforge.report.surface import Mark, strokes, surface_of
from cornerforge.road.straight import along
from cornerforge.types import FRAME_S, Scenario
from cornerforge.work.progress import NO_PROGRESS, Progress

__all__ = ["avoidance_figure", "check_picture", "check_video", "save_picture", "write_picture", "write_video"]

_FORMATS = {".png": png_of, ".svg": svg_of}
_BEFORE_S, _LONGEST_BEFORE_S = 2.0, 6.0
_AHEAD_M = 30.0
_LINES: dict[Mark, tuple[str, float, Any]] = {
    "solid": ("black", 1.2, "-"), "broken": (GREY, 0.8, (0, (8, 6))), "wide": (GREY, 2.4, (0, (3, 3))),
    "barrier": ("#CC2936", 2.4, "-"), "hatch": (GREY, 1.2, "-"),
}  # fmt: skip
"""Colour, width [pt] and dashes of the lines on the road."""
_LABELS = {
    "unavoidable": "unavoidable once the manoeuvre had begun",
    "by braking": "avoidable by braking or accelerating",
    "by steering": "avoidable by steering",
    "by both": "avoidable by braking or accelerating, and by steering",
    "by combination": "avoidable only by both together",
    "undecided": "undecided",
}


def check_picture(path: Path) -> None:
    """Check, before long work, that a picture can be drawn and written there.

    Raises:
        InputError: The name ends neither in .png nor in .svg.
        OutputError: Something is there already, or its folder cannot be written.
        MissingExtraError: matplotlib is not installed.
    """
    if path.suffix.lower() not in _FORMATS:
        raise InputError(f"{path} ends neither in .png nor in .svg; name the picture with one of them.")
    check_new_file(path)
    check_matplotlib()


def check_video(path: Path) -> None:
    """Check, before long work, that a film can be made and written there.

    Raises:
        InputError: The name ends neither in .mp4 nor in .gif nor in .webm.
        OutputError: Something is there already, or its folder cannot be written.
        MissingExtraError: What makes it is not installed.
    """
    check_film(path)
    check_new_file(path)


def write_picture(scenario: Scenario, path: Path, answer: Avoidability) -> None:
    """Draw a crash of the AV: the road from above, speeds over time, and the latest way out, if there was one.

    Args:
        scenario: The crash.
        path: The new file.
        answer: Result of `way_out_of`.

    Raises:
        InputError: The scenario holds no crash of the AV.
        OutputError: The file cannot be written.
    """
    save_picture(avoidance_figure(scenario, answer), path)


def save_picture(drawing: Any, path: Path) -> None:
    """Save a matplotlib figure where `check_picture` has looked.

    Raises:
        OutputError: The file cannot be written.
    """
    content = _FORMATS[path.suffix.lower()](drawing)
    with writing(path) as part:
        part.write_bytes(content)


def write_video(
    scenario: Scenario, path: Path, answer: Avoidability | None, *, title: str, progress: Progress = NO_PROGRESS
) -> None:
    """Make a film of a case, with the latest way out, if there was one.

    Args:
        scenario: The case.
        path: The new file.
        answer: Result of `way_out_of`; None where the AV does not crash.
        title: The case's name.
        progress: Called with the progress.

    Raises:
        OutputError: The file cannot be written.
    """
    if answer is None or scenario.partner is None:
        sentence, way_out = "The AV does not crash.", None
    else:
        sentence = case_in_words(scenario, avoidance_in_words(answer.label, answer.latest_s))
        way_out = answer.witness
    film(
        scenario, path, title=title, sentence=sentence, way_out=way_out,
        progress=lambda done, total: progress("film", done, total),
    )  # fmt: skip


def avoidance_figure(scenario: Scenario, answer: Avoidability) -> Any:
    """Draw the recorded crash and the witness of its avoidability.

    The upper panel shows the road from above, to scale, at the moment of the contact, with the tracks before it in a
    frame that moves at the AV's mean recorded speed. The lower panel shows speeds over time, with the moments that
    matter.

    Args:
        scenario: The recording.
        answer: The answer of `analysis.avoidability` for it; without a witness only the recording is drawn.

    Returns:
        A matplotlib figure; `report.drawing.png_of` and `svg_of` make files of it.

    Raises:
        InputError: The scenario holds no crash of the AV.
        MissingExtraError: matplotlib is not installed.
    """
    partner = scenario.partner
    if scenario.crash is None or partner is None:
        raise InputError(f"Test {scenario.case_id} holds no crash of the AV; there is nothing to draw.")
    drawing, (above, below) = new_figure(2, 1, 9.5, 6.4)
    last = round(scenario.crash.time / FRAME_S)
    begin_s = max(min(answer.manoeuvre_s, _LONGEST_BEFORE_S), answer.latest_s or 0.0, _BEFORE_S)
    first = max(0, last - round(begin_s / FRAME_S))
    above.get_gridspec().set_height_ratios([1.0, 1.5])
    if scenario.odd.site is None:
        _draw_road(above, scenario, answer, first, last, partner)
    else:
        _draw_site(above, scenario, answer)
    _draw_speeds(below, scenario, answer, first, last, partner)
    title = f"case {scenario.case_id}: {_in_words(answer)}"
    drawing.suptitle(title, fontsize=9, x=0.01, ha="left")
    return drawing


def _in_words(answer: Avoidability) -> str:
    label = _LABELS[answer.label]
    if answer.latest_s is None or answer.time_to_react_s is None:
        return f"{label}; no way out in the time looked at"
    when = f"last way out {answer.latest_s:.1f} s before contact"
    reaction = f"{abs(answer.time_to_react_s):.1f} s {'after' if answer.time_to_react_s >= 0.0 else 'before'}"
    return f"{label};\n{when}, {reaction} the manoeuvre began"


def _times(first: int, last: int) -> NDArray[np.float64]:
    return np.asarray((np.arange(first, last + 1) - last) * FRAME_S, dtype=np.float64)


def _draw_site(panel: Any, scenario: Scenario, answer: Avoidability) -> None:
    """Draw the map at the moment of the contact, and the AV's way out; both places are those at that moment."""
    moments = Moments(scenario)
    span = (-_AHEAD_M, _AHEAD_M)
    draw_moment(panel, moments, moments.end, span, SCREEN, way_out=answer.witness, points_per_metre=5.0)


def _draw_road(
    panel: Any, scenario: Scenario, answer: Avoidability, first: int, last: int, partner: int
) -> None:  # fmt: skip
    odd = scenario.odd
    t = _times(first, last)
    x_contact = float(scenario.x[last, 0])
    pace = float(along(scenario.x[first, 0], x_contact)) / max(-float(t[0]), FRAME_S)
    for line in surface_of(odd, x_contact).lines:
        colour, width, style = _LINES[line.mark]
        for ends in strokes(line if line.mark == "hatch" else line._replace(mark="solid"), -_AHEAD_M, _AHEAD_M):
            panel.plot(*np.transpose(ends), color=colour, linewidth=width, linestyle=style, zorder=1)
    for j in range(scenario.slot.size - 1, -1, -1):
        seen = scenario.present[first : last + 1, j]
        x = along(x_contact, scenario.x[first : last + 1, j]) - pace * t
        if not seen[-1] or abs(float(x[-1])) > _AHEAD_M:
            continue
        colour = BLUE if j == 0 else ORANGE if j == partner else GREY
        label = {0: "AV, as recorded", partner: "whom it touched"}.get(j)
        panel.plot(x[seen], scenario.y[first : last + 1, j][seen], color=colour, linewidth=1.2, alpha=0.9, zorder=2,
                   label=label)  # fmt: skip
        pose = float(x[-1]), float(scenario.y[last, j]), float(scenario.heading[last, j])
        _box(panel, Box(*pose, scenario.length[j], scenario.width[j]), colour)
    witness = answer.witness
    if witness is not None:
        w = FRAME_S * np.arange(len(witness.x)) - witness.begin_s
        x = along(x_contact, witness.x) - pace * w
        until = w <= 1e-9
        panel.plot(x[until], witness.y[until], color=GREEN, linewidth=1.6, linestyle="--", zorder=3,
                   label="AV, on the way out (dot: its begin)")  # fmt: skip
        k = int(np.flatnonzero(until)[-1])
        pose = float(x[k]), float(witness.y[k]), float(witness.heading[k])
        _box(panel, Box(*pose, scenario.length[0], scenario.width[0]), GREEN, dashed=True)
        panel.plot(x[:1], witness.y[:1], marker="o", color=GREEN, markersize=5, zorder=4)
    panel.set_xlim(-_AHEAD_M, _AHEAD_M)
    panel.set_ylim(-0.5, odd.n_lanes * odd.lane_width + 0.5)
    panel.set_aspect("equal")
    panel.grid(visible=False)
    panel.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False, borderpad=0.2)
    panel.set_xlabel(
        f"along the road at contact [m], to scale; tracks as seen when moving at {pace:.1f} m/s", fontsize=9
    )
    panel.set_ylabel("across the road [m]", fontsize=9)


def _box(panel: Any, box: Box, colour: str, *, dashed: bool = False) -> None:
    (corners,) = corners_of(*(np.array([value]) for value in box))
    panel.fill(*corners.T, facecolor="none" if dashed else colour, edgecolor=colour, alpha=1.0 if dashed else 0.55,
               linewidth=1.8 if dashed else 1.0, linestyle="--" if dashed else "-", zorder=3)  # fmt: skip


def _draw_speeds(
    panel: Any, scenario: Scenario, answer: Avoidability, first: int, last: int, partner: int
) -> None:  # fmt: skip
    t = _times(first, last)
    seen = scenario.present[first : last + 1, partner]
    panel.plot(t, scenario.speed[first : last + 1, 0], color=BLUE, linewidth=1.8, label="AV, as recorded")
    panel.plot(t[seen], scenario.speed[first : last + 1, partner][seen], color=ORANGE, linewidth=1.8, linestyle="-.",
               label="whom it touched")  # fmt: skip
    if answer.witness is not None:
        w = FRAME_S * np.arange(len(answer.witness.x)) - answer.witness.begin_s
        panel.plot(w, answer.witness.speed, color=GREEN, linewidth=1.8, linestyle="--", label="AV, on the way out")
    panel.axvline(0.0, color="black", linewidth=1.0)
    panel.set_ylim(bottom=0.0)
    top = panel.get_ylim()[1]
    marks = (
        ("contact", 0.0), ("manoeuvre begins", answer.manoeuvre_s), ("last braking", answer.braking_s),
        ("last steering", answer.steering_s), ("last way out", answer.latest_s),
    )  # fmt: skip
    named: dict[float, list[str]] = {}
    for name, before in marks:
        if before is not None and -before >= t[0] - 1e-9:
            named.setdefault(before, []).append(name)
    for before, names in named.items():
        panel.axvline(-before, color=GREY, linewidth=0.9, linestyle=":", zorder=1)
        panel.annotate(", ".join(names), (-before, 0.02 * top), rotation=90, fontsize=8, color=GREY, ha="right",
                       va="bottom")  # fmt: skip
    panel.set_xlabel("time since contact [s]", fontsize=9)
    panel.set_ylabel("speed [m/s]", fontsize=9)
    panel.legend(fontsize=8, loc="best", framealpha=0.9)
