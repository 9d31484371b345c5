// What the panes show, computed from the state and the columns: which cases pass, in which order, where, in which colour.
import { batch, computed, effect, signal } from "@preact/signals";
import { ApiError, type ColumnInfo, postSql } from "./api";
import type { Box } from "./camera";
import { type Column, extentOf, orderOf, valuesOf } from "./columns";
import { about, columns, infos, keyOf, lineOf, n, rowOf, want } from "./data";
import { countPassing, failsOf, failsOfBits, type Filter, passingOf, sumOf } from "./filters";
import { onceIn, plainName } from "./format";
import { failsOfLasso, type Point } from "./lasso";
import { binsOf, encodeCategories, encodeNumbers, type Encoding } from "./scales";
import { axes, beside, colour, filters, lasso, open, show, sort, sql, watched } from "./state";
import { dark } from "./theme";
import { listOver } from "./ui";

/** Bins of histograms. */
export const BINS = 28;

/** The usual filters in their order; those that a library lacks are left out. `open`: unfolded from the start. */
export const USUAL_FILTERS: readonly { readonly column: string; readonly open: boolean }[] = [
  { column: "prevention", open: true },
  { column: "mechanism", open: true },
  { column: "crash_type", open: true },
  { column: "impact_speed_mps", open: true },
  { column: "conduct", open: false },
  { column: "way_out", open: false },
  { column: "prevented_by", open: false },
  { column: "striker", open: false },
  { column: "side", open: false },
  { column: "fault", open: false },
  { column: "fault_rule", open: false },
  { column: "bv_kind", open: false },
  { column: "av_lane", open: false },
  { column: "relative_lane", open: false },
  { column: "often", open: false },
  { column: "role", open: false },
];

/** Colours that are asked for most. */
export const USUAL_COLOURS = [
  "prevention", "mechanism", "crash_type", "cluster", "avoidability", "prevented_by", "way_out", "conduct", "impact_speed_mps",
  "av_injury_probability", "often", "value", "role",
];
export const USUAL_AXES = ["pc1", "pc2", "impact_speed_mps", "av_speed_mps", "crash_time_s", "relative_lon_m", "relative_lat_m", "often", "value"];
const USUAL_LIST = {
  natural: ["case_id", "mechanism", "crash_type", "often", "prevention", "impact_speed_mps"],
  made: ["case_id", "mechanism", "crash_type", "value", "prevention", "impact_speed_mps"],
  both: ["source", "case_id", "mechanism", "crash_type", "prevention", "impact_speed_mps", "often", "value"],
};
/** What the list shows instead where there is no analysis. */
const PLAIN_LIST = ["case_id", "mechanism", "crash_type", "av_speed_mps", "bv_speed_mps", "crash_time_s"];

const has = (name: string) => infos.value.has(name);

export const colourColumn = computed(() => {
  if (colour.value !== null && has(colour.value)) return colour.value;
  return USUAL_COLOURS.find(has) ?? null;
});

export const axisColumns = computed<readonly [string, string] | null>(() => {
  if (axes.value && axes.value.every(has)) return axes.value;
  if (has("pc1") && has("pc2")) return ["pc1", "pc2"];
  const numbers = [...USUAL_AXES, ...infos.value.keys()].filter((name) => isNumeric(infos.value.get(name)));
  return numbers.length > 1 ? [numbers[0]!, numbers[1]!] : null;
});

export const listColumns = computed<readonly string[]>(() => {
  if (show.value) return show.value.filter((name) => name === "case_id" || has(name));
  const other = has("mechanism") ? "crash_type" : "mechanism";
  return (has("prevention") ? USUAL_LIST[shownKind.value] : PLAIN_LIST).filter((name) => has(name) && name !== other);
});

// Signals of their own, so that what depends on the source alone stays as it is when other filters change.
const sourceFilter = computed(() => filters.value.get("source"));
const sourceColumn = computed(() => columns.value.get("source"));

/** Whether the chosen sources hold natural cases, made ones, or both. */
export const shownKind = computed<"natural" | "made" | "both">(() => {
  const filter = sourceFilter.value;
  const chosen = (about.value?.sources ?? []).filter(({ name }) => filter?.kind !== "values" || filter.values.includes(name));
  return chosen.every(({ natural }) => natural) ? "natural" : chosen.some(({ natural }) => natural) ? "both" : "made";
});

export const sorting = computed(() => {
  if (sort.value && (sort.value.column === "case_id" || has(sort.value.column))) return sort.value;
  if (has("often") && shownKind.value !== "made") return { column: "often", descending: true };
  return has("value") ? { column: "value", descending: true } : { column: "case_id", descending: false };
});

export function isNumeric(info: ColumnInfo | undefined): boolean {
  return info?.type === "number" || info?.type === "integer";
}

/** The usual filters of this library, then what else a link or the user chose. */
export const shownFilters = computed(() => {
  const usual = USUAL_FILTERS.filter(({ column }) => has(column));
  const more = [...filters.value.keys()].filter((name) => name !== "source" && has(name) && !usual.some(({ column }) => column === name));
  return [...usual, ...more.map((column) => ({ column, open: true }))];
});

