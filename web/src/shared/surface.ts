// Where a road's asphalt is, and the lines on it, as `cornerforge.report.surface` says; metres. Pure.
import type { Case, Mark } from "./case";

type Spot = readonly [x: number, y: number];
/** At the right of the begin and of the end, at the left of the end and of the begin. */
export type Corners = readonly [Spot, Spot, Spot, Spot];

/** Width of each mark, how long its dashes are and how often they come [m]; 0: it is one dash. */
export const MARKS: Readonly<Record<Mark, readonly [wide: number, long: number, every: number]>> = {
  solid: [0.15, 0, 0], broken: [0.15, 3, 12], wide: [0.3, 3, 6], barrier: [0.4, 0, 0], hatch: [0.4, 3, 6],
};

type Surface = Required<Case>["surface"];
export type Line = Surface["lines"][number];

/** The surface of a case's road; one whose lanes all go on is not written in the case. */
export function surfaceOf({ surface, lanes, laneWidth }: Case): Surface {
  if (surface) return surface;
  const lines = Array.from({ length: lanes + 1 }, (_, i): Line =>
    [null, i * laneWidth, null, i * laneWidth, i % lanes === 0 ? "solid" : "broken"]);
  return { areas: [[null, null, 0, lanes * laneWidth, 0, lanes * laneWidth]], lines };
}

/** Corners of each area with its shoulders; where it goes on, it ends at one of two places along the road. */
export const outlines = ({ areas }: Surface, low: number, high: number, shoulder: number): Corners[] =>
  areas.map(([begin, end, right, left, rightEnd, leftEnd]) => [
    [begin ?? low, right - shoulder], [end ?? high, rightEnd - shoulder], [end ?? high, leftEnd + shoulder], [begin ?? low, left + shoulder],
  ]);

/** What is painted of a line between two places along the road: straight strokes from one end to the other. */
export function strokes([from, y, to, yEnd, mark]: Line, low: number, high: number): (readonly [Spot, Spot])[] {
  const [, long, every] = MARKS[mark];
  const [first, last] = [from ?? -Infinity, to ?? Infinity];
  const [begin, end] = [Math.max(first, low), Math.min(last, high)];
  if (begin > end) return [];
  if (every === 0) return [y === yEnd ? [[begin, y], [end, y]] : [[first, y], [last, yEnd]]];
  const places = Array.from({ length: Math.floor(end / every) - Math.floor(begin / every) + 1 }, (_, i) => (Math.floor(begin / every) + i) * every);
  if (mark === "hatch") return places.filter((s) => first <= s && s + long <= last).map((s) => [[s, y], [s + long, yEnd]]);
  return places.filter((s) => s + long > begin && s < end).map((s) => [[Math.max(s, begin), y], [Math.min(s + long, end), y]]);
}
