// What the server has told so far: what there is, the columns, the notes. Columns come when something first needs them.
import { tableFromIPC } from "@uwdata/flechette";
import { batch, computed, signal } from "@preact/signals";
import { type About, ApiError, type ColumnInfo, getAbout, getColumns, getNotes, type Note, putNote } from "./api";
import { EMPTY, merged, sameNote } from "./merge";
import { categoryOf, type Column, columnsOf } from "./columns";
import type { CaseKey } from "./state";

/** Columns whose values list several things. */
const LISTED: ReadonlySet<string> = new Set(["prevented_by"]);
/** How often to ask while the analysis runs [ms]. */
const POLL = 1500;
/** When to try again to save notes [ms]. */
const RETRY = 4000;

export const about = signal<About | null>(null);
/** Why the page has no answer from the server; null: it has. */
export const failure = signal<string | null>(null);
/** A polite line for the user; each has a way to be put away. */
export const notices = signal<readonly string[]>([]);
const loaded = signal<ReadonlyMap<string, Column>>(new Map());
export const loading = signal(true);

/** Number of cases in the columns. */
export const n = computed(() => {
  const ids = loaded.value.get("case_id");
  return ids?.kind === "text" ? ids.values.length : 0;
});

export const notes = signal<Readonly<Record<CaseKey, Note>>>({});
/** How saving the notes of a case goes. */
export const saving = signal<{ readonly key: CaseKey; readonly state: "saving" | "saved" | "failed"; readonly line: string } | null>(null);

const LABELS: ColumnInfo = {
  name: "labels",
  type: "category",
  unit: "",
  meaning: "Labels that people gave to the case.",
  source: "notes",
  label: "labels",
};

/** What a case without a label is called in the column of labels. */
export const UNLABELLED = "no label";

const labelColumn = computed<Column | null>(() => {
  const texts = new Array<string>(n.value).fill(UNLABELLED);
  const members = new Map<string, readonly string[]>();
  const labelled = new Map(Object.entries(notes.value).filter(([, { labels }]) => labels.length > 0));
  const names = new Set([...labelled.keys()].map((key) => key.slice(key.indexOf("/") + 1)));
  const ids = loaded.value.get("case_id");
  for (let row = 0; names.size > 0 && row < texts.length; row++) {
    const labels = ids?.kind === "text" && names.has(ids.values[row]!) ? labelled.get(keyOf(row))?.labels : undefined;
    if (!labels) continue;
    texts[row] = labels.join(", ");
    members.set(texts[row]!, labels);
  }
  const column = categoryOf(LABELS, texts);
  return { ...column, members: column.names.map((name) => members.get(name) ?? [name]) };
});

/** All columns that are here, the labels among them. */
export const columns = computed<ReadonlyMap<string, Column>>(() => {
  const all = new Map(loaded.value);
  if (n.value > 0 && labelColumn.value) all.set(LABELS.name, labelColumn.value);
  return all;
});

/** What is known of each column by name, the labels among them. */
export const infos = computed<ReadonlyMap<string, ColumnInfo>>(() => {
  const all = new Map((about.value?.columns ?? []).map((info) => [info.name, info]));
  all.set(LABELS.name, LABELS);
  return all;
});

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

export async function readNotes(): Promise<void> {
  try {
    const read = await getNotes();
    if (saving.peek() !== null && saving.peek()!.state !== "saved") return; // what is written here is newer
    notes.value = read;
    kept.clear();
  } catch (error) {
    say(`Notes cannot be read: ${lineOf(error)}`);
  }
}

/** Of cases that were changed here, what the server was last known to hold. */
const kept = new Map<CaseKey, Note>();
let saves: Promise<void> = Promise.resolve();

/** Keep a note at once here, and soon at the server; what another page wrote meanwhile stays. `leaving`: there is no time to ask. */
export function saveNote(key: CaseKey, note: Note, leaving = false): Promise<void> {
  if (!kept.has(key)) kept.set(key, noteOf(key));
  setNote(key, note);
  saving.value = { key, state: "saving", line: "" };
  saves = leaving ? putNote(key, note) : saves.then(() => store(key, note)); // one after the other, or an older one might win
  return saves;
}

async function store(key: CaseKey, note: Note): Promise<void> {
  try {
    const now = merged(kept.get(key) ?? EMPTY, note, (await getNotes())[key] ?? EMPTY);
    await putNote(key, now);
    const isLatest = sameNote(noteOf(key), note);
    kept.set(key, isLatest ? now : note);
    if (isLatest) setNote(key, now);
    if (saving.peek()?.key === key) saving.value = { key, state: "saved", line: "" };
  } catch (error) {
    saving.value = { key, state: "failed", line: lineOf(error) };
    setTimeout(() => saving.peek()?.state === "failed" && void saveNote(key, noteOf(key)), RETRY);
  }
}

function noteOf(key: CaseKey): Note {
  return notes.peek()[key] ?? EMPTY;
}

function setNote(key: CaseKey, note: Note): void {
  const { [key]: _, ...others } = notes.peek();
  notes.value = sameNote(note, EMPTY) ? others : { ...others, [key]: note };
}

export function say(line: string): void {
  if (!notices.peek().includes(line)) notices.value = [...notices.peek(), line].slice(-4);
}

export function lineOf(error: unknown): string {
  if (error instanceof ApiError) return error.message;
  return error instanceof Error ? error.message : String(error);
}
