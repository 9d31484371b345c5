// From values to colours and marks that colour-blind readers can tell apart: Okabe and Ito's colours, each with a mark
// of its own, for categories; for numbers a straight line in OKLab from blue to yellow, which is even in lightness.
import { type CategoryColumn, extentOf, NOT_KNOWN } from "./columns";
import type { Bins } from "./filters";
import type { ColumnInfo } from "./api";

export type Mark = "disc" | "square" | "triangle" | "diamond" | "cross" | "plus" | "wedge" | "ring" | "dot";

/** Colours as 0xRRGGBB. */
export interface Style {
  readonly colour: number;
  readonly mark: Mark;
}

const LIGHT = [0x0072b2, 0xd55e00, 0x009e73, 0xcc79a7, 0xe69f00, 0x56b4e9, 0x1b1f24, 0x8a7d00];
const DARK = [0x2b95d6, 0xe5702a, 0x2fc79a, 0xcc79a7, 0xe69f00, 0x9bd4f5, 0xe6e9ec, 0xf0e442];
const MARKS: readonly Mark[] = ["disc", "square", "triangle", "diamond", "cross", "plus", "wedge", "ring"];
/** Categories without a colour of their own share this one. */
const GREY = { light: 0x8a939d, dark: 0x79838e };
/** What is not known is no finding: it is grey however often it is. */
const GREYED: ReadonlySet<string> = new Set([NOT_KNOWN, "not judged"]);

export const LEVELS = 64;

/** The style of each category, in the order of `names`. From the ninth on they are grey dots. */
export function categoryStyles(names: readonly string[], dark: boolean): Style[] {
  const colours = dark ? DARK : LIGHT;
  let next = 0;
  return names.map((name) => {
    if (GREYED.has(name) || next >= colours.length) return { colour: dark ? GREY.dark : GREY.light, mark: "dot" };
    return { colour: colours[next]!, mark: MARKS[next++]! };
  });
}

/** Colour at a place from 0 to 1. High values stand out: dark blue on a light page, yellow on a dark one. */
export function ramp(place: number, dark: boolean): number {
  const [from, to] = dark ? RAMP.dark : RAMP.light;
  const t = Math.min(1, Math.max(0, place));
  return rgbOf(from[0] + (to[0] - from[0]) * t, from[1] + (to[1] - from[1]) * t, from[2] + (to[2] - from[2]) * t);
}

// OKLab: lightness, green to red, blue to yellow.
const RAMP = {
  light: [[0.86, -0.02, 0.155], [0.36, -0.01, -0.125]],
  dark: [[0.46, -0.012, -0.12], [0.94, -0.025, 0.16]],
} as const;

/** Lightness in OKLab of a colour, 0 to 1. */
export function lightnessOf(colour: number): number {
  const [r, g, b] = [16, 8, 0].map((shift) => {
    const c = ((colour >> shift) & 255) / 255;
    return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  }) as [number, number, number];
  const l = Math.cbrt(0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b);
  const m = Math.cbrt(0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b);
  const s = Math.cbrt(0.0883024619 * r + 0.2817188376 * g + 0.6299787005 * b);
  return 0.2104542553 * l + 0.793617785 * m - 0.0040720468 * s;
}

function rgbOf(lightness: number, a: number, b: number): number {
  const l = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (lightness - 0.0894841775 * a - 1.291485548 * b) ** 3;
  const channels = [
    4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
    -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
    -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s,
  ].map((c) => {
    const encoded = c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055;
    return Math.round(255 * Math.min(1, Math.max(0, encoded)));
  }) as [number, number, number];
  return (channels[0] << 16) | (channels[1] << 8) | channels[2];
}

export function cssOf(colour: number): string {
  return `#${colour.toString(16).padStart(6, "0")}`;
}

/** Rates and probabilities, and whatever spans a factor of a thousand, are shown by their logarithm. */
export function binsOf(info: ColumnInfo, values: Float64Array, count: number): Bins | null {
  const all = extentOf(values);
  if (all === null) return null;
  const rate = /probability|(^|_)(often|weight|rate|p)($|_)/.test(info.name);
  const positive = extentOf(values, true);
  if (positive !== null && all[0] >= 0 && positive[1] > positive[0] && (rate || positive[1] / positive[0] >= 1000)) {
    // A few values next to 0 would take most of the scale: it ends nine powers of ten below the largest.
    if (rate || all[0] > 0) return { lo: Math.max(positive[0], positive[1] / 1e9), hi: positive[1], log: true, count };
  }
  return { lo: all[0], hi: all[1], log: false, count };
}

/** By row an index into `styles`: what the painter draws. */
export interface Encoding {
  readonly codes: Uint8Array;
  readonly styles: readonly Style[];
}

export function encodeCategories(column: CategoryColumn, dark: boolean): Encoding {
  const styles = categoryStyles(column.names, dark).slice(0, 256);
  return { codes: Uint8Array.from(column.codes, (code) => Math.min(code, 255)), styles };
}

export function encodeNumbers(values: Float64Array, bins: Bins, dark: boolean): Encoding {
  const styles: Style[] = Array.from({ length: LEVELS }, (_, level) => ({ colour: ramp(level / (LEVELS - 1), dark), mark: "disc" }));
  styles.push({ colour: dark ? GREY.dark : GREY.light, mark: "dot" });
  const from = bins.log ? Math.log(bins.lo) : bins.lo;
  const width = (bins.log ? Math.log(bins.hi) : bins.hi) - from || 1;
  const codes = new Uint8Array(values.length);
  for (let row = 0; row < values.length; row++) {
    const value = bins.log ? Math.log(values[row]!) : values[row]!;
    const level = Math.round(((value - from) / width) * (LEVELS - 1));
    codes[row] = Number.isNaN(level) || value === -Infinity ? LEVELS : Math.min(LEVELS - 1, Math.max(0, level));
  }
  return { codes, styles };
}