/** Short name of a column for people. */
export function nameOf(column: string): string {
  if (column === "case_id") return "case";
  return infos.value.get(column)?.label ?? plainName(column);
}

/** What a category is called. */
export function wordOf(column: string, value: string): string {
  return infos.value.get(column)?.values?.[value] ?? value;
}

export function sourceLabel(name: string): string {
  return about.value?.sources.find((source) => source.name === name)?.label ?? name;
}

/** Fetches the columns that the panes need now. */
export function startWanting(): () => void {
  return effect(() => {
    if (!about.value) return;
    const needed = [...listColumns.value, ...filters.value.keys(), sorting.value.column, ...shownFilters.value.map(({ column }) => column)];
    if (colourColumn.value) needed.push(colourColumn.value);
    if (axisColumns.value) needed.push(...axisColumns.value);
    want([...needed, "often"]);
  });
}

// Which cases pass.

/** Answer of the server to the SQL condition: which rows fail; null: no condition, or no answer yet. */
const sqlFails = signal<Uint8Array | null>(null);
export const sqlState = signal<{ readonly state: "idle" | "asking" | "failed"; readonly line: string }>({ state: "idle", line: "" });

/** Asks the server whenever the condition changes, or the number of cases does. */
export function startAsking(): () => void {
  let abort: AbortController | null = null;
  return effect(() => {
    const where = sql.value.trim();
    const rows = n.value;
    void about.value?.revision;
    abort?.abort();
    if (where === "" || rows === 0) {
      sqlFails.value = null;
      sqlState.value = { state: "idle", line: "" };
      return;
    }
    const asked = (abort = new AbortController());
    sqlState.value = { state: "asking", line: "" };
    postSql(where, asked.signal).then(
      (bits) => {
        if (asked.signal.aborted) return;
        sqlFails.value = failsOfBits(bits, rows);
        sqlState.value = { state: "idle", line: "" };
      },
      (error: unknown) => {
        if (asked.signal.aborted) return;
        sqlFails.value = null;
        sqlState.value = { state: "failed", line: error instanceof ApiError ? error.message : lineOf(error) };
      },
    );
  });
}

interface Kept {
  readonly column: unknown;
  readonly filter: unknown;
  readonly mask: Uint8Array;
}

let kept = new Map<string, Kept>();

/** By column (and "#lasso", "#sql") which rows fail. A mask is computed again only when its filter or column changed. */
export const masks = computed<ReadonlyMap<string, Uint8Array>>(() => {
  const now = new Map<string, Kept>();
  const keep = (name: string, column: unknown, filter: unknown, make: () => Uint8Array) => {
    const old = kept.get(name);
    now.set(name, old && old.column === column && old.filter === filter ? old : { column, filter, mask: make() });
  };
  for (const [name, filter] of filters.value) {
    const column = columns.value.get(name);
    if (column) keep(name, column, filter, () => failsOf(column, filter));
  }
  const line = lasso.value;
  if (line.length > 2 && placed.value) {
    const { xs, ys, toAxis } = placed.value;
    keep("#lasso", placed.value, line, () => failsOfLasso(xs, ys, line.map(toAxis)));
  }
  if (sqlFails.value && sqlFails.value.length === n.value) {
    const mask = sqlFails.value;
    keep("#sql", mask, null, () => mask);
  }
  kept = now;
  return new Map([...now].map(([name, { mask }]) => [name, mask]));
});

/** By row how many filters it fails. */
export const fails = computed(() => sumOf([...masks.value.values()], n.value));
export const passing = computed(() => countPassing(fails.value));
const order = computed(() => {
  const { column, descending } = sorting.value;
  return orderOf(column === "case_id" ? null : (columns.value.get(column) ?? null), n.value, descending);
});
/** Rows that pass, in the list's order. */
export const rows = computed(() => passingOf(order.value, fails.value));

/** How often all natural cases that pass happen together, in words; "": none is natural. */
export const together = computed(() => {
  const often = columns.value.get("often");
  if (often?.kind !== "number") return "";
  let sum = 0;
  const failing = fails.value;
  for (let row = 0; row < failing.length; row++) if (failing[row] === 0 && often.values[row]! > 0) sum += often.values[row]!;
  return onceIn(sum);
});

/** Whether anything but the choice of a source hides cases. */
export const isFiltered = computed(() => [...filters.value.keys()].some((name) => name !== "source") || lasso.value.length > 0 || sql.value !== "");

export function setFilter(column: string, filter: Filter | null): void {
  const next = new Map(filters.peek());
  if (filter === null) next.delete(column);
  else next.set(column, filter);
  filters.value = next;
}

export function toggleValue(column: string, value: string): void {
  const filter = filters.peek().get(column);
  const values = filter?.kind === "values" ? filter.values : [];
  const next = values.includes(value) ? values.filter((other) => other !== value) : [...values, value];
  setFilter(column, next.length > 0 ? { kind: "values", values: next } : null);
}

