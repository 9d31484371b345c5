// Draws the points of the map into a buffer of pixels. 100,000 points take some milliseconds of one core, with no
// graphics card, so that it is as smooth in a browser that draws by software as in any other.
import type { Size, View } from "./camera";
import type { Encoding, Mark } from "./scales";

/** Pixels of a mark around its middle: offsets (dx, dy) one after the other. */
interface Stamp {
  readonly fill: Int16Array;
  /** Around the fill; in the ground's colour it keeps overlapping marks apart. */
  readonly edge: Int16Array;
  readonly reach: number;
}

export interface Scene {
  /** Places of the points on the axes, by row; NaN: not drawn. */
  readonly xs: Float64Array;
  readonly ys: Float64Array;
  readonly encoding: Encoding;
  /** Not 0: the row is hidden by filters, a faint dot. */
  readonly fails: Uint8Array;
  /** Only this style is in full colour; -1: all are. */
  readonly lit: number;
  /** Radius of marks [px]. */
  readonly radius: number;
  /** Colours as 0xRRGGBB. */
  readonly ground: number;
  readonly faint: number;
}

const inMark: Record<Mark, (x: number, y: number, r: number) => boolean> = {
  disc: (x, y, r) => x * x + y * y <= r * r,
  square: (x, y, r) => Math.max(Math.abs(x), Math.abs(y)) <= 0.87 * r,
  triangle: (x, y, r) => y <= 0.75 * r && y >= -r + 1.9 * Math.abs(x) - 0.15 * r,
  diamond: (x, y, r) => Math.abs(x) + Math.abs(y) <= 1.2 * r,
  cross: (x, y, r) => Math.abs(Math.abs(x) - Math.abs(y)) <= 0.42 * r && Math.max(Math.abs(x), Math.abs(y)) <= 0.95 * r,
  plus: (x, y, r) => Math.min(Math.abs(x), Math.abs(y)) <= 0.3 * r && Math.max(Math.abs(x), Math.abs(y)) <= 1.1 * r,
  wedge: (x, y, r) => -y <= 0.75 * r && -y >= -r + 1.9 * Math.abs(x) - 0.15 * r,
  ring: (x, y, r) => x * x + y * y <= r * r && x * x + y * y >= 0.3 * r * r,
  dot: (x, y, r) => x * x + y * y <= 0.45 * r * r,
};

const stamps = new Map<string, Stamp>();

/** The pixels of a mark of radius r [px]. */
export function stampOf(mark: Mark, r: number): Stamp {
  const name = `${mark} ${r}`;
  let stamp = stamps.get(name);
  if (!stamp) stamps.set(name, (stamp = makeStamp(mark, r)));
  return stamp;
}

function makeStamp(mark: Mark, r: number): Stamp {
  const reach = Math.ceil(1.25 * r) + 1;
  const fill: number[] = [];
  const edge: number[] = [];
  const filled = (x: number, y: number) => inMark[mark](x, y, r);
  for (let y = -reach; y <= reach; y++) {
    for (let x = -reach; x <= reach; x++) {
      if (filled(x, y)) fill.push(x, y);
      else if (r >= 3 && (filled(x + 1, y) || filled(x - 1, y) || filled(x, y + 1) || filled(x, y - 1))) edge.push(x, y);
    }
  }
  if (fill.length === 0) fill.push(0, 0);
  return { fill: Int16Array.from(fill), edge: Int16Array.from(edge), reach };
}

/** How large marks are [px]: they fill a share of the plane, are larger where there are few, and grow as one comes near. */
export function radiusOf(n: number, size: Size, magnification: number): number {
  const room = 0.28 * Math.sqrt((size.width * size.height) / Math.max(n, 1));
  const near = room * Math.sqrt(Math.max(1, magnification));
  return Math.round(2 * Math.min(6, Math.max(1, near))) / 2;
}

const opaque = (colour: number) => (0xff000000 | ((colour & 0xff) << 16) | (colour & 0xff00) | (colour >> 16)) >>> 0;

