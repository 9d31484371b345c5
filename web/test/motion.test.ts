import { describe, expect, test } from "vitest";
import { boxAt, changesTo, commonArea, corners, crashFrame, criticalAt, decisionAt, frameAt, gapAlong, secondsAt, touch, valueAt } from "../src/shared/motion";
import { accelerationAt, brakes, trail } from "../src/shared/trails";
import { motion, rearEnd, straight } from "./cases";

const box = (x: number, y: number, h = 0, length = 4, width = 2) => ({ x, y, v: 10, h, lane: 0, length, width });

describe("a moment between two recorded frames", () => {
  const gap = { ...motion({ n: 4, from: 10, v: 10 }), x: [10, 11, null, 13] };
  test("is on the straight line between them", () => expect(valueAt(gap, "x", 10.25)).toBeCloseTo(10.25));
  test("is not known beside a frame that was not recorded", () => {
    for (const frame of [11.5, 12, 12.5]) expect(boxAt(gap, frame), String(frame)).toBeNull();
    expect(boxAt(gap, 11)?.x).toBe(11);
    expect(boxAt(gap, 13)?.x).toBe(13);
  });
  test("is not known before the first and after the last", () => {
    for (const frame of [9, 9.5, 13.5, 14, -1]) expect(boxAt(gap, frame), String(frame)).toBeNull();
  });
  test("has the lane of the frame before it", () => {
    const changing = { ...motion({ n: 3 }), lane: [0, 1, 1] };
    expect([0, 0.9, 1].map((frame) => boxAt(changing, frame)?.lane)).toEqual([0, 0, 1]);
  });
});

test("seconds and frames are the inverse of each other, also where the first frames are left out", () => {
  const item = { dt: 0.1, first: 37, frames: 100 };
  for (const frame of [0, 3, 99]) expect(frameAt(item, secondsAt(item, frame))).toBeCloseTo(frame, 9);
});

test("a decision holds for 10 frames of the test, the last one to the end; none before any", () => {
  const item = rearEnd({ first: 8, critical: [1, -1, 1], vehicles: rearEnd().vehicles });
  expect([0, 1, 2, 11, 12, 40].map((frame) => decisionAt(item, frame))).toEqual([0, 0, 1, 1, 2, 2]);
  expect(criticalAt(item, 2)).toBe(-1);
  expect(criticalAt(rearEnd({ critical: [] }), 0)).toBe(-1);
});

describe("where two boxes touch", () => {
  test("is the middle of what they have in common", () => {
    const { area, middle } = touch(box(0, 0), box(3, 1));
    expect(area).toHaveLength(4);
    expect(middle[0]).toBeCloseTo(1.5);
    expect(middle[1]).toBeCloseTo(0.5);
  });
  test("is half way, where rounding has parted them", () => {
    const { area, middle } = touch(box(0, 0), box(0, 2.002));
    expect(area).toEqual([]);
    expect(middle[1]).toBeCloseTo(1.001);
  });
  test("does not depend on which is named first", () => {
    const [a, b] = [box(0, 0, 0.3), box(2, 1, -0.2)];
    expect(touch(a, b).middle[0]).toBeCloseTo(touch(b, a).middle[0], 9);
    expect(touch(a, b).middle[1]).toBeCloseTo(touch(b, a).middle[1], 9);
  });
  test("turned boxes: a square in a square that is turned by 45 degrees", () => {
    const area = commonArea(corners(box(0, 0, Math.PI / 4, 2, 2)), corners(box(0, 0, 0, 2, 2)));
    expect(area).toHaveLength(8);
  });
});

test("the gap is from bumper to bumper, whoever is ahead", () => {
  expect(gapAlong(box(0, 0), box(10, 0))).toBe(6);
  expect(gapAlong(box(10, 0), box(0, 0))).toBe(6);
  expect(gapAlong(box(0, 0), box(1, 3))).toBe(-3);
});

test("a vehicle changes lanes while it is away from the middle of the lane that it drives to", () => {
  expect(changesTo({ ...box(0, 2), lane: 1 }, 4)).toBe(6);
  expect(changesTo({ ...box(0, 5.9), lane: 1 }, 4)).toBeNull();
  expect(changesTo({ ...box(0, 2), lane: -1 }, 4)).toBeNull();
});

test("the frame of the crash is one that was recorded; without a crash it is the last", () => {
  expect(crashFrame({ crash: null, frames: 20 })).toBe(19);
  expect(crashFrame({ crash: 20, frames: 20 })).toBe(19);
  expect(crashFrame({ crash: 7, frames: 20 })).toBe(7);
});

describe("what recent motion tells", () => {
  const slowing = { ...straight({ n: 4 }), v: [10, 10, 9.5, 9] };
  test("acceleration, in the middle and at both ends", () => {
    expect([0, 1, 2, 3].map((frame) => accelerationAt(slowing, frame, 0.1))).toEqual([0, expect.closeTo(-2.5), expect.closeTo(-5), expect.closeTo(-5)]);
    expect(accelerationAt(slowing, 4, 0.1)).toBeNull();
    expect(accelerationAt({ ...slowing, v: [null, 3, null, 3] }, 1, 0.1)).toBeNull();
  });
  test("braking", () => expect([1, 2, 3].map((frame) => brakes(slowing, frame, 0.1))).toEqual([false, true, true]));
  test("a trail ends where nothing was recorded, and is newest first", () => {
    const points = trail(straight({ n: 20, from: 5, v: 10 }), 15, 3, 0.1);
    expect(points).toHaveLength(11);
    expect(points[0]).toEqual({ x: 15, y: 2, age: 0 });
    expect(points.at(-1)!.age).toBeCloseTo(1);
    expect(trail(straight(), 60, 3, 0.1)).toEqual([]);
  });
});
