// The shapes of the 3-D view: boxes with slanted sides, from which vehicles are put together. Pure; metres, x to the front,
// y to the left, z up, the origin on the ground under the middle of the vehicle.
import type { Kind } from "../../shared/case";

/** What a part is made of: the vehicle's own colour, glass, tyres and the like, lamps. */
export type Stuff = "body" | "load" | "glass" | "dark" | "rear lamp" | "head lamp";

/** A box whose top may be smaller than its bottom: ends along x at the bottom and at the top, half widths, heights. */
export interface Block {
  readonly stuff: Stuff;
  readonly bottom: readonly [rear: number, front: number, half: number];
  readonly top: readonly [rear: number, front: number, half: number];
  readonly from: number;
  readonly to: number;
}

const box = (stuff: Stuff, rear: number, front: number, half: number, from: number, to: number): Block =>
  ({ stuff, bottom: [rear, front, half], top: [rear, front, half], from, to });

/** The parts of a vehicle of a class and size; the whole keeps to its length and width. */
export function vehicleBlocks(kind: Kind, length: number, width: number): Block[] {
  if (kind === "truck") return truck(length, width);
  if (kind === "person") return person(length, width);
  return kind === "motorcycle" ? motorcycle(length, width) : car(length, width);
}

function car(length: number, width: number): Block[] {
  const [l, w] = [length / 2, width / 2];
  const wheel = 0.16 * length;
  return [
    box("body", -l, l, w, 0.28, 0.62),
    { stuff: "body", bottom: [-l, l, w], top: [-0.97 * l, 0.94 * l, 0.94 * w], from: 0.62, to: 0.88 },
    { stuff: "glass", bottom: [-0.86 * l, 0.42 * l, 0.9 * w], top: [-0.56 * l, 0.08 * l, 0.74 * w], from: 0.88, to: 1.36 },
    { stuff: "body", bottom: [-0.56 * l, 0.08 * l, 0.74 * w], top: [-0.52 * l, 0.04 * l, 0.68 * w], from: 1.36, to: 1.46 },
    ...wheels([-0.62 * l, 0.62 * l], wheel, w, 0.6),
    ...lamps(l, w, 0.62, 0.78),
  ];
}

function truck(length: number, width: number): Block[] {
  const [l, w] = [length / 2, width / 2];
  const cab = Math.min(2.3, 0.28 * length);
  const nose = l - cab;
  return [
    box("dark", -l, l - 0.1, 0.8 * w, 0.55, 1.0),
    { stuff: "body", bottom: [nose, l, w], top: [nose, l - 0.06, 0.98 * w], from: 0.5, to: 1.75 },
    { stuff: "glass", bottom: [l - 0.62 * cab, l - 0.06, 0.98 * w], top: [l - 0.58 * cab, l - 0.22, 0.95 * w], from: 1.75, to: 2.55 },
    { stuff: "body", bottom: [nose, l - 0.62 * cab, 0.98 * w], top: [nose, l - 0.58 * cab, 0.95 * w], from: 1.75, to: 2.55 },
    { stuff: "body", bottom: [nose, l - 0.22, 0.95 * w], top: [nose + 0.1, l - 0.6, 0.9 * w], from: 2.55, to: 2.95 },
    box("load", -l, nose - 0.45, w, 1.0, 3.7),
    ...wheels([-l + 1.2, -l + 2.5, nose + 0.5 * cab].filter((x, i, all) => i === 0 || x - all[i - 1]! > 1.1), 1.0, w, 1.0),
    ...lamps(l, w, 0.7, 0.95),
  ];
}

function motorcycle(length: number, width: number): Block[] {
  const [l, w] = [length / 2, width / 2];
  return [
    box("dark", -l, -l + 0.6, 0.1, 0.02, 0.6),
    box("dark", l - 0.6, l, 0.1, 0.02, 0.6),
    box("body", -0.7 * l, 0.7 * l, 0.18, 0.45, 0.95),
    { stuff: "dark", bottom: [-0.45 * l, 0.1 * l, 0.9 * w], top: [-0.2 * l, 0.15 * l, 0.7 * w], from: 0.9, to: 1.45 },
    box("glass", -0.15 * l, 0.15 * l, 0.14, 1.45, 1.72),
    box("rear lamp", -0.72 * l, -0.68 * l, 0.12, 0.75, 0.9),
    box("head lamp", 0.68 * l, 0.73 * l, 0.12, 0.75, 0.92),
  ];
}

function person(length: number, width: number): Block[] {
  const [l, w] = [length / 2, width / 2];
  return [
    { stuff: "dark", bottom: [-0.4 * l, 0.4 * l, 0.6 * w], top: [-0.3 * l, 0.3 * l, 0.7 * w], from: 0.02, to: 0.85 },
    { stuff: "body", bottom: [-0.4 * l, 0.4 * l, 0.7 * w], top: [-0.4 * l, 0.4 * l, w], from: 0.85, to: 1.45 },
    { stuff: "load", bottom: [-0.35 * l, 0.4 * l, 0.35 * w], top: [-0.35 * l, 0.35 * l, 0.3 * w], from: 1.5, to: 1.75 },
  ];
}

/** Pairs of wheels under these places along x, a little within the sides. */
const wheels = (places: readonly number[], long: number, half: number, high: number): Block[] =>
  places.map((x) => ({
    stuff: "dark" as const,
    bottom: [x - 0.3 * long, x + 0.3 * long, 0.99 * half] as const, top: [x - 0.5 * long, x + 0.5 * long, 0.99 * half] as const, from: 0, to: 0.55 * high,
  }));

/** Lamps stand out by a hand's breadth at most, on both sides. */
function lamps(l: number, w: number, from: number, to: number): Block[] {
  return [box("rear lamp", -l - 0.03, -l + 0.05, 0.92 * w, from, to), box("head lamp", l - 0.1, l + 0.02, 0.86 * w, from, to)];
}

type Corner = readonly [number, number, number];

/** The six faces of a block, four corners each, counter-clockwise as seen from outside. */
export function faces({ bottom, top, from, to }: Block): Corner[][] {
  const ring = ([rear, front, half]: readonly [number, number, number], z: number): Corner[] =>
    [[front, half, z], [rear, half, z], [rear, -half, z], [front, -half, z]];
  const [low, high] = [ring(bottom, from), ring(top, to)];
  const sides = low.map((_, i): Corner[] => {
    const next = (i + 1) % 4;
    return [low[i]!, low[next]!, high[next]!, high[i]!];
  });
  return [...sides, [...high], [...low].reverse()];
}

/** Six vertices a face (two triangles), as one flat list of x, y, z; the four corners are entries 0, 1, 2 and 5. */
export function triangles(quads: readonly (readonly Corner[])[]): Float32Array {
  return new Float32Array(quads.flatMap(([a, b, c, d]) => [a!, b!, c!, a!, c!, d!].flat()));
}
