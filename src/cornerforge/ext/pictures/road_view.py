"""The road from above, to scale, drawn onto matplotlib axes; the same artists show one moment after another.

The AV stays in its place and the road moves past it. Both axes are in metres, and a metre is as long on one as on the
other. Colours are Okabe and Ito's as on the pages; labels, outlines and shades of grey also identify each vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.avoidability import WayOut
from cornerforge.report.moments import Moment, Moments, overlap_of
from cornerforge.report.site_surface import BAR, changes_of, site_surface
from cornerforge.report.surface import MARKS, outline, strokes, surface_of
from cornerforge.site.network import Site
from cornerforge.site.signals import clock_of
from cornerforge.types import FRAME_S, PERSON, TRUCK, Odd, Scenario

__all__ = ["PRINT", "SCREEN", "Look", "RoadView", "across", "draw_moment", "name_of"]

_SHOULDER_M, _SITE_SHOULDER_M = 0.3, 0.6
_ARROW_M = 7.0
_SETTLED_M = 0.25
_CIRCLE_M = 1.7
"""Radius of the ring round a contact [m]."""
_WIDE_PERSON = 1.8
"""People are drawn so many times as large as they are, or they would hardly be seen."""
_EDGE_M, _STOP_M, _LIGHT_M, _WALK_LIGHT_M = 0.12, 0.4, 0.8, 0.5
_LIGHTS = {"r": "#ff3b30", "y": "#ffbf00", "g": "#2ecc71", "G": "#2ecc71"}


@dataclass(frozen=True)
class Look:
    """Colours of a picture, sizes in points, and labels beside the vehicles.

    Attributes:
        road, verge, paint: Colours of the road.
        av, partner, other, person: Fills of vehicles, and of people.
        edge: Outline of vehicles.
        glass: Colour of windscreens, which show where the front is.
        way_out, contact, ink, muted: Colours of the marks over them.
        font: Size of labels.
        trail_s: How far back trails go [s].
        plate: Colour behind labels.
        line: Width of outlines.
        every_speed: Say the speeds of all vehicles, not of the two that meet alone.
    """

    road: str
    verge: str
    paint: str
    av: str
    partner: str
    other: str
    person: str
    edge: str
    glass: str
    way_out: str
    contact: str
    ink: str
    muted: str
    font: float
    trail_s: float
    plate: str
    line: float
    every_speed: bool


SCREEN = Look(
    road="#3e454d", verge="#e7ebe6", paint="#f4f4f0", av="#0072b2", partner="#d55e00",
    other="#9aa3ad", person="#e377c2", edge="#20252a", glass="#ffffff8c", way_out="#4fe0b5", contact="#cc2936",
    ink="#f4f4f0", muted="#5d6673", font=10.0, trail_s=2.0, plate="#3e454d", line=0.8, every_speed=True,
)  # fmt: skip
"""Look of the report's player in light mode."""
PRINT = Look(
    road="#ededed", verge="#ffffff", paint="#8a8a8a", av="#0072b2", partner="#e69f00",
    other="#ffffff", person="#555555", edge="#000000", glass="#c4c4c4", way_out="#009e73", contact="#cc2936",
    ink="#000000", muted="#555555", font=8.0, trail_s=1.0, plate="#ededed", line=0.6, every_speed=False,
)  # fmt: skip
"""Little ink, and told apart without colour: the AV is dark, its partner of middle grey, all others are white."""


def name_of(scenario: Scenario, column: int) -> str:
    """Name of a vehicle on pictures: "AV", "BV 3", "truck 5" or "motorcycle 2"."""
    if column == 0:
        return "AV"
    kind = ("BV", "truck", "motorcycle", "person")[int(scenario.kind[column])]
    return f"{kind} {int(scenario.slot[column])}"


def across(odd: Odd, wide: float) -> float:
    """Say how far a picture must reach across the road, or from south to north at a site [m], if it is so wide [m]."""
    return odd.n_lanes * odd.lane_width if odd.site is None else 0.6 * wide


