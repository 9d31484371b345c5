// Everything that the page asks of the server, and nothing else: each call throws an ApiError with the server's own line.
import type { Case, Motion } from "../shared/case";
import type { CaseKey } from "./state";

/** Where cases come from: the run's natural crashes, an adversary's library, or scripts. */
export interface Source {
  readonly name: string;
  readonly label: string;
  readonly cases: number;
  readonly natural: boolean;
  /** The command that drives one of these cases again, to which its name is added. */
  readonly replay: string;
}

export type ColumnType = "number" | "integer" | "category" | "flag" | "text";

export interface ColumnInfo {
  readonly name: string;
  readonly type: ColumnType;
  readonly unit: string;
  readonly meaning: string;
  readonly source: string;
  /** Short name for people, without the unit. */
  readonly label?: string;
  /** Of categories: what each value is called, in a sensible order. */
  readonly values?: Readonly<Record<string, string>>;
}

/** What to look at first. `filters` reads as in the address bar, without its "f.". */
export interface StartCard {
  readonly title: string;
  readonly case: CaseKey;
  readonly text: string;
  readonly often: string;
  readonly filters: Readonly<Record<string, string>>;
}

export interface Work {
  readonly what: string;
  readonly done: number;
  readonly total: number;
}

export interface Download {
  readonly format: string;
  readonly label: string;
}

export interface About {
  readonly name: string;
  readonly av: string;
  readonly version: string;
  readonly headline: string;
  readonly adversary: string;
  readonly sources: readonly Source[];
  /** Grows when the columns change. */
  readonly revision: number;
  /** Analysis under way; null: none. */
  readonly work: Work | null;
  /** Other AVs that `getCaseWith` takes. */
  readonly avs: readonly string[];
  /** The reference drivers of `getGhosts`. */
  readonly drivers: readonly string[];
  readonly downloads: readonly Download[];
  readonly columns: readonly ColumnInfo[];
  readonly start: readonly StartCard[];
  /** Lines to show, such as of a damaged shard. */
  readonly warnings?: readonly string[];
}

export interface Fact {
  readonly name: string;
  readonly value: number | string | boolean | null;
  readonly unit: string;
  readonly meaning: string;
}

/** A case to watch, with what is said about it. */
export interface WatchedCase extends Case {
  readonly key: CaseKey;
  readonly title: string;
  /** Some sentences. */
  readonly verdict: string;
  readonly facts: readonly Fact[];
}

/** The same case driven by another AV. */
export interface CaseWith extends Case {
  /** "SOURCE/CASE_ID@AV". */
  readonly key: string;
  readonly title?: string;
  readonly verdict?: string;
  readonly facts?: readonly Fact[];
}

/** A reference driver in the AV's place. */
export interface Ghost {
  readonly motion: Motion;
  readonly prevents: boolean;
  /** Seconds since the test began; null: it does not react. */
  readonly reacts_s: number | null;
}

export interface Ghosts {
  readonly drivers: Readonly<Record<string, Ghost>>;
}

/** What the server said instead of an answer; status 0: the server did not answer at all. */
export class ApiError extends Error {
  readonly status: number;

  constructor(message: string, status: number) {
    super(message);
    this.name = "ApiError";
    this.status = status;
  }
}

async function ask(path: string, init?: RequestInit): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(path, init);
  } catch (cause) {
    if (cause instanceof DOMException && cause.name === "AbortError") throw cause;
    throw new ApiError("The server does not answer. Is `cornerforge serve` still running?", 0);
  }
  if (response.ok) return response;
  throw new ApiError(await lineOf(response), response.status);
}

async function lineOf(response: Response): Promise<string> {
  const text = await response.text().catch(() => "");
  try {
    const said: unknown = JSON.parse(text);
    if (said !== null && typeof said === "object" && "error" in said && typeof said.error === "string") return said.error;
  } catch {
    // Not JSON: the status is all there is to say.
  }
  return `The server answered ${response.status} ${response.statusText}.`;
}

async function askJson<T>(path: string, init?: RequestInit): Promise<T> {
  return (await (await ask(path, init)).json()) as T;
}

/** "natural/0:12" as a path: each part is encoded, the slash between source and name stays. */
function pathOf(key: CaseKey): string {
  const slash = key.indexOf("/");
  return `${encodeURIComponent(key.slice(0, slash))}/${encodeURIComponent(key.slice(slash + 1))}`;
}

export function getAbout(): Promise<About> {
  return askJson("api/about");
}

/** An Arrow IPC stream: one row a case, in one fixed order; `source` and `case_id` are always among the columns. */
export async function getColumns(names: readonly string[]): Promise<Uint8Array> {
  return new Uint8Array(await (await ask(`api/columns?names=${names.map(encodeURIComponent).join(",")}`)).arrayBuffer());
}

export function getCase(key: CaseKey, signal?: AbortSignal): Promise<WatchedCase> {
  return askJson(`api/case/${pathOf(key)}`, signal ? { signal } : {});
}

export function getGhosts(key: CaseKey, signal?: AbortSignal): Promise<Ghosts> {
  return askJson(`api/case/${pathOf(key)}/ghosts`, signal ? { signal } : {});
}

export function getCaseWith(key: CaseKey, av: string, signal?: AbortSignal): Promise<CaseWith> {
  return askJson(`api/case/${pathOf(key)}/with/${encodeURIComponent(av)}`, signal ? { signal } : {});
}

export function downloadUrl(key: CaseKey, format: string): string {
  return `api/case/${pathOf(key)}/download/${encodeURIComponent(format)}`;
}

/** One bit a case in the order of `getColumns`, lowest bit first: where the condition holds. */
export async function postSql(where: string, signal?: AbortSignal): Promise<Uint8Array> {
  const init: RequestInit = {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ where }),
    ...(signal ? { signal } : {}),
  };
  return new Uint8Array(await (await ask("api/sql", init)).arrayBuffer());
}
