import { expect, test } from "vitest";
import { frameFor } from "../src/shared/framing";
import type { Case } from "../src/shared/case";

const motion = (x: number[]) => ({
  slot: 0, kind: "car" as const, length: 5, width: 2, from: 0, x, y: x.map(() => 0), v: x.map(() => 30), h: x.map(() => 0), lane: x.map(() => 0),
});
const drive = (others: number[], partner = 1): Case => ({
  id: "0:1", dt: 0.1, first: 0, frames: others.length, lanes: 3, laneWidth: 3.7, maxSpeed: 40, wayOut: null, critical: [], action: [],
  p_nde: [], crash: others.length - 1, partner, ttc: [], ttcPlane: [], vehicles: [motion(others.map((_, i) => 3 * i)), motion(others)],
});

test("both vehicles stay in the first picture", () => {
  // From 60 m behind the AV to its rear bumper.
  const { metres, ahead } = frameFor(drive([-60, -40, -20, 4]), 0, 3);
  for (const gap of [-60, -43, -26, -5, 0]) expect(Math.abs(gap - ahead)).toBeLessThan(metres / 2);
  expect(ahead).toBe(-30);
});

test("the first picture is neither too near nor too wide, and does without a partner", () => {
  expect(frameFor(drive([0, 3, 6]), 0, 2)).toEqual({ metres: 46, ahead: 0 });
  expect(frameFor(drive([-500, 3]), 0, 1).metres).toBe(110);
  expect(frameFor(drive([-60, 3], -1), 0, 1)).toEqual({ metres: 46, ahead: 0 });
});
