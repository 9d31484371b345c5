import type { Case, Motion, Vehicle } from "../src/shared/case";

/** A vehicle that goes straight at one speed, in frames `from` to `from + n - 1`. */
export function straight({ x = 0, y = 2, v = 20, n = 51, from = 0, slot = 0, lane = 0, length = 5, width = 2 } = {}): Vehicle {
  const each = <T>(value: (i: number) => T) => Array.from({ length: n }, (_, i) => value(i));
  return {
    slot, kind: "car", length, width, from,
    x: each((i) => x + (from + i) * 0.1 * v), y: each(() => y), v: each(() => v), h: each(() => 0), lane: each(() => lane),
  };
}

/** A way out or a ghost of the same shape. */
export const motion = (wish: Parameters<typeof straight>[0] = {}): Motion => straight(wish);

/** The AV runs at 30 m/s into a slower vehicle ahead, at frame 50 of its test. */
export function rearEnd(more: Partial<Case> = {}): Case {
  const av = straight({ v: 30 });
  const bv = straight({ x: 55, v: 20, slot: 7 });
  return {
    id: "0:1", dt: 0.1, first: 0, frames: 51, lanes: 3, laneWidth: 4, maxSpeed: 40, vehicles: [av, bv], wayOut: null,
    critical: [1, 1, 1, 1, 1], action: ["", "", "", "", ""], p_nde: [0.5, null, 0, 0.1, 0.1], crash: 50, partner: 1,
    ttc: Array.from({ length: 51 }, (_, i) => 5 - 0.1 * i), ttcPlane: Array.from({ length: 51 }, (_, i) => (i < 10 ? null : 5 - 0.1 * i)),
    ...more,
  };
}
