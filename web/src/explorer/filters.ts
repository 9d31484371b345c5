// Which cases pass which filter, and what a choice among the others would leave: crossfilter by masks and counts.
import type { CategoryColumn, Column } from "./columns";

/** Any of these names or members. */
export interface ValuesFilter {
  readonly kind: "values";
  readonly values: readonly string[];
}

/** lo <= value <= hi; infinite: open. */
export interface RangeFilter {
  readonly kind: "range";
  readonly lo: number;
  readonly hi: number;
}

export type Filter = ValuesFilter | RangeFilter;

/** 1 where a row fails. A filter that does not fit the column's kind fails nothing. */
export function failsOf(column: Column, filter: Filter): Uint8Array {
  const n = column.kind === "category" ? column.codes.length : column.values.length;
  const fails = new Uint8Array(n);
  if (filter.kind === "values" && column.kind === "category") {
    const chosen = new Set(filter.values);
    const failing = Uint8Array.from(column.names, (name, code) =>
      chosen.has(name) || column.members[code]!.some((member) => chosen.has(member)) ? 0 : 1,
    );
    const { codes } = column;
    for (let row = 0; row < n; row++) fails[row] = failing[codes[row]!]!;
  } else if (filter.kind === "values" && column.kind === "text") {
    const parts = filter.values.map((value) => value.toLowerCase());
    for (let row = 0; row < n; row++) {
      const text = column.values[row]!.toLowerCase();
      fails[row] = parts.some((part) => text.includes(part)) ? 0 : 1;
    }
  } else if (filter.kind === "range" && column.kind !== "text" && column.values) {
    const { values } = column;
    for (let row = 0; row < n; row++) fails[row] = values[row]! >= filter.lo && values[row]! <= filter.hi ? 0 : 1;
  }
  return fails;
}

/** Of each row how many masks it fails (at most 255 masks). */
export function sumOf(masks: readonly Uint8Array[], n: number): Uint8Array {
  const sum = new Uint8Array(n);
  for (const mask of masks) for (let row = 0; row < n; row++) sum[row]! += mask[row]!;
  return sum;
}

export function countPassing(fails: Uint8Array): number {
  let passing = 0;
  for (let row = 0; row < fails.length; row++) if (fails[row] === 0) passing++;
  return passing;
}

/**
 * Of each category the number of rows that pass all filters but the column's own.
 * `fails`: by row, of all masks; `own`: the mask of the column's own filter, null: it has none.
 */
export function countsOf(column: CategoryColumn, fails: Uint8Array, own: Uint8Array | null): Uint32Array {
  const counts = new Uint32Array(column.names.length);
  const { codes } = column;
  if (own === null) for (let row = 0; row < codes.length; row++) fails[row] === 0 && counts[codes[row]!]!++;
  else for (let row = 0; row < codes.length; row++) fails[row] === own[row] && counts[codes[row]!]!++;
  return counts;
}

/** Counts by member, in the order of the names that hold them. A row counts once for each of its members. */
export function byMember(column: CategoryColumn, counts: Uint32Array): Map<string, number> {
  const found = new Map<string, number>();
  column.members.forEach((members, code) => {
    for (const member of members) found.set(member, (found.get(member) ?? 0) + counts[code]!);
  });
  return found;
}

/** Where values lie on a scale of equal bins between lo and hi, or of equal ratios. */
export interface Bins {
  readonly lo: number;
  readonly hi: number;
  readonly log: boolean;
  readonly count: number;
}

/** From 0 (lo) to 1 (hi); NaN where a logarithm has no place for it. */
export function placeOf(value: number, { lo, hi, log }: Bins): number {
  if (hi === lo) return value === lo ? 0.5 : value < lo ? 0 : 1;
  if (!log) return (value - lo) / (hi - lo);
  return value > 0 ? Math.log(value / lo) / Math.log(hi / lo) : NaN;
}

/** The inverse of `placeOf`. */
export function valueAt(place: number, { lo, hi, log }: Bins): number {
  return log ? lo * (hi / lo) ** place : lo + place * (hi - lo);
}

/** Rows by bin. `fails` and `own` as in `countsOf`; without `fails` all rows count. */
export function histogramOf(values: Float64Array, bins: Bins, fails: Uint8Array | null, own: Uint8Array | null): Uint32Array {
  const counts = new Uint32Array(bins.count);
  const from = bins.log ? Math.log(bins.lo) : bins.lo;
  const width = (bins.log ? Math.log(bins.hi) : bins.hi) - from;
  for (let row = 0; row < values.length; row++) {
    if (fails !== null && fails[row] !== (own === null ? 0 : own[row])) continue;
    const value = bins.log ? Math.log(values[row]!) : values[row]!;
    const bin = width === 0 ? 0 : Math.floor(((value - from) / width) * bins.count);
    if (value >= from && value <= from + width) counts[Math.min(bin, bins.count - 1)]!++;
  }
  return counts;
}

/** Bits as the server sends them, lowest first, to a mask: 1 where the bit is not set. */
export function failsOfBits(bits: Uint8Array, n: number): Uint8Array {
  const fails = new Uint8Array(n);
  for (let row = 0; row < n; row++) fails[row] = ((bits[row >> 3] ?? 0) >> (row & 7)) & 1 ? 0 : 1;
  return fails;
}

/** Rows of `order` that pass. */
export function passingOf(order: Uint32Array, fails: Uint8Array): Uint32Array {
  const rows = new Uint32Array(order.length);
  let n = 0;
  for (let i = 0; i < order.length; i++) {
    const row = order[i]!;
    if (fails[row] === 0) rows[n++] = row;
  }
  return rows.subarray(0, n);
}
