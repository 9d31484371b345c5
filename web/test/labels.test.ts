import { expect, test } from "vitest";
import { type Rect, place } from "../src/shared/labels";

const size = { width: 400, height: 200 };
const car = (x: number, y: number): Rect => ({ x, y, w: 25, h: 10 });
const wish = (box: Rect, below = false, must = false) => ({ box, w: 20, h: 8, below, must });
const meet = (a: Rect, b: Rect) => Math.abs(a.x - b.x) < a.w + b.w && Math.abs(a.y - b.y) < a.h + b.h;

test("a name stands on the side that is wished for", () => {
  const [above] = place([wish(car(200, 100))], [car(200, 100)], size);
  const [below] = place([wish(car(200, 100), true)], [car(200, 100)], size);
  expect(above!.y).toBeLessThan(90);
  expect(below!.y).toBeGreaterThan(110);
});

test("no name covers a vehicle or another name, however crowded; one that must stand does so", () => {
  const cars = [60, 115, 170, 225, 280].flatMap((x) => [40, 62, 84, 106].map((y) => car(x, y)));
  const names = place(cars.map((box, i) => wish(box, false, i === 7)), cars, size);
  const placed = names.filter((rect) => rect !== null);
  expect(placed.length).toBeLessThan(cars.length);
  expect(names[7]).not.toBeNull();
  placed.forEach((a, i) => {
    for (const box of cars) expect(meet(a, box)).toBe(false);
    for (const b of placed.slice(i + 1)) expect(meet(a, b)).toBe(false);
  });
});

test("a name stays in the picture", () => {
  for (const [x, y] of [[5, 100], [395, 100], [200, 4], [200, 196]] as const) {
    for (const rect of place([wish(car(x, y), false, true)], [car(x, y)], size)) {
      if (rect) expect(rect.x - rect.w >= 0 && rect.x + rect.w <= 400 && rect.y - rect.h >= 0 && rect.y + rect.h <= 200).toBe(true);
    }
  }
});
