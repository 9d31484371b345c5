// The clock of watching: moves `time` while `playing`, and does what buttons and keys ask.
import { batch, effect } from "@preact/signals";
import { clamp, tick } from "../../shared/clock";
import { camera, ghosts, looping, playing, rate, time } from "../state";
import type { Command } from "./keys";
import { type Span, contactAt, settled, spanOf, stretchOf } from "./run";
import { isShortLoop, nearer, resetView, runs, trails, zoom } from "./view";

const calm = window.matchMedia("(prefers-reduced-motion: reduce)");

export const RATES = [0.1, 0.25, 0.5, 1, 2] as const;

const dt = (): number => runs.peek()[0]?.item.dt ?? 0.1;
const span = (): Span => spanOf(runs.peek());
const stretch = (): Span => stretchOf(runs.peek(), looping.peek() && isShortLoop.peek());

/** Show a moment: a recorded frame, and time stands still. */
export function seek(seconds: number): void {
  const first = runs.peek()[0];
  if (!first) return;
  const { from, to } = span();
  batch(() => {
    playing.value = false;
    time.value = clamp(settled(first.item, seconds), from, to);
  });
}

export function togglePlay(): void {
  if (!playing.peek()) playing.value = true;
  else seek(time.peek());
}

/** Runs while a case is watched; what is returned ends it. */
export function startClock(): () => void {
  let ticket = 0;
  const stop = effect(() => {
    cancelAnimationFrame(ticket);
    if (!playing.value || runs.value.length === 0) return;
    let last = performance.now();
    const { from, to } = stretch();
    const isOutside = time.peek() >= to - 1e-6 || (looping.peek() && time.peek() < from);
    let at = isOutside ? from : time.peek();
    let shown = at;
    const step = (now: number) => {
      const within = stretch();
      const passed = Math.max(0, now - last) / 1000;
      last = now;
      if (Math.abs(time.peek() - shown) > 1e-6) at = time.peek(); // moved by somebody else
      const ends = { from: within.from / dt(), to: within.to / dt(), loop: looping.peek() };
      const next = tick(at / dt(), passed, dt(), rate.peek(), ends);
      at = next.frame * dt();
      batch(() => {
        shown = Math.min(at, within.to);
        // For people who ask for less motion the pictures step from one recorded frame to the next.
        if (calm.matches) shown = settled(runs.peek()[0]!.item, shown);
        time.value = shown;
        if (next.over) playing.value = false;
      });
      if (!next.over) ticket = requestAnimationFrame(step);
    };
    time.value = at;
    ticket = requestAnimationFrame(step);
  });
  return () => { stop(); cancelAnimationFrame(ticket); };
}

/** Off, all, the last 5 s, off. */
export function nextLoop(): void {
  batch(() => {
    if (!looping.peek()) [looping.value, isShortLoop.value] = [true, false];
    else if (!isShortLoop.peek()) isShortLoop.value = true;
    else looping.value = false;
  });
}

export function toggleGhost(name: string): void {
  const next = new Set(ghosts.peek());
  if (!next.delete(name)) next.add(name);
  ghosts.value = next;
}

/** Do what a key asks. `manoeuvre`: when it began [s of the clock]; null: not known. `width` of the picture [px]. */
export function obey(command: Command, manoeuvre: number | null, width: number): void {
  const first = runs.peek()[0];
  if (!first) return;
  const now = time.peek();
  const changeRate = (by: number) => {
    const place = RATES.findIndex((one) => one >= rate.peek() - 1e-9);
    rate.value = RATES[clamp((place < 0 ? RATES.length - 1 : place) + by, 0, RATES.length - 1)]!;
  };
  const zoomBy = (factor: number) => {
    if (camera.peek() === "above") zoom(factor, width);
    else nearer.value += factor < 1 ? 1 : -1;
  };
  const acts: Record<Command, () => void> = {
    play: togglePlay,
    back: () => seek(Math.ceil(now / dt() - 1e-6) * dt() - dt()),
    on: () => seek(now + dt()),
    "back-second": () => seek(now - 1),
    "on-second": () => seek(now + 1),
    begin: () => seek(span().from),
    end: () => seek(span().to),
    slower: () => changeRate(-1),
    faster: () => changeRate(1),
    manoeuvre: () => { if (manoeuvre !== null) seek(manoeuvre); },
    contact: () => seek(contactAt(first.item)),
    loop: nextLoop,
    view: () => { camera.value = camera.peek() === "above" ? "chase" : "above"; },
    in: () => zoomBy(0.8),
    out: () => zoomBy(1.25),
    reset: resetView,
    trails: () => { trails.value = !trails.peek(); },
    "way-out": () => toggleGhost("way-out"),
  };
  acts[command]();
}
