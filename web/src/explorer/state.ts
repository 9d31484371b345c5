// What the user looks at, all of it: the address bar holds this and nothing else, so that a link shows the same again.
import { batch, signal } from "@preact/signals";
import type { Filter } from "./filters";
import type { Point } from "./lasso";

/** A case by its source and its name there, such as "natural/0:12". */
export type CaseKey = string;

/** The case that is watched; null: none. */
export const watched = signal<CaseKey | null>(null);
/** What is shown beside it, in step: another case, or `av:NAME`, the same case driven by another AV; null: nothing. */
export const beside = signal<string | null>(null);
/** Seconds since the test began; what is drawn. */
export const time = signal(0);
/** Whether time runs, and how fast. */
export const playing = signal(false);
export const rate = signal(1);
export const looping = signal(false);
/** From above, or from behind and over the AV with orbit. */
export const camera = signal<"above" | "chase">("above");
/** Names of the reference drivers shown as ghosts; "way-out" is the AV's last way out. */
export const ghosts = signal<ReadonlySet<string>>(new Set());

/** Where the next case opens: at a time of its test, at its contact ("crash"), or (null) 5 s before its contact. */
export const opening = signal<number | "crash" | null>(null);

/** Watch a case. It plays at once only where the user asked for it, as with a Play button. */
export function open(key: CaseKey, at: number | "crash" | null = null, play = false): void {
  batch(() => {
    opening.value = at;
    playing.value = play;
    beside.value = null;
    watched.value = key;
  });
}

/** By the name of the column. */
export const filters = signal<ReadonlyMap<string, Filter>>(new Map());
/** Around cases of the map, in units of its axes; empty: none. */
export const lasso = signal<readonly Point[]>([]);
/** A condition for the server; "": none. */
export const sql = signal("");
/** Columns; null: the usual ones (`views.ts` says which). */
export const colour = signal<string | null>(null);
export const axes = signal<readonly [string, string] | null>(null);
export const sort = signal<{ readonly column: string; readonly descending: boolean } | null>(null);
export const show = signal<readonly string[] | null>(null);
