// The address bar: what is looked at as text, and back. Pure: nothing here knows the window.
import type { Filter } from "./filters";
import type { Point } from "./lasso";

/** All that a link holds. */
export interface Place {
  readonly case: string | null;
  /** Seconds since the test began, or "crash". */
  readonly t: number | "crash" | null;
  readonly beside: string | null;
  readonly camera: "above" | "chase";
  readonly ghosts: readonly string[];
  readonly colour: string | null;
  readonly axes: readonly [string, string] | null;
  readonly lasso: readonly Point[];
  readonly sql: string;
  readonly sort: { readonly column: string; readonly descending: boolean } | null;
  /** Columns of the list; null: the usual ones. */
  readonly show: readonly string[] | null;
  readonly filters: ReadonlyMap<string, Filter>;
}

export const NOWHERE: Place = {
  case: null,
  t: null,
  beside: null,
  camera: "above",
  ghosts: [],
  colour: null,
  axes: null,
  lasso: [],
  sql: "",
  sort: null,
  show: null,
  filters: new Map(),
};

const COLUMN = /^[A-Za-z0-9_]{1,80}$/;
const CASE = /^[^/\s]{1,80}\/.{1,200}$/;
const MOST_POINTS = 500;
const MOST_TEXT = 4000;

/** The hash without its "#". Nothing in it: "". */
export function write(place: Place): string {
  const parts = new URLSearchParams();
  if (place.case !== null) parts.set("case", place.case);
  if (place.t !== null) parts.set("t", place.t === "crash" ? "crash" : String(Number(place.t.toFixed(2))));
  if (place.beside !== null) parts.set("beside", place.beside);
  if (place.camera !== "above") parts.set("camera", place.camera);
  if (place.ghosts.length > 0) parts.set("ghosts", place.ghosts.join(","));
  if (place.colour !== null) parts.set("colour", place.colour);
  if (place.axes !== null) parts.set("axes", place.axes.join(","));
  if (place.lasso.length > 0) parts.set("lasso", place.lasso.map(([x, y]) => `${short(x)},${short(y)}`).join(";"));
  if (place.sql !== "") parts.set("sql", place.sql);
  if (place.sort !== null) parts.set("sort", `${place.sort.descending ? "-" : ""}${place.sort.column}`);
  if (place.show !== null) parts.set("show", place.show.join(","));
  for (const [column, filter] of place.filters) parts.set(`f.${column}`, writeFilter(filter));
  // These may stand in a hash as they are, and a person can then read the link.
  return parts.toString().replace(/%(2C|3B|2F|3A|7C|40)/g, (code) => decodeURIComponent(code));
}

