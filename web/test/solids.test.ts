import { describe, expect, test } from "vitest";
import { inFront } from "../src/explorer/watch/painter";
import { faces, triangles, vehicleBlocks } from "../src/explorer/watch/solids";

describe.each([["car", 5, 2], ["truck", 16.5, 2.55], ["truck", 8, 2.4], ["motorcycle", 2.2, 0.8]] as const)("a %s of %d m", (kind, length, width) => {
  const blocks = vehicleBlocks(kind, length, width);
  const points = blocks.flatMap(faces).flat();

  test("keeps to its length and width, within a few centimetres of its lamps, and stands on the ground", () => {
    const reach = (k: 0 | 1) => Math.max(...points.map((p) => Math.abs(p[k])));
    expect(Math.abs(reach(0) - length / 2)).toBeLessThan(0.05);
    expect(reach(1)).toBeLessThanOrEqual(width / 2 + 1e-9);
    expect(Math.min(...points.map((p) => p[2]))).toBeGreaterThanOrEqual(0);
  });

  test("has a front and a rear that can be told apart", () => {
    const middle = (stuff: string) => {
      const found = blocks.filter((block) => block.stuff === stuff).flatMap(faces).flat();
      return found.reduce((sum, p) => sum + p[0], 0) / found.length;
    };
    expect(middle("rear lamp")).toBeLessThan(-0.3 * length);
    expect(middle("head lamp")).toBeGreaterThan(0.3 * length);
  });

  test("shows each face to the outside", () => {
    for (const block of blocks) {
      const all = faces(block);
      const corner = all.flat();
      const middle = [0, 1, 2].map((k) => corner.reduce((sum, p) => sum + p[k]!, 0) / corner.length);
      for (const [a, b, c] of all) {
        const [u, v] = [b!.map((x, k) => x - a![k]!), c!.map((x, k) => x - b![k]!)] as [number[], number[]];
        const normal = [u[1]! * v[2]! - u[2]! * v[1]!, u[2]! * v[0]! - u[0]! * v[2]!, u[0]! * v[1]! - u[1]! * v[0]!];
        const out = normal.reduce((sum, n, k) => sum + n * (a![k]! - middle[k]!), 0);
        expect(out).toBeGreaterThan(-1e-9);
      }
    }
  });

  test("is made of finite triangles, two a face", () => {
    const list = triangles(blocks.flatMap(faces));
    expect(list).toHaveLength(blocks.length * 6 * 6 * 3);
    expect(list.every(Number.isFinite)).toBe(true);
  });
});

describe("what lies in front of the camera", () => {
  test("is all of a face, or none of it", () => {
    const face = [[0, 0, -5], [1, 0, -5], [1, 1, -5]] as const;
    expect(inFront(face)).toHaveLength(3);
    expect(inFront(face.map(([x, y, z]) => [x, y, -z] as const))).toEqual([]);
  });
  test("or the part of it before the cut", () => {
    const cut = inFront([[0, 0, -2], [0, 0, 2], [1, 0, 2], [1, 0, -2]], 1);
    expect(cut).toHaveLength(4);
    for (const [, , z] of cut) expect(z).toBeLessThanOrEqual(-1 + 1e-12);
  });
});
