// What the server has told so far: what there is, and the columns, which come when something first needs them.
import { tableFromIPC } from "@uwdata/flechette";
import { batch, computed, type ReadonlySignal, signal } from "@preact/signals";
import { type About, ApiError, type ColumnInfo, getAbout, getColumns } from "./api";
import { type Column, columnsOf } from "./columns";
import type { CaseKey } from "./state";

/** Columns whose values list several things. */
const LISTED: ReadonlySet<string> = new Set(["prevented_by"]);
/** How often to ask while the analysis runs [ms]. */
const POLL = 1500;

export const about = signal<About | null>(null);
/** Why the page has no answer from the server; null: it has. */
export const failure = signal<string | null>(null);
/** A polite line for the user; each has a way to be put away. */
export const notices = signal<readonly string[]>([]);
const loaded = signal<ReadonlyMap<string, Column>>(new Map());
/** All columns that are here. */
export const columns: ReadonlySignal<ReadonlyMap<string, Column>> = loaded;
export const loading = signal(true);

/** Number of cases in the columns. */
export const n = computed(() => {
  const ids = loaded.value.get("case_id");
  return ids?.kind === "text" ? ids.values.length : 0;
});

/** What is known of each column by name. */
export const infos = computed<ReadonlyMap<string, ColumnInfo>>(() => new Map((about.value?.columns ?? []).map((info) => [info.name, info])));

/** Rows that were asked for, so that a case is looked for once. */
const found = computed(() => ({ of: loaded.value, rows: new Map<CaseKey, number>() }));

/** -1: no such case. */
export function rowOf(key: CaseKey): number {
  const { of, rows } = found.value;
  const known = rows.get(key);
  if (known !== undefined) return known;
  const sources = of.get("source");
  const ids = of.get("case_id");
  const slash = key.indexOf("/");
  if (slash < 0 || sources?.kind !== "category" || ids?.kind !== "text") return -1;
  const source = sources.names.indexOf(key.slice(0, slash));
  const id = key.slice(slash + 1);
  const row = ids.values.findIndex((other, row) => other === id && sources.codes[row] === source);
  rows.set(key, row);
  return row;
}

export function keyOf(row: number): CaseKey {
  const sources = loaded.value.get("source");
  const ids = loaded.value.get("case_id");
  if (sources?.kind !== "category" || ids?.kind !== "text") return "";
  return `${sources.names[sources.codes[row]!]}/${ids.values[row]}`;
}

const wanted = new Set(["source", "case_id"]);
let asking: Promise<void> | null = null;

/** Have these columns soon; those that the server does not have are passed over. */
export function want(names: Iterable<string>): void {
  const known = about.peek()?.columns ?? [];
  for (const name of names) if (known.some((info) => info.name === name)) wanted.add(name);
  if (about.peek() && !asking && missing().length > 0) asking = fetchMissing().finally(() => (asking = null));
}

function missing(): string[] {
  return [...wanted].filter((name) => !loaded.peek().has(name));
}

async function fetchMissing(): Promise<void> {
  // Lets everything that renders now say what it needs, so that it comes in one answer.
  await Promise.resolve();
  for (let names = missing(); names.length > 0; names = missing()) {
    try {
      const more = await fetchColumns(names);
      for (const name of names) if (!more.has(name)) wanted.delete(name);
      loaded.value = new Map([...loaded.peek(), ...more]);
      batch(() => {
        loading.value = false;
        failure.value = null;
      });
    } catch (error) {
      failure.value = lineOf(error);
      return;
    }
  }
}

async function fetchColumns(names: readonly string[]): Promise<Map<string, Column>> {
  const known = new Map(about.peek()!.columns.map((info) => [info.name, info]));
  const base: ColumnInfo[] = [
    { name: "source", type: "category", unit: "", meaning: "Where the case comes from.", source: "server", ...known.get("source") },
    { name: "case_id", type: "text", unit: "", meaning: "Name of the case.", source: "library", ...known.get("case_id") },
  ];
  const asked = names.filter((name) => name !== "source" && name !== "case_id");
  const table = tableFromIPC(await getColumns(asked), { useBigInt: false });
  return columnsOf(table, [...base, ...asked.map((name) => known.get(name)!)], LISTED);
}

/** Ask the server what there is; while its analysis runs ask again, and read the columns anew when they changed. */
export async function refresh(): Promise<void> {
  try {
    const before = about.peek();
    const now = await getAbout();
    if (before && before.revision !== now.revision) {
      about.value = now;
      const had = [...loaded.peek().keys()].filter((name) => now.columns.some((info) => info.name === name));
      loaded.value = await fetchColumns(had);
    } else about.value = now;
    failure.value = null;
    if (before) want([]);
    if (now.work) setTimeout(refresh, POLL);
  } catch (error) {
    failure.value = lineOf(error);
  }
}

export function say(line: string): void {
  if (!notices.peek().includes(line)) notices.value = [...notices.peek(), line].slice(-4);
}

export function lineOf(error: unknown): string {
  if (error instanceof ApiError) return error.message;
  return error instanceof Error ? error.message : String(error);
}