class RoadView:
    """A stretch of road round the AV on axes; `show` moves it to a moment.

    At a site the picture lies as a map does, about where the two meet; it moves only as far as the AV would leave it.

    Args:
        axes: Axes of matplotlib; they are given limits and lose their frame.
        moments: The case.
        span: How far the picture reaches along the road from the AV, behind (negative) and ahead [m].
        look: Colours and sizes.
        way_out: The AV on a way out, drawn as a dashed outline.
        points_per_metre: Scale of the picture, for the widths of lines.
        labelled: Label the vehicles.
        margin: Room beyond the road's edges (at a site beyond `across`), below and above [m].
    """

    def __init__(
        self,
        axes: Any,
        moments: Moments,
        span: tuple[float, float],
        look: Look,
        *,
        way_out: WayOut | None = None,
        points_per_metre: float,
        labelled: bool = True,
        margin: tuple[float, float] = (1.0, 1.0),
    ) -> None:
        from matplotlib.collections import LineCollection, PathCollection, PolyCollection
        from matplotlib.patches import Rectangle

        self._axes, self._moments, self._look, self._span = axes, moments, look, span
        self._way_out, self._scale, self._labelled = way_out, points_per_metre, labelled
        odd = moments.scenario.odd
        self._surface = None if odd.site else surface_of(odd, float(moments.scenario.x[0, 0]))
        self._site = None if odd.site is None else _SiteLines(moments.scenario, odd.site, look)
        top = across(odd, span[1] - span[0])
        low = -margin[0] - (0.5 * top if odd.site else 0.0)
        self._high = top + sum(margin)
        axes.set_xlim(*span)
        axes.set_ylim(low, low + self._high)
        axes.set_aspect("equal")
        axes.set_axis_off()
        wide = span[1] - span[0]
        axes.add_patch(Rectangle((span[0], low), wide, self._high, color=look.verge, linewidth=0, zorder=0))
        shoulders = 0.0 if odd.site is None else 2.0 * _SITE_SHOULDER_M * points_per_metre
        asphalt: Any = PathCollection([], color=look.road, linewidths=shoulders, zorder=0.1)
        lines: Any = LineCollection([], zorder=0.3, capstyle="butt")
        trails: Any = LineCollection([], zorder=0.4, linewidths=max(1.0, 0.3 * points_per_metre), alpha=0.8)
        bodies: Any = PolyCollection([], zorder=2, linewidths=look.line)
        glass: Any = PolyCollection([], zorder=2.1, facecolors=look.glass, linewidths=0)
        arrows: Any = LineCollection([], zorder=1, linewidths=1.5 * look.line, linestyles="--")
        heads: Any = PolyCollection([], zorder=1, linewidths=0)
        ghost: Any = PolyCollection(
            [], zorder=3, facecolors="none", edgecolors=look.way_out, linewidths=1.6, linestyles="--"
        )
        crash: Any = PolyCollection([], zorder=4, facecolors=look.contact, linewidths=0)
        (ring,) = axes.plot([], [], color=look.contact, linewidth=1.6, zorder=4)
        self._asphalt, self._lines, self._trails, self._bodies, self._glass = asphalt, lines, trails, bodies, glass
        self._arrows, self._heads, self._ghost, self._crash, self._ring = arrows, heads, ghost, crash, ring
        self._texts: dict[int, Any] = {}
        for artist in (asphalt, lines, trails, arrows, heads, bodies, glass, ghost, crash):
            axes.add_collection(artist, autolim=False)
            artist.set_clip_on(True)

    def moving(self) -> list[Any]:
        """All artists that `show` changes, in the order in which they are drawn."""
        fixed = (self._asphalt, self._lines, self._trails, self._arrows, self._heads, self._bodies, self._glass,
                 self._ghost, self._crash, self._ring)  # fmt: skip
        return [*fixed, *self._texts.values()]

    def show(self, moment: Moment) -> None:
        """Show a moment."""
        moments, scenario = self._moments, self._moments.scenario
        offset = self._offset(moment)
        ahead = moment.place - offset[0]
        near = moment.there & (ahead > self._span[0] - 12.0) & (ahead < self._span[1] + 12.0)
        pair = [0] if moments.partner is None or not near[moments.partner] else [moments.partner, 0]
        others = [int(c) for c in np.flatnonzero(near) if c not in pair]
        columns = [*others, *pair]
        boxes = moments.boxes(moment, columns) - offset
        people = scenario.kind[columns] == PERSON
        middles = boxes[people].mean(axis=1, keepdims=True)
        boxes[people] = middles + _WIDE_PERSON * (boxes[people] - middles)
        fills = [self._fill(column) for column in columns]
        self._bodies.set_verts(boxes)
        self._bodies.set_facecolors(fills)
        self._bodies.set_edgecolors(self._look.edge)
        cars = [c for c in columns if scenario.kind[c] != PERSON]
        self._glass.set_verts(_windscreens(boxes[~people], [int(scenario.kind[c]) for c in cars], scenario, cars))
        self._show_surface(moment, offset)
        self._show_trails(moment, offset)
        self._show_arrows(moment, columns, offset[0], fills)
        ghost = None if self._way_out is None else moments.ghost(self._way_out, moment.time)
        self._ghost.set_verts([] if ghost is None else [ghost - offset])
        self._show_contact(moment, offset)
        if self._labelled:
            self._show_labels(moment, others, pair, offset)

    def _fill(self, column: int) -> str:
        look = self._look
        if column == 0:
            return look.av
        if column == self._moments.partner:
            return look.partner
        return look.person if self._moments.scenario.kind[column] == PERSON else look.other

    def _offset(self, moment: Moment) -> NDArray[np.float64]:
        """Say which place of the road, or site, lies at the origin of the picture, (2,) [m]."""
        if self._site is None:
            return np.array([float(moment.place[0]), 0.0])
        room = 0.4 * np.array([self._span[1] - self._span[0], self._high])
        av = np.array([moment.place[0], moment.y[0]])
        return np.asarray(np.clip(self._moments.meeting(), av - room, av + room))

    def _show_surface(self, moment: Moment, offset: NDArray[np.float64]) -> None:
        if self._site is None:
            self._show_road(float(offset[0]))
            return
        paths, segments, widths, colours = self._site.at(moment.time, offset)
        self._asphalt.set_paths(paths)
        self._lines.set_segments(segments)
        self._lines.set_linewidths([max(0.6, width * self._scale) for width in widths])
        self._lines.set_colors(colours)

    def _show_road(self, here: float) -> None:
        from matplotlib.path import Path

        assert self._surface is not None
        look, low, high = self._look, here + self._span[0], here + self._span[1]
        outlines = [Path(outline(area, low, high, _SHOULDER_M) - [here, 0.0]) for area in self._surface.areas]
        self._asphalt.set_paths([Path.make_compound_path(*outlines)])  # one, so that no seams show
        drawn = [(stroke, line.mark) for line in self._surface.lines for stroke in strokes(line, low, high)]
        self._lines.set_segments([np.subtract(stroke, (here, 0.0)) for stroke, _ in drawn])
        self._lines.set_linewidths([max(0.6, MARKS[mark][0] * self._scale) for _, mark in drawn])
        self._lines.set_colors([look.contact if mark == "barrier" else look.paint for _, mark in drawn])

    def _show_trails(self, moment: Moment, offset: NDArray[np.float64]) -> None:
        partner = self._moments.partner
        columns = [0] if partner is None else [partner, 0]
        trails = [self._moments.trail(column, moment.time, self._look.trail_s) - offset for column in columns]
        self._trails.set_segments(trails)
        self._trails.set_colors([self._fill(column) for column in columns])

    def _show_arrows(self, moment: Moment, columns: list[int], here: float, fills: list[str]) -> None:
        """Draw arrows from the noses of vehicles to the lanes that they change to."""
        scenario = self._moments.scenario
        curves, heads, colours = [], [], []
        for column, fill in zip(columns, fills, strict=True):
            goal = (float(moment.lane[column]) + 0.5) * scenario.odd.lane_width
            y = float(moment.y[column])
            if moment.lane[column] < 0 or abs(goal - y) < _SETTLED_M:
                continue
            nose = float(moment.place[column]) - here + 0.5 * float(scenario.length[column])
            s = np.linspace(0.0, 1.0, 12)
            curves.append(np.column_stack([nose + _ARROW_M * s, y + (goal - y) * s**2 * (3.0 - 2.0 * s)]))
            end = nose + _ARROW_M
            heads.append([(end + 1.1, goal), (end - 0.1, goal + 0.6), (end - 0.1, goal - 0.6)])
            is_of_pair = column in (0, self._moments.partner)
            colours.append(self._look.ink if is_of_pair or fill == self._look.other else fill)
        self._arrows.set_segments(curves)
        self._arrows.set_colors(colours)
        self._heads.set_verts(heads)
        self._heads.set_facecolors(colours)

    def _show_contact(self, moment: Moment, offset: NDArray[np.float64]) -> None:
        contact, partner = self._moments.contact, self._moments.partner
        area = np.empty((0, 2))
        if contact is not None and partner is not None and moment.time >= contact - 1e-6 and moment.there[partner]:
            area = overlap_of(*self._moments.boxes(moment, [0, partner])) - offset
        self._crash.set_verts([area] if len(area) > 2 else [])
        angle = np.linspace(0.0, 2.0 * np.pi, 41)
        ring = area.mean(axis=0) + _CIRCLE_M * np.column_stack([np.cos(angle), np.sin(angle)]) if len(area) else area
        self._ring.set_data(*ring.T)

    def _show_labels(self, moment: Moment, others: list[int], pair: list[int], offset: NDArray[np.float64]) -> None:
        scenario, look = self._moments.scenario, self._look
        speed = scenario.speed[int(moment.time / FRAME_S + 1e-6)]  # as recorded, to be readable
        said: dict[int, tuple[str, bool]] = {}
        for column in others if look.every_speed else []:
            said[column] = f"{speed[column]:.1f}", False
        for column in pair:
            # The two that meet carry their labels on the sides turned away from each other.
            other = pair[1 - pair.index(column)] if len(pair) == 2 else column
            y, y_other = float(moment.y[column]), float(moment.y[other])
            below = len(pair) == 2 and (y < y_other or (y == y_other and column == 0))
            said[column] = f"{name_of(scenario, column)} {speed[column]:.1f} m/s", below
        for column, text in self._texts.items():
            text.set_visible(column in said)
        for column, (what, below) in said.items():
            text = self._texts.get(column) or self._new_text(column, bold=column in pair)
            tilt = abs(float(np.sin(moment.heading[column]))) * 0.5 * float(scenario.length[column])
            reach = 0.5 * float(scenario.width[column]) + tilt + 0.25
            text.set_text(what)
            aside = -reach if below else reach
            text.set_position((float(moment.place[column] - offset[0]), float(moment.y[column] - offset[1]) + aside))
            text.set_verticalalignment("top" if below else "bottom")

    def _new_text(self, column: int, *, bold: bool) -> Any:
        look = self._look
        text = self._axes.text(
            0.0, 0.0, "", ha="center", fontsize=look.font if bold else 0.8 * look.font, color=look.ink, zorder=5,
            fontweight="bold" if bold else "normal", clip_on=True,
            bbox={"facecolor": look.plate, "edgecolor": "none", "pad": 0.8, "alpha": 0.85},
        )  # fmt: skip
        text.set_animated(self._lines.get_animated())
        self._texts[column] = text
        return text


