import { expect, test } from "vitest";
import { PAUSE_S, tick, whole } from "../src/shared/clock";
import { show, showSmall } from "../src/shared/format";

const once = { from: 0, to: 100, loop: false };

test("a second of real time is ten frames, by the rate", () => {
  expect(tick(0, 1, 0.1, 1, once).frame).toBeCloseTo(10);
  expect(tick(5, 0.5, 0.1, 0.1, once).frame).toBeCloseTo(5.5);
});
test("time never goes back", () => expect(tick(5, -1, 0.1, 1, once).frame).toBe(5));
test("at the end it is over, and stands on the last frame", () => {
  expect(tick(99.5, 1, 0.1, 1, once)).toEqual({ frame: 100, over: true });
});
test("a loop waits a moment on its last frame, then begins anew", () => {
  const loop = { from: 50, to: 100, loop: true };
  const waiting = tick(99, 0.4, 0.1, 1, loop);
  expect(waiting.over).toBe(false);
  expect(waiting.frame).toBeGreaterThan(100);
  expect(tick(waiting.frame, PAUSE_S, 0.1, 1, loop)).toEqual({ frame: 50, over: false });
});
test("a paused picture is a recorded frame", () => expect([3, 3.99, 2.9999999].map(whole)).toEqual([3, 3, 3]));

test("values are written as in print", () => {
  expect(show(-0.04, "m/s")).toBe("0.0 m/s");
  expect(show(-2.36, "m")).toBe("−2.4 m");
  expect(show(null, "m")).toBe("–");
  expect(show(Number.NaN, "m")).toBe("–");
  expect(show(Infinity, "s")).toBe("∞");
  expect(show(-0, "", 0)).toBe("0");
});
test("tiny numbers have two digits that tell something", () => {
  expect([0, 0.0053, 0.3, 2.6e-7, 1e-8, 1].map(showSmall)).toEqual(["0", "0.0053", "0.30", "2.6 · 10⁻⁷", "1.0 · 10⁻⁸", "1.0"]);
});
