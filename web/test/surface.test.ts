import { expect, test } from "vitest";
import { type Line, outlines, strokes, surfaceOf } from "../src/shared/surface";
import { rearEnd } from "./cases";

test("a road that the case says nothing of has all its lanes from end to end", () => {
  const { areas, lines } = surfaceOf(rearEnd());
  expect(outlines({ areas, lines }, -50, 80, 0.3)).toEqual([[[-50, -0.3], [80, -0.3], [80, 12.3], [-50, 12.3]]]);
  expect(lines.map(([, y, , , mark]) => [y, mark])).toEqual([[0, "solid"], [4, "broken"], [8, "broken"], [12, "solid"]]);
});

test("asphalt ends where its lanes do, and becomes narrower as they do", () => {
  const surface = { areas: [[null, 20, 0, 4, 0, 4], [20, 60, 0, 4, 4, 4]], lines: [] } as const;
  expect(outlines(surface, -50, 80, 0)).toEqual([[[-50, 0], [20, 0], [20, 4], [-50, 4]], [[20, 0], [60, 4], [60, 4], [20, 4]]]);
});

test("dashes stand still on the road, whatever the picture shows of it", () => {
  const line: Line = [null, 4, 30, 4, "broken"];
  expect(strokes(line, -1, 14)).toEqual([[[0, 4], [3, 4]], [[12, 4], [14, 4]]]);
  expect(strokes(line, 11, 100)).toEqual([[[12, 4], [15, 4]], [[24, 4], [27, 4]]]);
  expect(strokes(line, 31, 100)).toEqual([]);
});

test("slanted lines and lines across are whole, a hatch keeps within its rectangle", () => {
  expect(strokes([20, 0, 60, 4, "solid"], 30, 40)).toEqual([[[20, 0], [60, 4]]]);
  expect(strokes([7, 8, 7, 12, "barrier"], 0, 40)).toEqual([[[7, 8], [7, 12]]]);
  expect(strokes([7, 8, 20, 12, "hatch"], 0, 40)).toEqual([[[12, 8], [15, 12]]]);
});
