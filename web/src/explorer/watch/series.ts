// What the time series show, from the recordings on the clock. Pure; null where there is no value.
import type { Case, Motion } from "../../shared/case";
import type { ColourName } from "../../shared/colours";
import { boxAt, gapOf, frameAt } from "../../shared/motion";
import { accelerationAt } from "../../shared/trails";
import { type Run, spanOf } from "./run";

export type Value = number | null;

export interface Line {
  readonly label: string;
  readonly colour: ColourName;
  readonly dash: readonly number[];
  readonly values: readonly Value[];
}

export interface Panel {
  readonly name: string;
  readonly unit: string;
  readonly lines: readonly Line[];
  /** Ends of the axis. */
  readonly range: readonly [number, number];
}

export interface Series {
  /** Seconds of the clock, one a frame. */
  readonly x: readonly number[];
  readonly panels: readonly Panel[];
}

/** A ghost whose speed is drawn too. */
export interface GhostLine {
  readonly name: string;
  readonly motion: Motion;
  readonly colour: ColourName;
}

/** Beyond this, a time to collision tells nothing [s]. */
export const TTC_MOST = 10;

/** One entry a frame of the clock's span. */
export function series(runs: readonly Run[], ghosts: readonly GhostLine[]): Series {
  const dt = runs[0]!.item.dt;
  const { from, to } = spanOf(runs);
  const x = Array.from({ length: Math.round((to - from) / dt) + 1 }, (_, i) => Math.round((from + i * dt) * 1000) / 1000);
  const many = runs.length > 1;
  const lines = (make: (run: Run, name: (what: string) => string, dashed: boolean) => Line[]): Line[] =>
    runs.flatMap((run) => make(run, (what) => (many ? `${what}, ${run.mark}` : what), run.mark === "B"));
  const along = (run: Run, value: (frame: number) => Value): Value[] =>
    x.map((t) => {
      const frame = Math.round(frameAt(run.item, t + run.shift));
      return frame < 0 || frame >= run.item.frames ? null : value(frame);
    });
  const pair = (value: (item: Case, motion: Motion, frame: number) => Value): Line[] =>
    lines((run, name, dashed) =>
      pairOf(run.item).map(({ motion, what, colour }) => ({
        label: name(what), colour, dash: dashed ? [6, 4] : [], values: along(run, (frame) => value(run.item, motion, frame)),
      })),
    );

  const speed = pair((_, motion, frame) => boxAt(motion, frame)?.v ?? null);
  const first = runs[0]!;
  const shades = ghosts.map(({ name, motion, colour }) => ({
    label: name, colour, dash: [2, 3], values: along(first, (frame) => boxAt(motion, frame)?.v ?? null),
  }));
  const acceleration = pair((item, motion, frame) => accelerationAt(motion, frame, item.dt));
  const gap = lines((run, name, dashed) => [
    { label: name("gap"), colour: "ink", dash: dashed ? [6, 4] : [], values: along(run, (frame) => gapAt(run.item, frame)) },
  ]);
  const ttc = lines((run, name, dashed) => [
    { label: name("in the lane"), colour: "ink", dash: dashed ? [6, 4] : [], values: along(run, (frame) => run.item.ttc[frame] ?? null) },
    { label: name("in the plane"), colour: "plane", dash: dashed ? [6, 4] : [2, 3], values: along(run, (frame) => run.item.ttcPlane[frame] ?? null) },
  ]);
  const lateral = pair((_, motion, frame) => boxAt(motion, frame)?.y ?? null);
  const wide = Math.max(...runs.map(({ item }) => item.lanes * item.laneWidth));
  const panels: Panel[] = [
    { name: "speed", unit: "m/s", lines: [...speed, ...shades], range: around([...speed, ...shades], 6, 0) },
    { name: "acceleration", unit: "m/s²", lines: acceleration, range: around(acceleration, 4) },
    { name: gapName(first.item), unit: "m", lines: gap, range: around(gap, 10) },
    { name: "time to collision", unit: "s", lines: ttc.filter(isKnown), range: [0, TTC_MOST] },
    ...(first.item.site ? [] : [{ name: "place across the road", unit: "m", lines: lateral, range: [0, wide] as const }]),
  ];
  return { x, panels: panels.filter(({ lines: all }) => all.some(isKnown)) };
}

const isKnown = (line: Line): boolean => line.values.some((value) => value !== null);

interface Member {
  readonly motion: Motion;
  readonly what: string;
  readonly colour: ColourName;
}

/** The AV, and the vehicle that it touches, if any. */
function pairOf(item: Case): Member[] {
  const partner = item.partner > 0 ? item.vehicles[item.partner] : undefined;
  const av: Member = { motion: item.vehicles[0]!, what: "AV", colour: "av" };
  return partner ? [av, { motion: partner, what: `BV ${partner.slot}`, colour: "partner" }] : [av];
}

/** What the gap of `gapAt` is called. */
export const gapName = ({ site }: Case): string => (site ? "distance of the boxes" : "gap along the road");

/** Gap to the partner [m]; null where there is none, or it is not recorded. */
export function gapAt(item: Case, frame: number): Value {
  const partner = item.partner > 0 ? item.vehicles[item.partner] : undefined;
  const [a, b] = [boxAt(item.vehicles[0]!, frame), partner ? boxAt(partner, frame) : null];
  return a && b ? gapOf(item, a, b) : null;
}

/** Lowest and highest value with room around, at least `least` apart, so that noise does not look like a manoeuvre. */
export function around(lines: readonly Line[], least: number, floor = -Infinity): [number, number] {
  const values = lines.flatMap((line) => line.values).filter((value) => value !== null);
  if (values.length === 0) return [0, least];
  const [low, high] = [Math.min(...values), Math.max(...values)];
  const pad = Math.max((least - (high - low)) / 2, 0.06 * (high - low), 0.2);
  return [Math.max(floor, low - pad), high + pad];
}
