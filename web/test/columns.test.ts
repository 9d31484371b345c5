import { columnFromArray, dictionary, tableFromArrays, tableFromColumns, tableFromIPC, tableToIPC, utf8 } from "@uwdata/flechette";
import { describe, expect, it } from "vitest";
import type { ColumnInfo, ColumnType } from "../src/explorer/api";
import { categoryOf, type CategoryColumn, columnOf, columnsOf, extentOf, NOT_KNOWN, orderOf } from "../src/explorer/columns";

const info = (name: string, type: ColumnType): ColumnInfo => ({ name, type, unit: "", meaning: "", source: "library" });

/** Through the bytes that a server would send. */
function decoded(values: unknown[], type: ColumnType, listed = false) {
  const bytes = tableToIPC(tableFromArrays({ c: values }), { format: "stream" })!;
  return columnOf(info("c", type), tableFromIPC(bytes).getChild("c")!, listed);
}

describe("decoding columns", () => {
  it("makes a missing number NaN and keeps the others", () => {
    const column = decoded([1.5, null, -2], "number");
    expect(column.kind === "number" && [...column.values]).toEqual([1.5, NaN, -2]);
  });

  it("puts the most frequent category first and what is not known last", () => {
    const column = decoded(["b", "a", null, null, null, "a"], "category") as CategoryColumn;
    expect(column.names).toEqual(["a", "b", NOT_KNOWN]);
    expect([...column.codes]).toEqual([1, 0, 2, 2, 2, 0]);
  });

  it("reads the codes of a dictionary as the texts they stand for", () => {
    const texts = ["b", "a", null, "b", "c", null, "b"];
    const arrow = columnFromArray(texts, dictionary(utf8()));
    const bytes = tableToIPC(tableFromColumns({ c: arrow }), { format: "stream" })!;
    const fast = columnOf(info("c", "category"), tableFromIPC(bytes).getChild("c")!) as CategoryColumn;
    const slow = categoryOf(info("c", "category"), texts);
    expect(fast.names).toEqual(slow.names);
    expect([...fast.codes]).toEqual([...slow.codes]);
    expect([...fast.codes].map((code) => fast.names[code])).toEqual(texts.map((text) => text ?? NOT_KNOWN));
  });

  it("splits names that list several things", () => {
    const column = decoded(["fsm,reg157", "fsm", null], "category", true) as CategoryColumn;
    expect(column.members[column.codes[0]!]).toEqual(["fsm", "reg157"]);
    expect(column.members[column.codes[2]!]).toEqual([NOT_KNOWN]);
  });

  it("shows few integers as categories in their order, many as numbers", () => {
    const few = decoded([10, 2, 2, null], "integer") as CategoryColumn;
    expect(few.names).toEqual(["2", "10", NOT_KNOWN]);
    expect([...few.values!]).toEqual([10, 2, 2, NaN]);
    expect(decoded(Array.from({ length: 30 }, (_, i) => i), "integer").kind).toBe("number");
  });

  it("calls flags yes and no, yes first", () => {
    const column = decoded([false, true, false], "flag") as CategoryColumn;
    expect(column.names).toEqual(["yes", "no"]);
    expect([...column.codes]).toEqual([1, 0, 1]);
  });

  it("leaves out columns that the table lacks", () => {
    const table = tableFromIPC(tableToIPC(tableFromArrays({ a: [1] }), { format: "stream" })!);
    expect([...columnsOf(table, [info("a", "number"), info("b", "number")], new Set()).keys()]).toEqual(["a"]);
  });
});

describe("order of rows", () => {
  const numbers = (values: number[]) => ({ kind: "number", info: info("c", "number"), values: Float64Array.from(values) }) as const;

  it("sorts up and down with unknown values last, ties by row", () => {
    const column = numbers([3, NaN, 1, 3, -Infinity]);
    expect([...orderOf(column, 5, false)]).toEqual([4, 2, 0, 3, 1]);
    expect([...orderOf(column, 5, true)]).toEqual([0, 3, 2, 4, 1]);
  });

  it("sorts categories by name, not by how frequent they are", () => {
    const column = categoryOf(info("c", "category"), ["b", "b", null, "a"]);
    expect([...orderOf(column, 4, false)]).toEqual([3, 0, 1, 2]);
  });

  it("keeps or reverses the server's order without a column", () => {
    expect([...orderOf(null, 3, true)]).toEqual([2, 1, 0]);
  });
});

describe("extent", () => {
  it("leaves out what is not finite, and on demand what is not positive", () => {
    const values = Float64Array.from([NaN, -1, 0, 4, Infinity]);
    expect(extentOf(values)).toEqual([-1, 4]);
    expect(extentOf(values, true)).toEqual([4, 4]);
    expect(extentOf(Float64Array.from([NaN]))).toBeNull();
  });
});
