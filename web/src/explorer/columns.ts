// The columns of all cases as typed arrays: what filters, the map and the list compute with. No object a row anywhere.
import { type Column as ArrowColumn, type Table, Type } from "@uwdata/flechette";
import type { ColumnInfo } from "./api";

/** What a category is called where the value is not known. */
export const NOT_KNOWN = "not known";
/** Integers with at most so many different values (lanes, clusters) are shown as categories. */
const FEW = 12;

export interface NumberColumn {
  readonly kind: "number";
  readonly info: ColumnInfo;
  /** NaN: not known. */
  readonly values: Float64Array;
}

export interface CategoryColumn {
  readonly kind: "category";
  readonly info: ColumnInfo;
  /** Of each row the index into `names`. */
  readonly codes: Uint16Array;
  /** Most frequent first (numbers and yes/no: in their order); what is not known comes last. */
  readonly names: readonly string[];
  /** Where a name lists several things ("fsm,reg157"): the things. Else each name is its only member. */
  readonly members: readonly (readonly string[])[];
  /** Where the categories are integers: the values by row. */
  readonly values: Float64Array | null;
}

export interface TextColumn {
  readonly kind: "text";
  readonly info: ColumnInfo;
  readonly values: readonly string[];
}

export type Column = NumberColumn | CategoryColumn | TextColumn;

/** Decode one column of the server's table. `listed`: its names list things, with commas or spaces between them. */
export function columnOf(info: ColumnInfo, values: ArrowColumn<unknown>, listed = false): Column {
  const n = values.length;
  switch (info.type) {
    case "text": {
      const texts = new Array<string>(n);
      let row = 0;
      for (const value of values) texts[row++] = value === null ? "" : String(value);
      return { kind: "text", info, values: texts };
    }
    case "number":
      return { kind: "number", info, values: numbersOf(values) };
    case "integer": {
      const numbers = numbersOf(values);
      return integersAsCategory(info, numbers) ?? { kind: "number", info, values: numbers };
    }
    case "flag":
      return categoryOf(info, map(values, (value) => (value === null ? null : value ? "yes" : "no")), (a, b) => (a < b ? 1 : -1));
    case "category":
      return arranged(info, dictionaryOf(values) ?? collected(map(values, textOf)), givenOrder(info), listed);
  }
}

/** A few values stand in the server's order, so that each has the same colour in every run; of many the most frequent come first. */
function givenOrder(info: ColumnInfo): Order | undefined {
  const given = Object.keys(info.values ?? {});
  if (given.length === 0 || given.length > FEW) return undefined;
  const place = (name: string) => (given.includes(name) ? given.indexOf(name) : given.length);
  return (a, b) => place(a) - place(b) || (a < b ? -1 : 1);
}

export function columnsOf(table: Table, infos: readonly ColumnInfo[], listed: ReadonlySet<string>): Map<string, Column> {
  const found = new Map<string, Column>();
  for (const info of infos) {
    const values = table.getChild(info.name) as ArrowColumn<unknown> | null | undefined;
    if (values) found.set(info.name, columnOf(info, values, listed.has(info.name)));
  }
  return found;
}

function numbersOf(values: ArrowColumn<unknown>): Float64Array {
  const numbers = new Float64Array(values.length);
  let row = 0;
  for (const value of values) numbers[row++] = value === null ? NaN : Number(value);
  return numbers;
}

function* map<T>(values: Iterable<unknown>, f: (value: unknown) => T): Generator<T> {
  for (const value of values) yield f(value);
}

function integersAsCategory(info: ColumnInfo, numbers: Float64Array): CategoryColumn | null {
  const different = new Set<number>();
  for (const value of numbers) {
    if (!Number.isNaN(value)) different.add(value);
    if (different.size > FEW) return null;
  }
  const texts = map(numbers, (value) => (Number.isNaN(value as number) ? null : String(value)));
  const column = categoryOf(info, texts, (a, b) => Number(a) - Number(b));
  return { ...column, values: numbers };
}

/** A category column from its texts by row; null: not known. */
export function categoryOf(info: ColumnInfo, texts: Iterable<string | null>, order?: Order): CategoryColumn {
  return arranged(info, collected(texts), order, false);
}

type Order = (a: string, b: string) => number;

const textOf = (value: unknown): string | null => (value === null ? null : String(value));

/** Different texts, and of each row which one it has. */
interface Coded {
  readonly texts: readonly (string | null)[];
  readonly codes: ArrayLike<number>;
}

function collected(texts: Iterable<string | null>): Coded {
  const first = new Map<string | null, number>();
  const codes: number[] = [];
  for (const text of texts) {
    let code = first.get(text);
    if (code === undefined) first.set(text, (code = first.size));
    codes.push(code);
  }
  return { texts: [...first.keys()], codes };
}

