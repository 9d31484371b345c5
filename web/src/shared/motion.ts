// Where a recorded vehicle is at a moment, and the shape of its box. Pure functions of a recording.
import type { Case, Motion } from "./case";

export type Point = readonly [number, number];

/** A box on the road [m], its front where `h` points [rad], at its speed [m/s]; `lane`: kept or changed to, -1: unknown. */
export interface Box {
  readonly x: number;
  readonly y: number;
  readonly v: number;
  readonly h: number;
  readonly lane: number;
  readonly length: number;
  readonly width: number;
}

/** The value at a frame, between two frames by a straight line; null where it was not recorded. */
export function valueAt(motion: Motion, key: "x" | "y" | "v" | "h", frame: number): number | null {
  const local = frame - motion.from;
  const low = Math.floor(local);
  const part = local - low;
  const a = motion[key][low] ?? null;
  if (part === 0 || a === null) return a;
  const b = motion[key][low + 1] ?? null;
  return b === null ? null : a * (1 - part) + b * part;
}

/** The box at a frame; null where it was not recorded. */
export function boxAt(motion: Motion, frame: number): Box | null {
  const [x, y, v, h] = (["x", "y", "v", "h"] as const).map((key) => valueAt(motion, key, frame));
  if (x == null || y == null || v == null || h == null) return null;
  const lane = motion.lane[Math.floor(frame - motion.from)] ?? -1;
  return { x, y, v, h, lane, length: motion.length, width: motion.width };
}

/** Seconds since the test began at a frame, and back. */
export const secondsAt = (item: Timed, frame: number): number => (item.first + frame) * item.dt;
export const frameAt = (item: Timed, seconds: number): number => seconds / item.dt - item.first;

/** What has frames: `first` is how many frames after the begin of the test frame 0 lies. */
export interface Timed {
  readonly dt: number;
  readonly first: number;
  readonly frames: number;
}

/** Index of the decision in force at a frame; -1: none. Decisions are made every 10 frames of the test. */
export const decisionAt = (item: Case, frame: number): number =>
  Math.min(Math.floor((item.first + frame + 1e-6) / 10), item.critical.length - 1);

/** Index into `vehicles` of the BV that the adversary controls at a frame; -1: none. */
export function criticalAt(item: Case, frame: number): number {
  const k = decisionAt(item, frame);
  return k < 0 ? -1 : (item.critical[k] ?? -1);
}

/** Corners of a box, counter-clockwise. */
export function corners(box: Box): Point[] {
  const c = Math.cos(box.h);
  const s = Math.sin(box.h);
  const along = box.length / 2;
  const across = box.width / 2;
  const local: Point[] = [[along, across], [-along, across], [-along, -across], [along, -across]];
  return local.map(([a, b]) => [box.x + a * c - b * s, box.y + a * s + b * c]);
}

/** Common area of two convex polygons given counter-clockwise (Sutherland and Hodgman's clipping). */
export function commonArea(subject: readonly Point[], clip: readonly Point[]): Point[] {
  let result = [...subject];
  clip.forEach((p, i) => {
    const q = clip[(i + 1) % clip.length]!;
    const side = ([x, y]: Point) => (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]);
    const input = result;
    result = [];
    input.forEach((b, j) => {
      const a = input[(j + input.length - 1) % input.length]!;
      const [sa, sb] = [side(a), side(b)];
      if (sa >= 0 !== sb >= 0) {
        const t = sa / (sa - sb);
        result.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
      }
      if (sb >= 0) result.push(b);
    });
  });
  return result;
}

/** The point of a box that is nearest to a point; the point itself if it is inside. */
function nearestIn(box: Box, [x, y]: Point): Point {
  const [c, s] = [Math.cos(box.h), Math.sin(box.h)];
  const [dx, dy] = [x - box.x, y - box.y];
  const keep = (value: number, most: number) => Math.max(-most, Math.min(most, value));
  const along = keep(dx * c + dy * s, box.length / 2);
  const across = keep(-dx * s + dy * c, box.width / 2);
  return [box.x + along * c - across * s, box.y + along * s + across * c];
}

/** Where two boxes that are known to touch do so: their common area, which rounding may have taken away, and its middle. */
export function touch(a: Box, b: Box): { area: Point[]; middle: Point } {
  const area = commonArea(corners(a), corners(b));
  if (area.length >= 3) {
    const mean = (k: 0 | 1) => area.reduce((sum, p) => sum + p[k], 0) / area.length;
    return { area, middle: [mean(0), mean(1)] };
  }
  const pairs = [...corners(a).map((p) => [p, nearestIn(b, p)] as const), ...corners(b).map((p) => [p, nearestIn(a, p)] as const)];
  const gap = ([p, q]: readonly [Point, Point]) => Math.hypot(p[0] - q[0], p[1] - q[1]);
  const [p, q] = pairs.reduce((best, pair) => (gap(pair) < gap(best) ? pair : best));
  return { area: [], middle: [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2] };
}

/** Gap along the road [m]: distance of the centres less half of both lengths; negative where they are side by side. */
export const gapAlong = (a: Box, b: Box): number => Math.abs(a.x - b.x) - (a.length + b.length) / 2;

/** Distance of two boxes [m]; 0 where they touch. */
function apart(a: Box, b: Box): number {
  if (commonArea(corners(a), corners(b)).length > 0) return 0;
  const far = (corner: Point, other: Box) => { const [x, y] = nearestIn(other, corner); return Math.hypot(corner[0] - x, corner[1] - y); };
  return Math.min(...corners(a).map((corner) => far(corner, b)), ...corners(b).map((corner) => far(corner, a)));
}

/** Gap of two boxes as readings say it [m]: along the road, or at a site their distance. */
export const gapOf = (item: { readonly site?: unknown }, a: Box, b: Box): number => (item.site ? apart(a, b) : gapAlong(a, b));

/** Whether a vehicle is on its way to another lane: its box is not yet in the middle of the lane that it drives to. */
export function changesTo(box: Box, laneWidth: number): number | null {
  if (box.lane < 0) return null;
  const goal = (box.lane + 0.5) * laneWidth;
  return Math.abs(goal - box.y) < 0.25 ? null : goal;
}

/** Frame of the contact, or the last one; always a recorded frame. */
export const crashFrame = (item: { readonly crash: number | null; readonly frames: number }): number =>
  Math.max(0, Math.min(item.crash ?? item.frames - 1, item.frames - 1));
