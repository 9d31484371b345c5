// What the user looks at, all of it: the address bar holds this and nothing else, so that a link shows the same again.
import { signal } from "@preact/signals";
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
/** Where the next case that is read begins [s], or at its crash; null: at its beginning. Whoever reads the case takes it. */
export const startAt = signal<number | "crash" | null>(null);
/** Whether time runs, and how fast. */
export const playing = signal(false);
export const rate = signal(1);
export const looping = signal(false);
/** From above, or from behind and over the AV with orbit. */
export const camera = signal<"above" | "chase">("above");
/** Names of the reference drivers shown as ghosts; "way-out" is the AV's last way out. */
export const ghosts = signal<ReadonlySet<string>>(new Set());

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