/** What a part of a column with a dictionary offers. */
interface Keyed {
  readonly length: number;
  readonly nullCount: number;
  readonly cache: Iterable<unknown>;
  key(row: number): number;
  isValid(row: number): boolean;
}

/** The codes as the server sends them; null: the column is not sent with one dictionary. */
function dictionaryOf(values: ArrowColumn<unknown>): Coded | null {
  if (values.type.typeId !== Type.Dictionary || values.data.length === 0) return null;
  const batches = values.data as unknown as readonly Keyed[];
  const dictionary = batches[0]!.cache;
  if (batches.some((batch) => batch.cache !== dictionary)) return null;
  const texts = [...dictionary].map(textOf);
  if (new Set(texts).size < texts.length || texts.includes(null)) return null;
  const codes = new Uint16Array(values.length);
  let row = 0;
  for (const batch of batches) {
    const isWhole = batch.nullCount === 0;
    for (let i = 0; i < batch.length; i++) codes[row++] = isWhole || batch.isValid(i) ? batch.key(i) : texts.length;
  }
  return { texts: [...texts, null], codes };
}

/** The categories that occur, in order: of most rows first, if no other order is given; what is not known last. */
function arranged(info: ColumnInfo, { texts, codes }: Coded, order: Order | undefined, listed: boolean): CategoryColumn {
  const counts = new Uint32Array(texts.length);
  for (let row = 0; row < codes.length; row++) counts[codes[row]!]!++;
  const place = new Map(texts.map((text, code) => [text, code]));
  const frequent: Order = (a, b) => counts[place.get(b)!]! - counts[place.get(a)!]! || (a < b ? -1 : 1);
  const known = texts.filter((text, code): text is string => text !== null && counts[code]! > 0).sort(order ?? frequent);
  const unknown = place.get(null);
  const names = unknown !== undefined && counts[unknown]! > 0 ? [...known, NOT_KNOWN] : known;
  const next = new Uint16Array(texts.length).fill(known.length);
  known.forEach((name, code) => (next[place.get(name)!] = code));
  const arrangedCodes = new Uint16Array(codes.length);
  for (let row = 0; row < codes.length; row++) arrangedCodes[row] = next[codes[row]!]!;
  return {
    kind: "category",
    info,
    codes: arrangedCodes,
    names,
    members: names.map((name) => (listed && name !== NOT_KNOWN ? name.split(/[,\s]+/).filter(Boolean) : [name])),
    values: null,
  };
}

/** Numbers by row, for axes and ramps; null: the column has none. */
export function valuesOf(column: Column): Float64Array | null {
  return column.kind === "text" ? null : column.values;
}

/** The smallest and largest finite value, [lo, hi]; null: there is none. */
export function extentOf(values: Float64Array, positive = false): [number, number] | null {
  let lo = Infinity;
  let hi = -Infinity;
  for (let i = 0; i < values.length; i++) {
    const value = values[i]!;
    if (!Number.isFinite(value) || (positive && value <= 0)) continue;
    if (value < lo) lo = value;
    if (value > hi) hi = value;
  }
  return lo <= hi ? [lo, hi] : null;
}

/** Rows in the order of a column; what is not known comes last whatever the direction. Ties keep the order of rows. */
export function orderOf(column: Column | null, n: number, descending: boolean): Uint32Array {
  const rows = new Uint32Array(n);
  for (let row = 0; row < n; row++) rows[row] = row;
  if (column === null) return descending ? rows.reverse() : rows;
  const sign = descending ? -1 : 1;
  if (column.kind === "text") {
    const { values } = column;
    return rows.sort((a, b) => {
      const x = values[a]!;
      const y = values[b]!;
      if (x === y) return a - b;
      if (x === "" || y === "") return x === "" ? 1 : -1;
      return x < y ? -sign : sign;
    });
  }
  const keys = column.values ?? keysOfCodes(column as CategoryColumn);
  return rows.sort((a, b) => {
    const x = keys[a]!;
    const y = keys[b]!;
    if (x === y) return a - b;
    if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) ? (Number.isNaN(y) ? a - b : 1) : -1;
    return (x - y) * sign || a - b;
  });
}

function keysOfCodes(column: CategoryColumn): Float64Array {
  const alphabetical = column.names.map((name, code) => ({ name, code })).sort((a, b) => (a.name < b.name ? -1 : 1));
  const rank = new Float64Array(column.names.length);
  alphabetical.forEach(({ name, code }, index) => (rank[code] = name === NOT_KNOWN ? NaN : index));
  return Float64Array.from(column.codes, (code) => rank[code]!);
}
