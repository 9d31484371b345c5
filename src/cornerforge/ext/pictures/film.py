"""A film of a case: the road from above in real time, what is read off it in numbers, and both over time."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._files import writing
from cornerforge.analysis.avoidability import WayOut
from cornerforge.ext.pictures.encoders import Format, Picture, check_format, encode
from cornerforge.ext.pictures.road_view import SCREEN, RoadView, across, name_of
from cornerforge.metrics.risk import plane_ttc
from cornerforge.report.drawing import check_matplotlib
from cornerforge.report.moments import Moment, Moments
from cornerforge.types import FRAME_S, Scenario

__all__ = ["STANDS_S", "check_film", "film"]

STANDS_S = 0.5
"""How long the film stands at the contact [s]."""
_SECONDS = 15.0
_PAPER, _INK, _MUTED, _GRID = "#ffffff", "#1b1f24", "#5d6673", "#e2e5e9"
_WIDTH_IN, _HEIGHT_IN = 12.8, 7.2
_WIDE_M = 80.0
"""Most of the road that is seen [m]."""
_SITE_M = 27.0
"""So much of a site is seen from south to north, at least [m]."""
_LONGEST_TTC_S = 10.0
_KMH = 3.6


def check_film(path: Path) -> None:
    """Check, before long work, that a film of this name can be made here; whether the place is free is not looked at.

    Raises:
        InputError: The name ends neither in .mp4 nor in .gif nor in .webm.
        MissingExtraError: matplotlib, or imageio-ffmpeg for .mp4 and .webm, is not installed.
    """
    check_format(path)
    check_matplotlib()


def film(
    scenario: Scenario,
    path: Path,
    *,
    title: str,
    sentence: str = "",
    way_out: WayOut | None = None,
    seconds: float = _SECONDS,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Make a film of a case, in real time, up to the AV's crash, where it stands for half a second.

    Where the AV does not crash, it ends with the recording. The same scenario gives the same pictures.

    Args:
        scenario: The case.
        path: The file, .mp4 (H.264), .webm (VP9) or .gif; an existing one is replaced, whole or not at all.
        title: The case's name.
        sentence: What happened.
        way_out: The AV on a way out, shown as a dashed outline.
        seconds: Longest time before the contact that is shown [s].
        progress: Called with the number of finished pictures and of all.

    Returns:
        The path.

    Raises:
        InputError: The name ends otherwise.
        MissingExtraError: What writes it is not installed.
        OutputError: It cannot be written.
    """
    kind = check_format(path)
    check_matplotlib()
    stage = _Stage(scenario, kind, title=title, sentence=sentence, way_out=way_out, seconds=seconds)
    times = stage.times()
    standing = times[-1:] * round(STANDS_S * kind.per_second)

    def pictures() -> Iterator[Picture]:
        for done, time in enumerate([*times, *standing], start=1):
            yield stage.picture(time)
            if progress is not None:
                progress(done, len(times) + len(standing))

    with writing(path, "the film") as part:
        encode(pictures(), part, kind)
    return path