/** Only this value; once more: all again. */
export function onlyValue(column: string, value: string): void {
  const filter = filters.peek().get(column);
  const alone = filter?.kind === "values" && filter.values.length === 1 && filter.values[0] === value;
  setFilter(column, alone ? null : { kind: "values", values: [value] });
}

/** Clear all filters; the choice of a source is no filter and stays. */
export function clearAll(): void {
  const source = filters.peek().get("source");
  filters.value = new Map(source ? [["source", source]] : []);
  lasso.value = [];
  sql.value = "";
}

// Where the cases lie on the map.

export interface Placed {
  readonly columns: readonly [string, string];
  /** By row, on a log axis the decimal logarithm; NaN: no place, or another source. */
  readonly xs: Float64Array;
  readonly ys: Float64Array;
  readonly log: readonly [boolean, boolean];
  readonly box: Box;
  /** Cases of the chosen sources that have a place, and that have none. */
  readonly shown: number;
  readonly missing: number;
  /** From units of the axes to places, and back. */
  readonly toAxis: (point: Point) => Point;
  readonly toUnits: (point: Point) => Point;
}

/** Rows of other sources than the chosen ones; null: all sources are chosen. */
export const sourceMask = computed(() => (sourceFilter.value && sourceColumn.value ? failsOf(sourceColumn.value, sourceFilter.value) : null));

export const placed = computed<Placed | null>(() => {
  const names = axisColumns.value;
  if (!names) return null;
  const [a, b] = names.map((name) => columns.value.get(name)) as [Column | undefined, Column | undefined];
  const [va, vb] = [a && valuesOf(a), b && valuesOf(b)];
  if (!a || !b || !va || !vb) return null;
  const log = [binsOf(a.info, va, 1)?.log ?? false, binsOf(b.info, vb, 1)?.log ?? false] as const;
  const xs = new Float64Array(va.length);
  const ys = new Float64Array(va.length);
  const hidden = sourceMask.value;
  let missing = 0;
  let shown = 0;
  for (let row = 0; row < xs.length; row++) {
    const x = log[0] ? Math.log10(va[row]!) : va[row]!;
    const y = log[1] ? Math.log10(vb[row]!) : vb[row]!;
    const other = hidden !== null && hidden[row] === 1;
    const isPlaced = !other && Number.isFinite(x) && Number.isFinite(y);
    if (isPlaced) shown++;
    else if (!other) missing++;
    xs[row] = isPlaced ? x : NaN;
    ys[row] = isPlaced ? y : NaN;
  }
  const on = (value: number, isLog: boolean) => (isLog ? Math.log10(Math.max(value, Number.MIN_VALUE)) : value);
  const off = (value: number, isLog: boolean) => (isLog ? 10 ** value : value);
  return {
    columns: names,
    xs,
    ys,
    log,
    box: { x: extentOf(xs) ?? [0, 1], y: extentOf(ys) ?? [0, 1] },
    shown,
    missing,
    toAxis: ([x, y]) => [on(x, log[0]), on(y, log[1])],
    toUnits: ([x, y]) => [off(x, log[0]), off(y, log[1])],
  };
});

/** Colours and marks of the cases. */
export const encoding = computed<Encoding | null>(() => {
  const column = colourColumn.value === null ? undefined : columns.value.get(colourColumn.value);
  if (column?.kind === "category") return encodeCategories(column, dark.value);
  if (column?.kind !== "number") return null;
  const bins = binsOf(column.info, column.values, BINS);
  return bins && encodeNumbers(column.values, bins, dark.value);
});

// The case that is watched, and the one under the cursor.

/** Row under the cursor of list and map; -1: none. */
export const cursor = signal(-1);

/** Watch a case, with the cursor on it. A case of a source that is not shown brings its source. */
export function watch(key: string, play = false): void {
  const source = key.slice(0, key.indexOf("/"));
  const chosen = sourceFilter.peek();
  batch(() => {
    if (chosen?.kind === "values" && !chosen.values.includes(source)) setFilter("source", { kind: "values", values: [source] });
    open(key, null, play);
    cursor.value = rowOf(key);
  });
}

/** Show a case beside the one that is watched; where none is, watch it. */
export function putBeside(key: string): void {
  if (watched.peek() === null || watched.peek() === key) watch(key);
  else {
    beside.value = key;
    listOver.value = false;
  }
}

/** Move the cursor along the list. `follow`: a case that is watched gives way to the new one. */
export function step(by: number, follow = true): void {
  const all = rows.peek();
  if (all.length === 0) return;
  const at = all.indexOf(cursor.peek());
  const to = at < 0 ? (by > 0 ? 0 : all.length - 1) : Math.min(all.length - 1, Math.max(0, at + by));
  cursor.value = all[to]!;
  if (follow && watched.peek() !== null) watch(keyOf(all[to]!));
}
