import { describe, expect, it } from "vitest";
import { between, fit, move, ticks, toData, toScreen, zoom } from "../src/explorer/camera";
import { failsOfLasso, inside, type Point, reduce, simplify } from "../src/explorer/lasso";
import { nearest, paint, radiusOf, type Scene, stampOf, stepFor } from "../src/explorer/painter";

const size = { width: 200, height: 100 };

describe("camera", () => {
  const view = fit({ x: [0, 10], y: [-1, 1] }, size);

  it("fits everything with a margin", () => {
    expect(toScreen(view, size, 0, -1)).toEqual([34, 66]);
    expect(toScreen(view, size, 10, 1)).toEqual([166, 34]);
  });

  it("keeps what is under the pointer when it zooms, within bounds", () => {
    const before = toData(view, size, 150, 30);
    const near = zoom(view, size, 3, 150, 30, view);
    const after = toData(near, size, 150, 30);
    expect(after[0]).toBeCloseTo(before[0], 12);
    expect(after[1]).toBeCloseTo(before[1], 12);
    expect(zoom(view, size, 1e-9, 0, 0, view).sx).toBeCloseTo(view.sx / 2, 12);
    expect(zoom(view, size, 1e9, 0, 0, view).sx).toBeCloseTo(view.sx * 20_000, 5);
  });

  it("moves what is drawn with the pointer", () => {
    const [x, y] = toScreen(move(view, 5, -7), size, 3, 0.5);
    const [x0, y0] = toScreen(view, size, 3, 0.5);
    expect(x - x0).toBeCloseTo(5, 10);
    expect(y - y0).toBeCloseTo(-7, 10);
  });

  it("goes from one view to another without leaving the way", () => {
    const to = zoom(view, size, 8, 150, 30, view);
    expect(between(view, to, 0)).toEqual(view);
    const end = between(view, to, 1);
    expect(end.x).toBeCloseTo(to.x, 10);
    const still = toData(view, size, 150, 30);
    const [px, py] = toScreen(between(view, to, 0.4), size, ...still);
    expect(px).toBeCloseTo(150, 8);
    expect(py).toBeCloseTo(30, 8);
  });

  it("puts ticks at round values", () => {
    expect(ticks(0, 10, 5)).toEqual([0, 2, 4, 6, 8, 10]);
    expect(ticks(-0.13, 0.26, 4)).toEqual([-0.1, 0, 0.1, 0.2]);
    expect(ticks(1, 1, 4)).toEqual([]);
  });
});

describe("lasso", () => {
  // A U, open at the top: what lies in its mouth is outside.
  const u: Point[] = [[0, 0], [6, 0], [6, 5], [4, 5], [4, 2], [2, 2], [2, 5], [0, 5]];

  it("knows inside from outside, in concave lines too", () => {
    expect(inside(1, 4, u)).toBe(true);
    expect(inside(5, 4, u)).toBe(true);
    expect(inside(3, 1, u)).toBe(true);
    expect(inside(3, 4, u)).toBe(false);
    expect(inside(7, 1, u)).toBe(false);
    expect(inside(-1, 5, u)).toBe(false);
  });

  it("gives a mask; no number is outside", () => {
    const fails = failsOfLasso(Float64Array.of(1, 3, NaN), Float64Array.of(4, 4, 1), u);
    expect([...fails]).toEqual([0, 1, 1]);
  });

  it("drops points that say nothing and keeps corners", () => {
    const line: Point[] = [[0, 0], [1, 0.01], [2, 0], [3, 0], [3, 3]];
    expect(simplify(line, 0.1)).toEqual([[0, 0], [3, 0], [3, 3]]);
    expect(simplify(line, 0.001)).toEqual(line);
    expect(simplify([[0, 0], [1, 1], [2, 2]], 0)).toEqual([[0, 0], [2, 2]]);
  });
});

