// Recordings on one clock: the case that is watched, and what is shown beside it. Pure.
import { clamp } from "../../shared/clock";
import type { Case } from "../../shared/case";
import { crashFrame, frameAt, secondsAt } from "../../shared/motion";

/** A recording on the clock of the watched case, which counts seconds from the begin of its test. */
export interface Run {
  readonly item: Case;
  /** "A" for the watched one, "B" for the one beside it. */
  readonly mark: "A" | "B";
  /** What the reader calls it. */
  readonly name: string;
  /** Added to the clock's time: the time in this recording's own test [s]. */
  readonly shift: number;
}

export interface Span {
  readonly from: number;
  readonly to: number;
}

/** How long before the contact a case opens, and the short loop begins [s]. */
export const BEFORE_S = 5;

/** Time of the contact [s], or of the end, where there was none. */
export const contactAt = (item: Case): number => secondsAt(item, crashFrame(item));

/**
 * What is added to the clock's time for the recording beside: nothing where both drive the same test, else what brings the
 * two contacts together.
 */
export const shiftOf = (a: Case, b: Case, isSameTest: boolean): number =>
  isSameTest ? 0 : round(contactAt(b) - contactAt(a));

const round = (seconds: number): number => Math.round(seconds * 1000) / 1000;

/** Frame of a recording at a time of the clock; before its begin and after its end it stands still. */
export const frameOf = ({ item, shift }: Run, time: number): number =>
  // Rounded, so that 81 recorded frames of 0.1 s are frame 81 and not a hair before it.
  clamp(Math.round(frameAt(item, time + shift) * 1e6) / 1e6, 0, item.frames - 1);

/** Whether a recording moves at a time of the clock. */
export function isOn({ item, shift }: Run, time: number): boolean {
  const frame = frameAt(item, time + shift);
  return frame > -1e-6 && frame < item.frames - 1 + 1e-6;
}

/** From the first begin to the last end of all of them, in the clock's time. */
export function spanOf(runs: readonly Run[]): Span {
  const from = Math.min(...runs.map(({ item, shift }) => secondsAt(item, 0) - shift));
  const to = Math.max(...runs.map(({ item, shift }) => secondsAt(item, item.frames - 1) - shift));
  return { from: round(from), to: round(to) };
}

/** The stretch that is played: all, or the last seconds before the contact of the watched case. */
export function stretchOf(runs: readonly Run[], isShort: boolean): Span {
  const all = spanOf(runs);
  const first = runs[0];
  if (!isShort || !first) return all;
  const end = contactAt(first.item) - first.shift;
  return { from: Math.max(all.from, round(end - BEFORE_S)), to: Math.min(all.to, round(end)) };
}

/** Where a case opens: 5 s before its contact, if it was driven that long; or where the address says. */
export function opensAt(item: Case, wish: number | "crash" | null): number {
  const [first, last] = [secondsAt(item, 0), secondsAt(item, item.frames - 1)];
  const contact = contactAt(item);
  return clamp(wish === "crash" ? contact : (wish ?? contact - BEFORE_S), first, last);
}

/** The time of the recorded frame at or before a time, as a paused picture shows it. */
export function settled(item: Case, time: number): number {
  const steps = Math.floor(time / item.dt + 1e-6);
  return round(steps * item.dt);
}