class _SiteLines:
    """What is drawn of a site: asphalt, lines and lights."""

    def __init__(self, scenario: Scenario, site: Site, look: Look) -> None:
        found = site_surface(site)
        self._start = np.array([scenario.x[0, 0], 0.0])
        self._lanes, self._lights = found.lanes, found.lights
        clock = clock_of(scenario)
        self._changes = changes_of(site, clock, len(scenario.x), FRAME_S)
        bars = [np.stack([bar[[0, 3]].mean(axis=0), bar[1:3].mean(axis=0)]) for bar in found.bars]
        self._painted = [
            (line - self._start, width, look.paint)
            for lines, width in ((found.edges, _EDGE_M), (bars, BAR), (found.stops, _STOP_M)) for line in lines
        ]  # fmt: skip

    def at(self, time: float, offset: NDArray[np.float64]) -> tuple[list[Any], list[Any], list[float], list[str]]:
        """Give paths of asphalt; segments of lines, their widths [m] and colours, from an origin on."""
        from matplotlib.path import Path

        frame = int(time / FRAME_S + 1e-6)
        lit = [
            (light.at - self._start, _WALK_LIGHT_M if light.walks else _LIGHT_M,
             _LIGHTS[[letter for begin, letter in changes if begin <= frame][-1]])
            for light, changes in zip(self._lights, self._changes, strict=True)
        ]  # fmt: skip
        segments, widths, colours = zip(*self._painted, *lit, strict=True)
        asphalt = Path.make_compound_path(*(Path(lane - self._start - offset, closed=False) for lane in self._lanes))
        return [asphalt], [segment - offset for segment in segments], list(widths), list(colours)


