import { describe, expect, test } from "vitest";
import type { Case, Site } from "../src/shared/case";
import { frameFor, middleOf } from "../src/shared/framing";
import { boxAt, gapAlong, gapOf } from "../src/shared/motion";
import { letterAt } from "../src/shared/site";
import { bestPlace, turned } from "../src/explorer/watch/eye";
import { vehicleBlocks } from "../src/explorer/watch/solids";
import { gapAt, gapName, series } from "../src/explorer/watch/series";
import { rearEnd, straight } from "./cases";

const SITE: Site = {
  lanes: [[-50, 2, 50, 2, 50, -2, -50, -2]], edges: [[-50, 2, 50, 2]], bars: [], stops: [[40, 2, 40, -2]],
  lights: [{ at: [39, 2, 39, -2], walks: false, from: [0, 30, 45], letters: "gyr" }],
};

/** The AV goes east, another comes from the south; they meet at frame 50. */
function crossing(): Case {
  const south = straight({ slot: 4, n: 51 });
  const bv = { ...south, x: south.x.map(() => 50), y: south.x.map((_, i) => -27 + 0.5 * i), v: south.v.map(() => 5), h: south.h.map(() => Math.PI / 2) };
  const av = straight({ v: 9.5, y: 0, n: 51 });
  return rearEnd({ vehicles: [{ ...av, lane: av.lane.map(() => -1) }, bv], site: SITE, ttc: [] });
}

test("a light shows the letter of the last change", () => {
  const light = SITE.lights[0]!;
  expect([0, 29.9, 30, 44, 45, 400].map((frame) => letterAt(light, frame))).toEqual(["g", "g", "y", "y", "r", "r"]);
});

describe("the picture of a site", () => {
  test("stands still where the two meet, while the AV is in it", () => {
    const item = crossing();
    const middles = [30, 40, 50].map((frame) => middleOf(item, boxAt(item.vehicles[0]!, frame)!, 60, 40));
    expect(middles[0]).toEqual(middles[2]);
    expect(middles[1]).toEqual(middles[2]);
    expect(Math.abs(middles[0]![0] - 49)).toBeLessThan(2);
  });
  test("follows an AV that would leave it", () => {
    const item = crossing();
    const av = boxAt(item.vehicles[0]!, 0)!;
    const [x] = middleOf(item, av, 60, 40);
    expect(x - av.x).toBeCloseTo(24);
  });
  test("is as wide wherever the other is", () => {
    expect(frameFor(crossing(), 0, 50)).toEqual({ metres: 46, ahead: 0 });
  });
});

test("the gap at a site is the distance of the boxes, on a road that along it", () => {
  const item = crossing();
  const [a, b] = [boxAt(item.vehicles[0]!, 0)!, boxAt(item.vehicles[1]!, 0)!];
  expect(gapOf(item, a, b)).toBeCloseTo(Math.hypot(49 - 2.5, 27 - 2.5 - 1), 6); // from the AV's front right corner to the other's front left one
  expect(gapOf(rearEnd(), a, b)).toBe(gapAlong(a, b));
  expect(gapAt(item, 50)).toBe(0);
  expect([gapName(item), gapName(rearEnd())]).toEqual(["distance of the boxes", "gap along the road"]);
});

test("curves of a site have no place across a road, and no TTC in a lane", () => {
  const made = series([{ item: crossing(), mark: "A", name: "", shift: 0 }], []);
  expect(made.panels.map(({ name }) => name)).toEqual(["speed", "acceleration", "distance of the boxes", "time to collision"]);
  expect(made.panels[3]!.lines.map(({ label }) => label)).toEqual(["in the plane"]);
});

test("an eye turns about the vertical and back", () => {
  const [x, y, z] = turned([-19, 0, 7.5], Math.PI / 2);
  expect([x, y, z]).toEqual([expect.closeTo(0), expect.closeTo(-19), 7.5]);
  expect(turned([x, y, z], -Math.PI / 2)).toEqual([expect.closeTo(-19), expect.closeTo(0), 7.5]);
  expect(bestPlace(crossing())).toBe("behind");
});

test("people are as large as their box", () => {
  for (const { bottom, top } of vehicleBlocks("person", 0.6, 0.6)) {
    for (const [rear, front, half] of [bottom, top]) {
      expect(Math.min(rear, -half)).toBeGreaterThanOrEqual(-0.3);
      expect(Math.max(front, half)).toBeLessThanOrEqual(0.3);
    }
  }
});
