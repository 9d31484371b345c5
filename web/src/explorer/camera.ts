// Where on the map one looks: a middle and a scale for each axis, and what zooming and moving do to them.

/** In units of the axes; `sx`, `sy`: px a unit, y upwards. */
export interface View {
  readonly x: number;
  readonly y: number;
  readonly sx: number;
  readonly sy: number;
}

export interface Size {
  readonly width: number;
  readonly height: number;
}

export interface Box {
  readonly x: readonly [number, number];
  readonly y: readonly [number, number];
}

/** Everything in sight, with a margin [px]. */
export function fit(box: Box, size: Size, margin = 34): View {
  const scale = (lo: number, hi: number, px: number) => Math.max(px - 2 * margin, 1) / (hi > lo ? hi - lo : 1);
  const middle = ([lo, hi]: readonly [number, number]) => (lo + hi) / 2;
  return { x: middle(box.x), y: middle(box.y), sx: scale(...box.x, size.width), sy: scale(...box.y, size.height) };
}

export function toScreen(view: View, size: Size, x: number, y: number): [number, number] {
  return [size.width / 2 + (x - view.x) * view.sx, size.height / 2 - (y - view.y) * view.sy];
}

export function toData(view: View, size: Size, px: number, py: number): [number, number] {
  return [view.x + (px - size.width / 2) / view.sx, view.y - (py - size.height / 2) / view.sy];
}

/** Zoom by a factor; what is under (px, py) stays there. `fitted` bounds how far: from a half to 20,000 times its scale. */
export function zoom(view: View, size: Size, factor: number, px: number, py: number, fitted: View): View {
  const wanted = (view.sx * factor) / fitted.sx;
  const by = (Math.min(20_000, Math.max(0.5, wanted)) * fitted.sx) / view.sx;
  const [x, y] = toData(view, size, px, py);
  return { x: x + (view.x - x) / by, y: y + (view.y - y) / by, sx: view.sx * by, sy: view.sy * by };
}

export function move(view: View, dx: number, dy: number): View {
  return { ...view, x: view.x - dx / view.sx, y: view.y + dy / view.sy };
}

/** Between two views, by the scale's ratio, so that zooming looks even; `part` from 0 to 1. */
export function between(a: View, b: View, part: number): View {
  const sx = a.sx * (b.sx / a.sx) ** part;
  const sy = a.sy * (b.sy / a.sy) ** part;
  // The point that both views show at the same place of the screen stays there; without one the middle moves evenly.
  const along = (p: number, q: number, s: number, t: number, now: number) => {
    if (Math.abs(t / s - 1) < 1e-9) return p + (q - p) * part;
    const still = (q * t - p * s) / (t - s);
    return still + ((p - still) * s) / now;
  };
  return { x: along(a.x, b.x, a.sx, b.sx, sx), y: along(a.y, b.y, a.sy, b.sy, sy), sx, sy };
}

/** Round values between lo and hi, about `wanted` of them. */
export function ticks(lo: number, hi: number, wanted: number): number[] {
  if (!(hi > lo)) return [];
  const raw = (hi - lo) / wanted;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw)!;
  const found: number[] = [];
  for (let i = Math.ceil(lo / step); i * step <= hi; i++) found.push(Number((i * step).toPrecision(12)));
  return found;
}