/** Draw all points; `pixels` is the buffer's width * height, each one 0xAABBGGRR. Hidden ones lie below the others. */
export function paint(pixels: Uint32Array, size: Size, view: View, scene: Scene): void {
  pixels.fill(0);
  const { xs, ys, fails, encoding, lit } = scene;
  const { width, height } = size;
  const { codes, styles } = encoding;
  const faint = opaque(scene.faint);
  const n = xs.length;
  const left = width / 2 - view.x * view.sx;
  const top = height / 2 + view.y * view.sy;
  const faintStamp = stampOf("dot", 0.7 * scene.radius);
  const faintReach = faintStamp.reach;
  const faintPixels = alongRows(faintStamp.fill, width);

  for (let row = 0; row < n; row++) {
    if (fails[row] === 0 && (lit < 0 || codes[row] === lit)) continue;
    const px = Math.floor(left + xs[row]! * view.sx);
    const py = Math.floor(top - ys[row]! * view.sy);
    if (!(px >= faintReach && py >= faintReach && px < width - faintReach && py < height - faintReach)) continue;
    const at = py * width + px;
    for (let k = 0; k < faintPixels.length; k++) pixels[at + faintPixels[k]!] = faint;
  }

  const ground = opaque(scene.ground);
  const drawn = styles.map((style) => {
    const stamp = stampOf(style.mark, scene.radius);
    return { colour: opaque(style.colour), stamp, fill: alongRows(stamp.fill, width), edge: alongRows(stamp.edge, width) };
  });
  // In steps that visit each row once but do not follow their order, so that no source lies on top of all others.
  const step = stepFor(n);
  for (let i = 0, row = 0; i < n; i++, row = row + step >= n ? row + step - n : row + step) {
    if (fails[row] !== 0 || (lit >= 0 && codes[row] !== lit)) continue;
    const px = Math.floor(left + xs[row]! * view.sx);
    const py = Math.floor(top - ys[row]! * view.sy);
    const { colour, stamp, fill, edge } = drawn[codes[row]!]!;
    const { reach } = stamp;
    if (px >= reach && py >= reach && px < width - reach && py < height - reach) {
      const at = py * width + px;
      for (let k = 0; k < edge.length; k++) pixels[at + edge[k]!] = ground;
      for (let k = 0; k < fill.length; k++) pixels[at + fill[k]!] = colour;
    } else if (px > -reach && py > -reach && px < width + reach && py < height + reach) {
      clipped(pixels, size, px, py, stamp.edge, ground);
      clipped(pixels, size, px, py, stamp.fill, colour);
    }
  }
}

function alongRows(offsets: Int16Array, width: number): Int32Array {
  return Int32Array.from({ length: offsets.length / 2 }, (_, k) => offsets[2 * k + 1]! * width + offsets[2 * k]!);
}

function clipped(pixels: Uint32Array, { width, height }: Size, px: number, py: number, offsets: Int16Array, colour: number): void {
  for (let k = 0; k < offsets.length; k += 2) {
    const x = px + offsets[k]!;
    const y = py + offsets[k + 1]!;
    if (x >= 0 && y >= 0 && x < width && y < height) pixels[y * width + x] = colour;
  }
}

/** A step that has no divisor in common with n, near n / golden ratio. */
export function stepFor(n: number): number {
  const divisor = (a: number, b: number): number => (b === 0 ? a : divisor(b, a % b));
  let step = Math.max(1, Math.floor(n * 0.6180339887));
  while (step > 1 && divisor(n, step) !== 1) step--;
  return step;
}

/** The row whose point is nearest to (px, py) within `within` px and passes; -1: none. */
export function nearest(scene: Scene, size: Size, view: View, px: number, py: number, within: number): number {
  const { xs, ys, fails } = scene;
  const x = view.x + (px - size.width / 2) / view.sx;
  const y = view.y - (py - size.height / 2) / view.sy;
  let found = -1;
  let least = within * within;
  for (let row = 0; row < xs.length; row++) {
    if (fails[row] !== 0) continue;
    const dx = (xs[row]! - x) * view.sx;
    const dy = (ys[row]! - y) * view.sy;
    const away = dx * dx + dy * dy;
    if (away <= least) {
      least = away;
      found = row;
    }
  }
  return found;
}