describe("a lasso for a link", () => {
  it("has no more points than allowed, and still goes round the same", () => {
    const circle: Point[] = Array.from({ length: 3000 }, (_, i) => [100 * Math.cos(i / 477.5), 100 * Math.sin(i / 477.5)]);
    const line = reduce(circle, 0.001, 40);
    expect(line.length).toBeLessThanOrEqual(40);
    expect(line.length).toBeGreaterThan(10);
    for (const radius of [0, 50, 95]) expect(inside(radius, 3, line)).toBe(true);
    expect(inside(101, 0, line)).toBe(false);
  });
});

describe("painter", () => {
  const scene = (xs: number[], ys: number[], fails: number[], codes = xs.map(() => 0)): Scene => ({
    xs: Float64Array.from(xs),
    ys: Float64Array.from(ys),
    fails: Uint8Array.from(fails),
    encoding: { codes: Uint8Array.from(codes), styles: [{ colour: 0x112233, mark: "disc" }, { colour: 0xff0000, mark: "square" }] },
    lit: -1,
    radius: 2,
    ground: 0xffffff,
    faint: 0xcccccc,
  });
  const view = { x: 0, y: 0, sx: 10, sy: 10 };
  const at = (pixels: Uint32Array, x: number, y: number) => pixels[y * size.width + x]!.toString(16);

  it("draws a point where the camera sees it, in its colour, y upwards", () => {
    const pixels = new Uint32Array(size.width * size.height);
    paint(pixels, size, view, scene([3], [2], [0]));
    expect(at(pixels, 130, 30)).toBe("ff332211");
    expect(at(pixels, 130, 70)).toBe("0");
  });

  it("draws hidden points faint and below the others", () => {
    const pixels = new Uint32Array(size.width * size.height);
    paint(pixels, size, view, scene([0, 0, 5], [0, 0, 0], [0, 1, 2]));
    expect(at(pixels, 100, 50)).toBe("ff332211");
    expect(at(pixels, 150, 50)).toBe("ffcccccc");
  });

  it("clips at every border and passes over what has no place", () => {
    const pixels = new Uint32Array(size.width * size.height);
    paint(pixels, size, view, scene([-10, 9.95, 0, 1e9, NaN, 0], [0, 0, 5, 0, 0, NaN], [0, 0, 0, 0, 0, 1]));
    expect(at(pixels, 0, 50)).toBe("ff332211");
    expect(at(pixels, 199, 50)).toBe("ff332211");
    expect(at(pixels, 100, 0)).toBe("ff332211");
    // Nothing of the mark at the right border runs over into the next row's left border.
    expect(at(pixels, 0, 53)).toBe("0");
  });

  it("finds the nearest passing point, and none beyond its reach", () => {
    const points = scene([0, 0.5, 0.6], [0, 0, 0], [0, 1, 0]);
    expect(nearest(points, size, view, 104, 50, 8)).toBe(2);
    expect(nearest(points, size, view, 101, 50, 8)).toBe(0);
    expect(nearest(points, size, view, 104, 80, 8)).toBe(-1);
  });

  it("visits each point once whatever their number", () => {
    for (const n of [1, 2, 3, 10, 97, 1000, 50_000]) {
      const step = stepFor(n);
      const seen = new Set<number>();
      for (let i = 0, row = 0; i < n; i++, row = (row + step) % n) seen.add(row);
      expect(seen.size).toBe(n);
    }
  });

  it("has marks that differ, and smaller ones where there are more points", () => {
    const shapes = (["disc", "square", "triangle", "diamond", "cross", "plus", "wedge", "ring"] as const).map((mark) => stampOf(mark, 4).fill.join());
    expect(new Set(shapes).size).toBe(8);
    expect(radiusOf(100_000, size, 1)).toBe(1);
    expect(radiusOf(100_000, { width: 600, height: 600 }, 64)).toBeGreaterThan(radiusOf(100_000, { width: 600, height: 600 }, 1));
    expect(radiusOf(20, { width: 600, height: 600 }, 1)).toBe(6);
  });
});
