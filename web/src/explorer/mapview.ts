// Where on the map one looks now, how that changes, and what the map does with it. Signals: the painter follows.
import { computed, effect, signal } from "@preact/signals";
import { between, fit, move, type Size, toData, type View, zoom } from "./camera";
import { type Point, reduce } from "./lasso";
import { nearest, radiusOf, type Scene } from "./painter";
import { lasso } from "./state";
import { encoding, fails, placed } from "./views";
import { lit } from "./ui";

/** Points of a lasso: a link must hold them. */
const MOST_POINTS = 150;

export const size = signal<Size>({ width: 0, height: 0 });
/** null: everything in sight. */
const chosen = signal<View | null>(null);
/** The row under the pointer; -1: none. */
export const hovered = signal(-1);
/** The line that is being drawn [px]. */
export const drawing = signal<readonly Point[]>([]);

const everything = computed<View | null>(() => {
  const { width, height } = size.value;
  return placed.value && width > 0 && height > 0 ? fit(placed.value.box, size.value) : null;
});
export const view = computed<View | null>(() => chosen.value ?? everything.value);
export const isFitted = computed(() => chosen.value === null);

/** Other axes or sources are looked at as a whole first. */
export function startFitting(): () => void {
  let before = "";
  return effect(() => {
    const { columns, box } = placed.value ?? { columns: [], box: null };
    const now = JSON.stringify([columns, box]);
    if (before !== "" && now !== before) {
      chosen.value = null;
      hovered.value = -1;
    }
    before = now;
  });
}

/** What is painted; `px`: device pixels for each px of the page. */
export function sceneOf(px: number, ground: number, faint: number): Scene | null {
  const at = placed.value;
  const colours = encoding.value;
  const now = view.value;
  if (!at || !colours || !now || at.xs.length !== fails.value.length || colours.codes.length !== at.xs.length) return null;
  const magnification = Math.sqrt((now.sx / everything.value!.sx) * (now.sy / everything.value!.sy));
  const radius = Math.round(2 * px * radiusOf(at.shown, size.value, magnification)) / 2;
  return { xs: at.xs, ys: at.ys, encoding: colours, fails: fails.value, lit: lit.value, radius, ground, faint };
}

export function moveBy(dx: number, dy: number): void {
  const now = view.peek();
  if (now) chosen.value = move(now, dx, dy);
}

export function zoomAt(factor: number, px: number, py: number): void {
  const now = view.peek();
  if (now && everything.peek()) chosen.value = zoom(now, size.peek(), factor, px, py, everything.peek()!);
}

let ticket = 0;

/** Go to another view in a fifth of a second; null: everything. */
function glide(to: View | null): void {
  const from = view.peek();
  const goal = to ?? everything.peek();
  cancelAnimationFrame(ticket);
  if (!from || !goal || window.matchMedia("(prefers-reduced-motion: reduce)").matches) {
    chosen.value = to;
    return;
  }
  const begin = performance.now();
  const frame = (now: number) => {
    const part = Math.min(1, Math.max(0, now - begin) / 200);
    chosen.value = part < 1 ? between(from, goal, part * (2 - part)) : to;
    if (part < 1) ticket = requestAnimationFrame(frame);
  };
  ticket = requestAnimationFrame(frame);
}

export function zoomBy(factor: number): void {
  const now = view.peek();
  const { width, height } = size.peek();
  if (now && everything.peek()) glide(zoom(now, size.peek(), factor, width / 2, height / 2, everything.peek()!));
}

export function fitAll(): void {
  glide(null);
}

/** The row of the nearest case that passes; -1: none near. */
export function rowAt(px: number, py: number, within: number): number {
  const scene = sceneOf(1, 0, 0);
  const now = view.peek();
  return scene && now ? nearest(scene, size.peek(), now, px, py, within) : -1;
}

/** The drawn line becomes the lasso, in units of the axes; a mere click is none. */
export function finishLasso(): void {
  const line = reduce(drawing.peek(), 1.5, MOST_POINTS);
  drawing.value = [];
  const now = view.peek();
  const at = placed.peek();
  if (line.length < 3 || !now || !at) return;
  lasso.value = line.map(([px, py]) => at.toUnits(toData(now, size.peek(), px, py)));
}
