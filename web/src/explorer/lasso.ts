// A free-hand line around points of the map.

export type Point = readonly [x: number, y: number];

/** Whether (x, y) lies inside a closed line, by the parity of crossings. */
export function inside(x: number, y: number, line: readonly Point[]): boolean {
  let within = false;
  for (let i = 0, j = line.length - 1; i < line.length; j = i++) {
    const [xi, yi] = line[i]!;
    const [xj, yj] = line[j]!;
    if (yi > y !== yj > y && x < ((xj - xi) * (y - yi)) / (yj - yi) + xi) within = !within;
  }
  return within;
}

/** 1 where a point lies outside; points that are not a number lie outside. */
export function failsOfLasso(xs: Float64Array, ys: Float64Array, line: readonly Point[]): Uint8Array {
  let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
  for (const [x, y] of line) {
    left = Math.min(left, x);
    right = Math.max(right, x);
    low = Math.min(low, y);
    high = Math.max(high, y);
  }
  const fails = new Uint8Array(xs.length);
  for (let row = 0; row < xs.length; row++) {
    const x = xs[row]!;
    const y = ys[row]!;
    fails[row] = x >= left && x <= right && y >= low && y <= high && inside(x, y, line) ? 0 : 1;
  }
  return fails;
}

/**
 * The same line with fewer points, none of which it passes by more than `tolerance` (Ramer, Douglas, Peucker).
 * The first and the last point stay.
 */
export function simplify(line: readonly Point[], tolerance: number): Point[] {
  if (line.length < 3) return [...line];
  const keep = new Uint8Array(line.length);
  keep[0] = keep[line.length - 1] = 1;
  const open: [number, number][] = [[0, line.length - 1]];
  for (let part = open.pop(); part; part = open.pop()) {
    const [from, to] = part;
    let farthest = -1;
    let most = tolerance;
    for (let i = from + 1; i < to; i++) {
      const away = distanceTo(line[i]!, line[from]!, line[to]!);
      if (away > most) {
        most = away;
        farthest = i;
      }
    }
    if (farthest >= 0) {
      keep[farthest] = 1;
      open.push([from, farthest], [farthest, to]);
    }
  }
  return line.filter((_, i) => keep[i]);
}

/** The same line with at most `most` points: so rough as that takes, but not less than `tolerance`. */
export function reduce(line: readonly Point[], tolerance: number, most: number): Point[] {
  let rough = simplify(line, tolerance);
  for (let allowed = tolerance; rough.length > most; ) rough = simplify(line, (allowed *= 1.5));
  return rough;
}

function distanceTo([x, y]: Point, [ax, ay]: Point, [bx, by]: Point): number {
  const [dx, dy] = [bx - ax, by - ay];
  const along = dx === 0 && dy === 0 ? 0 : Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)));
  return Math.hypot(x - ax - along * dx, y - ay - along * dy);
}