class _Stage:
    """The figure of a film: what stays is drawn once, what moves is drawn over it for each picture."""

    def __init__(
        self, scenario: Scenario, kind: Format, *, title: str, sentence: str, way_out: WayOut | None, seconds: float
    ) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self._moments = moments = Moments(scenario)
        self._kind = kind
        self._begin = max(0.0, round((moments.end - seconds) / FRAME_S) * FRAME_S)
        self._figure: Any = Figure(figsize=(_WIDTH_IN, _HEIGHT_IN), dpi=kind.size[0] / _WIDTH_IN, facecolor=_PAPER)
        self._canvas: Any = FigureCanvasAgg(self._figure)
        partner = moments.partner
        self._ttc: NDArray[np.float64] | None = None if partner is None else plane_ttc(scenario, partner)
        self._moving: list[Any] = []
        self._write_head(title, sentence, way_out)
        self._make_road(way_out)
        self._make_numbers()
        self._make_curves()
        self._keep_still()

    def _keep_still(self) -> None:
        """Draw what does not move, and keep it."""
        for artist in [*self._road.moving(), *self._moving]:
            artist.set_animated(True)
        self._canvas.draw()
        self._still = self._read = self._canvas.copy_from_bbox(self._figure.bbox)
        self._frame = -1

    def times(self) -> list[float]:
        """Give the moments of the film, since the start of the test [s]."""
        n = round((self._moments.end - self._begin) * self._kind.per_second)
        # In whole numbers, so that the last is the contact.
        return [self._moments.end - (n - i) / self._kind.per_second for i in range(n + 1)]

    def picture(self, time: float) -> Picture:
        """Draw a moment; the pixels are overwritten by the next one."""
        frame = int(time / FRAME_S + 1e-6)
        if frame != self._frame:  # numbers change with each recorded frame, which can be read, and takes less time
            recorded = self._moments.at(frame * FRAME_S)
            self._show_numbers(recorded)
            self._show_curves(recorded)
            self._canvas.restore_region(self._still)
            self._draw(self._moving)
            self._frame, self._read = frame, self._canvas.copy_from_bbox(self._figure.bbox)
        self._canvas.restore_region(self._read)
        self._road.show(self._moments.at(time))
        self._draw(self._road.moving())
        return np.asarray(self._canvas.buffer_rgba())

    def _draw(self, artists: list[Any]) -> None:
        for artist in artists:
            if artist.get_visible():
                (artist.axes or self._figure).draw_artist(artist)

    def _write_head(self, title: str, sentence: str, way_out: WayOut | None) -> None:
        self._figure.text(0.025, 0.965, title, fontsize=17, fontweight="bold", color=_INK, va="top")
        lines = textwrap.wrap(sentence, 118)[:2]
        self._figure.text(0.025, 0.905, "\n".join(lines), fontsize=12, color=_INK, va="top", linespacing=1.3)
        if way_out is not None and self._moments.contact is not None:
            text = f"dashed: the AV on its last way out, from {way_out.begin_s:.1f} s before contact on"
            self._figure.text(0.975, 0.955, text, fontsize=10.5, color="#00795a", va="top", ha="right")

    def _make_road(self, way_out: WayOut | None) -> None:
        odd = self._moments.scenario.odd
        wide, high = _WIDTH_IN, 0.43 * _HEIGHT_IN
        # A picture of a site shows as much from south to north as fits.
        across_m = (across(odd, _WIDE_M) if odd.site is None else _SITE_M) + 3.0
        metres = max(_WIDE_M, across_m * wide / high)
        room = across(odd, metres) + 3.0
        extra = 0.5 * (metres * high / wide - room)
        axes = self._figure.add_axes((0.0, 0.40, 1.0, 0.43))
        self._road = RoadView(
            axes, self._moments, (-0.5 * metres, 0.5 * metres), SCREEN, way_out=way_out,
            points_per_metre=72.0 * wide / metres, margin=(1.5 + extra, 1.5 + extra),
        )  # fmt: skip
        y, right = -0.9 - 0.5 * extra, 0.5 * metres - 2.0
        if odd.site is not None:
            y = 1.5 - 0.5 * metres * high / wide
        axes.plot([right - 10.0, right], [y, y], color=_MUTED, linewidth=2.5, solid_capstyle="butt")
        axes.text(right - 10.5, y, "10 m", ha="right", va="center", fontsize=9.5, color=_MUTED)

    def _make_numbers(self) -> None:
        scenario, partner = self._moments.scenario, self._moments.partner
        heads = [
            ("before contact" if self._moments.contact is not None else "before the end", _INK),
            ("speed of the AV", SCREEN.av),
        ]
        if partner is not None:
            heads += [
                (f"speed of {name_of(scenario, partner)}", SCREEN.partner),
                ("gap between bumpers" if scenario.odd.site is None else "distance of both", _INK),
                ("time to collision", _INK),
            ]  # fmt: skip
        self._values, self._small = [], []
        for (head, colour), left in zip(heads, (0.025, 0.235, 0.435, 0.635, 0.815), strict=False):
            self._figure.text(left, 0.378, head, fontsize=10.5, color=_MUTED, va="top")
            self._values.append(self._figure.text(left, 0.343, "", fontsize=17, color=colour, va="top", weight="bold"))
            self._small.append(self._figure.text(left + 0.115, 0.333, "", fontsize=10.5, color=_MUTED, va="top"))
        self._moving += [*self._values, *self._small]

    def _show_numbers(self, moment: Moment) -> None:
        moments, partner = self._moments, self._moments.partner
        left = moments.end - moment.time
        at_end = "contact" if moments.contact is not None else "end"
        said = [(at_end if left < 0.05 else f"{left:.1f} s", ""), _speed(moment, 0)]
        if partner is not None:
            gap, ttc = moments.gap(moment, partner), self._time_to_collision(moment.time)
            said.append(_speed(moment, partner))
            is_beside = gap <= 0.0 and left > 0.05
            said.append(("beside" if is_beside else "–" if np.isnan(gap) else f"{max(gap, 0.0):.1f} m", ""))
            said.append(("–" if not ttc < 99.95 else f"{ttc:.1f} s", ""))
        for value, small, (what, more) in zip(self._values, self._small, said, strict=True):
            value.set_text(what)
            small.set_text(more)

    def _time_to_collision(self, time: float) -> float:
        """Read the last frame's value: between frames it may jump, and no mean with infinity exists."""
        assert self._ttc is not None
        return float(self._ttc[min(int(time / FRAME_S + 1e-6), len(self._ttc) - 1)])

    def _make_curves(self) -> None:
        moments, scenario = self._moments, self._moments.scenario
        first, last = round(self._begin / FRAME_S), round(moments.end / FRAME_S)
        rows = slice(first, last + 1)
        self._t = (np.arange(first, last + 1) - last) * FRAME_S
        columns = [(0, SCREEN.av, "-")]
        if moments.partner is not None:
            columns.append((moments.partner, SCREEN.partner, "-."))
        speeds = self._panel((0.055, 0.095, 0.40, 0.155), "speed [m/s]")
        seen = [np.where(scenario.present[rows, c], scenario.speed[rows, c], np.nan) for c, _, _ in columns]
        for (column, colour, style), values in zip(columns, seen, strict=True):
            speeds.plot(self._t, values, color=colour, linewidth=1.8, linestyle=style, label=name_of(scenario, column))
        low, high = min(map(np.nanmin, seen)), max(map(np.nanmax, seen))
        room = max(1.0, 0.12 * (high - low))
        speeds.set_ylim(max(0.0, low - room), high + room)
        self._curves = [(speeds, colour, values) for (_, colour, _), values in zip(columns, seen, strict=True)]
        if self._ttc is not None:
            ttc = self._panel((0.555, 0.095, 0.40, 0.155), "time to collision [s]")
            shown = np.where(self._ttc[rows] <= _LONGEST_TTC_S, self._ttc[rows], np.nan)
            ttc.plot(self._t, shown, color=_INK, linewidth=1.8)
            ttc.set_ylim(0.0, _LONGEST_TTC_S)
            ttc.set_yticks([0, 5, 10])
            self._curves.append((ttc, _INK, shown))
        lines = {panel: panel.axvline(self._t[0], color=_MUTED, linewidth=1.2) for panel, _, _ in self._curves}
        self._cursors = list(lines.values())
        self._dots = [
            panel.plot([], [], "o", color=colour, markersize=6, clip_on=False)[0] for panel, colour, _ in self._curves
        ]
        self._moving += [*self._cursors, *self._dots]

    def _panel(self, place: tuple[float, float, float, float], what: str) -> Any:
        panel = self._figure.add_axes(place)
        panel.spines[["top", "right"]].set_visible(False)
        panel.spines[["left", "bottom"]].set_color(_GRID)
        panel.tick_params(labelsize=10, colors=_MUTED, length=3)
        panel.grid(color=_GRID, linewidth=0.7)
        panel.set_xlim(self._t[0], max(0.0, self._t[0] + FRAME_S))
        panel.set_title(what, fontsize=10.5, color=_MUTED, loc="left", pad=4)
        until = "seconds before contact" if self._moments.contact is not None else "seconds before the end"
        panel.set_xlabel(until, fontsize=10, color=_MUTED, labelpad=2)
        panel.xaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
        return panel

    def _show_curves(self, moment: Moment) -> None:
        now = moment.time - self._moments.end
        for line in self._cursors:
            line.set_xdata([now, now])
        frame = min(int((now - self._t[0]) / FRAME_S + 1e-6), len(self._t) - 1)
        for dot, (_, _, values) in zip(self._dots, self._curves, strict=True):
            dot.set_data([self._t[frame]], [values[frame]])


def _speed(moment: Moment, column: int) -> tuple[str, str]:
    if not moment.there[column]:
        return "–", ""
    speed = float(moment.speed[column])
    return f"{speed:.1f} m/s", f"{_KMH * speed:.0f} km/h"