def _windscreens(
    boxes: NDArray[np.float64], kinds: list[int], scenario: Scenario, columns: list[int]
) -> NDArray[np.float64]:
    """Corners of the windscreens of boxes, shape (n, 4, 2): a truck's is at its nose, a car has a bonnet before it."""
    length = scenario.length[np.array(columns, dtype=np.intp)]
    is_truck = np.array(kinds) == TRUCK
    front = np.where(is_truck, 0.2 / length, 0.25)[:, None]
    back = np.where(is_truck, 0.9 / length, 0.38)[:, None]
    left, right = boxes[:, 1] - boxes[:, 0], boxes[:, 2] - boxes[:, 3]
    across = boxes[:, 3] - boxes[:, 0]
    return np.stack(
        [
            boxes[:, 0] + front * left + 0.14 * across,
            boxes[:, 0] + back * left + 0.14 * across,
            boxes[:, 3] + back * right - 0.14 * across,
            boxes[:, 3] + front * right - 0.14 * across,
        ],
        axis=1,
    )


def draw_moment(
    axes: Any, moments: Moments, time: float, span: tuple[float, float], look: Look, **more: Any
) -> RoadView:
    """Draw one moment onto axes, to scale.

    Args:
        axes: Axes of matplotlib.
        moments: The case.
        time: Since the start of the test [s].
        span: How far the picture reaches along the road from the AV, behind (negative) and ahead [m].
        look: Colours and sizes.
        more: Further arguments of `RoadView`.
    """
    view = RoadView(axes, moments, span, look, **more)
    view.show(moments.at(time))
    return view
