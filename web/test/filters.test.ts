import { describe, expect, it } from "vitest";
import type { ColumnInfo } from "../src/explorer/api";
import { categoryOf, type CategoryColumn, type NumberColumn } from "../src/explorer/columns";
import {
  type Bins, byMember, countPassing, countsOf, failsOf, failsOfBits, histogramOf, passingOf, placeOf, sumOf, valueAt,
} from "../src/explorer/filters";

const info: ColumnInfo = { name: "c", type: "category", unit: "", meaning: "", source: "library" };
const numbers = (values: number[]): NumberColumn => ({ kind: "number", info, values: Float64Array.from(values) });

const listing = (texts: (string | null)[]): CategoryColumn => {
  const column = categoryOf(info, texts);
  return { ...column, members: column.names.map((name) => name.split(",")) };
};

/** A small repeatable source of numbers in [0, 1). */
function source(seed: number) {
  let state = seed;
  return () => (state = (state * 1103515245 + 12345) % 2147483648) / 2147483648;
}

describe("masks", () => {
  it("fail what is not chosen, by name or by member", () => {
    const column = listing(["fsm,reg157", "fsm", null, "cc-human"]);
    expect([...failsOf(column, { kind: "values", values: ["reg157", "cc-human"] })]).toEqual([0, 1, 1, 0]);
    expect([...failsOf(column, { kind: "values", values: ["fsm,reg157"] })]).toEqual([0, 1, 1, 1]);
    expect([...failsOf(column, { kind: "values", values: ["not known"] })]).toEqual([1, 1, 0, 1]);
  });

  it("take both ends of a range, and no unknown value", () => {
    expect([...failsOf(numbers([1, 2, 3, NaN]), { kind: "range", lo: 2, hi: 3 })]).toEqual([1, 0, 0, 1]);
    expect([...failsOf(numbers([1, NaN]), { kind: "range", lo: -Infinity, hi: 1 })]).toEqual([0, 1]);
  });

  it("fail nothing where the filter does not fit the column", () => {
    expect([...failsOf(numbers([1, 2]), { kind: "values", values: ["a"] })]).toEqual([0, 0]);
    expect([...failsOf(categoryOf(info, ["a"]), { kind: "range", lo: 0, hi: 1 })]).toEqual([0]);
  });

  it("read the server's bits from the lowest on", () => {
    expect([...failsOfBits(Uint8Array.of(0b00000101, 0b1), 9)]).toEqual([0, 1, 0, 1, 1, 1, 1, 1, 0]);
    expect(countPassing(failsOfBits(Uint8Array.of(), 3))).toBe(0);
  });
});

describe("crossfilter", () => {
  it("counts equal those of the slow, plain way on random rows", () => {
    const next = source(7);
    const n = 2000;
    const a = categoryOf(info, Array.from({ length: n }, () => ["x", "y", "z"][Math.floor(next() * 3)]!));
    const b = categoryOf(info, Array.from({ length: n }, () => ["p", "q", null][Math.floor(next() * 3)]!));
    const c = numbers(Array.from({ length: n }, () => (next() < 0.1 ? NaN : next() * 10)));
    const masks = [
      failsOf(a, { kind: "values", values: ["x", "z"] }),
      failsOf(b, { kind: "values", values: ["q"] }),
      failsOf(c, { kind: "range", lo: 2, hi: 7 }),
    ];
    const fails = sumOf(masks, n);
    const counts = countsOf(a, fails, masks[0]!);
    a.names.forEach((name, code) => {
      let plain = 0;
      for (let row = 0; row < n; row++) {
        const others = b.names[b.codes[row]!] === "q" && c.values[row]! >= 2 && c.values[row]! <= 7;
        if (others && a.names[a.codes[row]!] === name) plain++;
      }
      expect(counts[code]).toBe(plain);
    });
    expect(counts[a.names.indexOf("y")]).toBeGreaterThan(0);
    const bins: Bins = { lo: 0, hi: 10, log: false, count: 5 };
    const histogram = histogramOf(c.values, bins, fails, masks[2]!);
    const plain = [0, 0, 0, 0, 0];
    for (let row = 0; row < n; row++) {
      if (masks[0]![row] || masks[1]![row] || Number.isNaN(c.values[row]!)) continue;
      plain[Math.floor(c.values[row]! / 2)]!++;
    }
    expect([...histogram]).toEqual(plain);
  });

  it("counts a row once for each of its members", () => {
    const column = listing(["fsm,reg157", "fsm", "fsm"]);
    const counts = countsOf(column, new Uint8Array(3), null);
    expect(Object.fromEntries(byMember(column, counts))).toEqual({ fsm: 3, reg157: 1 });
  });

  it("keeps the list's order among the rows that pass", () => {
    expect([...passingOf(Uint32Array.of(2, 0, 1), Uint8Array.of(0, 1, 0))]).toEqual([2, 0]);
  });
});

describe("bins", () => {
  it("count both ends, and positive values alone on a log scale", () => {
    expect([...histogramOf(Float64Array.from([0, 5, 10, 11, NaN]), { lo: 0, hi: 10, log: false, count: 2 }, null, null)]).toEqual([1, 2]);
    expect([...histogramOf(Float64Array.from([0, 1, 10, 100]), { lo: 1, hi: 100, log: true, count: 2 }, null, null)]).toEqual([1, 2]);
    expect([...histogramOf(Float64Array.from([4, 4]), { lo: 4, hi: 4, log: false, count: 3 }, null, null)]).toEqual([2, 0, 0]);
  });

  it("place and value are inverse", () => {
    for (const bins of [{ lo: -3, hi: 9, log: false, count: 1 }, { lo: 1e-9, hi: 0.5, log: true, count: 1 }]) {
      for (const place of [0, 0.25, 0.9, 1]) expect(placeOf(valueAt(place, bins), bins)).toBeCloseTo(place, 10);
    }
    expect(placeOf(0, { lo: 1, hi: 10, log: true, count: 1 })).toBeNaN();
  });
});
