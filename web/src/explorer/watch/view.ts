// How watching looks, apart from what the address holds: signals that the parts of the view share.
import { computed, signal } from "@preact/signals";
import type { Colours, ColourName } from "../../shared/colours";
import { dark, readColours } from "../../shared/colours";
import type { Motion } from "../../shared/case";
import { frameFor } from "../../shared/framing";
import { crashFrame } from "../../shared/motion";
import type { Place } from "./eye";
import { BEFORE_S, type Run } from "./run";

/** Width of the picture from above [m]; null: by the width of the picture. */
export const metres = signal<number | null>(null);
/** How far the picture's middle is ahead of the AV [m]; null: so that both vehicles are seen. */
export const ahead = signal<number | null>(null);
export const trails = signal(true);
/** A loop goes over the last 5 s before the contact only. */
export const isShortLoop = signal(false);
/** Grows when the 3-D view is to look again from where it looked first. */
export const looksAnew = signal(0);
/** Steps of nearer (+1) and farther (-1) asked of the 3-D view, counted. */
export const nearer = signal(0);

/** Where the 3-D view looks from, unless a drag has turned it. */
export const lookFrom = signal<Place>("behind");

export const TRAIL_S = 3;
const [LEAST_M, MOST_M] = [16, 220];

/** So wide, and so far ahead of the AV, that both vehicles that meet are seen in the last seconds [m]. */
const framed = computed(() => {
  const each = runs.value.map(({ item }) => {
    const end = crashFrame(item);
    return frameFor(item, Math.max(0, end - Math.round(BEFORE_S / item.dt)), end);
  });
  if (each.length === 0) return { metres: LEAST_M, ahead: 0 };
  // Two pictures are looked at alike, so each has room for what both show.
  const rear = Math.min(...each.map((one) => one.ahead - one.metres / 2));
  const front = Math.max(...each.map((one) => one.ahead + one.metres / 2));
  return { metres: front - rear, ahead: (front + rear) / 2 };
});

/** Pixels a metre, at most and at least, unless the user chooses otherwise: a car is then 45 to 28 px long. */
const [NEAR_PX, FAR_PX] = [9, 5.6];

/** A picture's width in metres: what is asked for, or so that both vehicles are seen. */
export const metresFor = (width: number): number => metres.value ?? Math.max(width / NEAR_PX, Math.min(width / FAR_PX, framed.value.metres));

/** How far its middle is ahead of the AV. What does not fit stays out on the side away from the AV. */
export function aheadFor(width: number): number {
  if (ahead.value !== null) return ahead.value;
  const most = Math.max(0, metresFor(width) / 2 - 8);
  return Math.max(-most, Math.min(most, framed.value.ahead));
}

/** Show less of the road (factor below 1) or more. */
export function zoom(factor: number, width: number): void {
  metres.value = Math.max(LEAST_M, Math.min(MOST_M, metresFor(width) * factor));
}

export function resetView(): void {
  metres.value = null;
  ahead.value = null;
  looksAnew.value += 1;
}

const darkness = signal(0);
dark.addEventListener("change", () => { darkness.value += 1; });
/** Colours of the mode, light or dark. */
export const colours = computed<Colours>(() => {
  darkness.value;
  return readColours();
});

/** A ghost that is shown: its colour in charts, and on the road, which is dark in both modes. */
export interface Shade {
  readonly name: string;
  readonly motion: Motion;
  readonly colour: ColourName;
  readonly onRoad: ColourName;
}

export const WAY_OUT = "way-out";

/** Colours of a ghost: the last way out has its own, the drivers have theirs by their place in the list. */
export function ghostColours(name: string, drivers: readonly string[]): Pick<Shade, "colour" | "onRoad"> {
  if (name === WAY_OUT) return { colour: "way-out", onRoad: "way-out-box" };
  const place = ((Math.max(0, drivers.indexOf(name)) % 4) + 1) as 1 | 2 | 3 | 4;
  return { colour: `ghost-${place}`, onRoad: `ghost-${place}-box` };
}

/** What is watched: the case, and what is beside it. */
export const runs = signal<readonly Run[]>([]);
export const shades = signal<readonly Shade[]>([]);