/** What a hash says, and a polite sentence for each part that says nothing. */
export function read(hash: string): { place: Place; problems: string[] } {
  const problems: string[] = [];
  const place: { -readonly [K in keyof Place]: Place[K] } = { ...NOWHERE };
  const filters = new Map<string, Filter>();
  for (const [key, value] of new URLSearchParams(hash.replace(/^#/, ""))) {
    const wrong = (why: string) => problems.push(`The link's "${shorten(key)}" ${why}; it is ignored.`);
    switch (key) {
      case "case":
        if (CASE.test(value)) place.case = value;
        else wrong(`names no case: ${shorten(value)}`);
        break;
      case "t":
        if (value === "crash") place.t = value;
        else if (isNumber(value) && Number(value) >= 0 && Number(value) < 1e6) place.t = Number(value);
        else wrong(`is no time: ${shorten(value)}`);
        break;
      case "beside":
        if (CASE.test(value) || /^av:.{1,200}$/.test(value)) place.beside = value;
        else wrong(`names neither a case nor av:NAME: ${shorten(value)}`);
        break;
      case "camera":
        if (value === "above" || value === "chase") place.camera = value;
        else wrong(`is neither above nor chase: ${shorten(value)}`);
        break;
      case "ghosts":
        place.ghosts = value.split(",").filter((name) => name !== "").slice(0, 20);
        break;
      case "colour":
        if (COLUMN.test(value)) place.colour = value;
        else wrong(`is no column: ${shorten(value)}`);
        break;
      case "axes": {
        const [x, y, ...more] = value.split(",");
        if (x && y && more.length === 0 && COLUMN.test(x) && COLUMN.test(y)) place.axes = [x, y];
        else wrong(`is not two columns: ${shorten(value)}`);
        break;
      }
      case "lasso": {
        const line = readLasso(value);
        if (line) place.lasso = line;
        else wrong("is no line of at least three points");
        break;
      }
      case "sql":
        if (value.length <= MOST_TEXT) place.sql = value;
        else wrong(`has more than ${MOST_TEXT} characters`);
        break;
      case "sort": {
        const descending = value.startsWith("-");
        const column = descending ? value.slice(1) : value;
        if (COLUMN.test(column)) place.sort = { column, descending };
        else wrong(`is no column: ${shorten(value)}`);
        break;
      }
      case "show": {
        const columns = value.split(",").filter((name) => name !== "");
        if (columns.length > 0 && columns.every((name) => COLUMN.test(name))) place.show = columns.slice(0, 40);
        else wrong(`is no list of columns: ${shorten(value)}`);
        break;
      }
      default: {
        const column = key.startsWith("f.") ? key.slice(2) : "";
        const filter = COLUMN.test(column) ? readFilter(value) : null;
        if (filter) filters.set(column, filter);
        else wrong("means nothing here");
      }
    }
  }
  place.filters = filters;
  return { place, problems };
}

/** As in the address bar: a|b|c, or lo..hi with either end open. In a value, | and \ and .. stand behind a backslash. */
export function writeFilter(filter: Filter): string {
  if (filter.kind === "values") return filter.values.map((value) => value.replace(/[\\|]|\.(?=\.)/g, "\\$&")).join("|");
  const end = (value: number) => (Number.isFinite(value) ? short(value) : "");
  return `${end(filter.lo)}..${end(filter.hi)}`;
}

/** null: it says nothing. */
export function readFilter(text: string): Filter | null {
  if (text === "" || text.length > MOST_TEXT) return null;
  const range = /^([^.\\|]*(?:\.\d[^.\\|]*)?)\.\.([^\\|]*)$/.exec(text);
  if (range) {
    const lo = range[1]!;
    const hi = range[2]!;
    if ((lo !== "" && !isNumber(lo)) || (hi !== "" && !isNumber(hi)) || (lo === "" && hi === "")) return null;
    const ends = { lo: lo === "" ? -Infinity : Number(lo), hi: hi === "" ? Infinity : Number(hi) };
    return ends.lo <= ends.hi ? { kind: "range", ...ends } : null;
  }
  const values: string[] = [];
  let value = "";
  for (let i = 0; i < text.length; i++) {
    if (text[i] === "|") {
      values.push(value);
      value = "";
    } else {
      if (text[i] === "\\" && i + 1 < text.length) i++;
      value += text[i]!;
    }
  }
  values.push(value);
  const some = values.filter((value) => value !== "");
  return some.length > 0 ? { kind: "values", values: some } : null;
}

function readLasso(text: string): Point[] | null {
  const points = text.split(";").map((pair) => pair.split(","));
  if (points.length < 3 || points.length > MOST_POINTS) return null;
  if (!points.every((pair) => pair.length === 2 && pair.every(isNumber))) return null;
  return points.map(([x, y]) => [Number(x), Number(y)] as const);
}

function isNumber(text: string): boolean {
  return /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(text.trim()) && Number.isFinite(Number(text));
}

function short(value: number): string {
  return String(Number(value.toPrecision(6)));
}

function shorten(text: string): string {
  return text.length > 60 ? `${text.slice(0, 60)}…` : text;
}
