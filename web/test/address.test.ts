import { describe, expect, it } from "vitest";
import { NOWHERE, type Place, read, readFilter, write, writeFilter } from "../src/explorer/address";
import type { Filter } from "../src/explorer/filters";

const full: Place = {
  case: "natural/0:12",
  t: 3.25,
  beside: "av:idm/mobil",
  camera: "chase",
  ghosts: ["cc-human", "way-out"],
  colour: "often",
  axes: ["pc2", "impact_speed_mps"],
  lasso: [[0, 1], [2.5, -3], [1e-7, 4]],
  sql: "fault = 'av' and crash_type <> 'a|b' -- 100 %",
  sort: { column: "often", descending: true },
  show: ["mechanism", "often"],
  filters: new Map<string, Filter>([
    ["mechanism", { kind: "values", values: ["cut-in", "a|b", "back\\slash", "dots..in", "x"] }],
    ["impact_speed_mps", { kind: "range", lo: -2.5, hi: Infinity }],
    ["value", { kind: "range", lo: 0.1, hi: 0.9 }],
  ]),
};

describe("address bar", () => {
  it("gives back all that was written", () => {
    const { place, problems } = read(write(full));
    expect(problems).toEqual([]);
    expect(place).toEqual(full);
  });

  it("writes nothing for nothing", () => {
    expect(write(NOWHERE)).toBe("");
    expect(read("#").place).toEqual(NOWHERE);
  });

  it("reads the links of the report", () => {
    const { place, problems } = read("#case=natural/0:12&t=crash&f.prevention=by%20braking|nobody");
    expect(problems).toEqual([]);
    expect(place.case).toBe("natural/0:12");
    expect(place.t).toBe("crash");
    expect(place.filters.get("prevention")).toEqual({ kind: "values", values: ["by braking", "nobody"] });
  });

  it.each([
    ["case=nothing"], ["t=-1"], ["t=NaN"], ["t=1e99"], ["camera=below"], ["axes=pc1"], ["axes=a,b,c"], ["axes=<b>,y"],
    ["lasso=1,2;3,4"], ["lasso=1,2;3,4;5,x"], ["lasso=1,2;3,4;5,Infinity"], ["sort=drop table"], ["f.=a"], ["f.x="],
    ["f.x=9..1"], ["f.x=.."], ["f.x=a..b"], ["f.../../x=1"], ["what=ever"], ["beside=me"], [`sql=${"a".repeat(5000)}`],
    ["show=,"], ["colour="],
  ])("ignores %s and says so", (hash) => {
    const { place, problems } = read(`${hash}&sort=value`);
    expect(problems).toHaveLength(1);
    expect(problems[0]).toMatch(/^The link's ".*it is ignored\.$/s);
    expect(place).toEqual({ ...NOWHERE, sort: { column: "value", descending: false } });
  });

  it("takes any text without failing", () => {
    let state = 1;
    const next = () => (state = (state * 1103515245 + 12345) % 2147483648) / 2147483648;
    const parts = ["f.", "x", "=", "&", "..", "|", "\\", "%", "%zz", "lasso", ",", ";", "1", "-", "e", "case", "/", "é", "\u0000", "t"];
    for (let i = 0; i < 5000; i++) {
      const text = Array.from({ length: 12 }, () => parts[Math.floor(next() * parts.length)]).join("");
      const { place } = read(text);
      expect(read(write(place)).place).toEqual(place);
    }
  });
});

describe("filters in links", () => {
  it.each([
    ["1..2", { kind: "range", lo: 1, hi: 2 }],
    ["-1.5..", { kind: "range", lo: -1.5, hi: Infinity }],
    ["..1e-3", { kind: "range", lo: -Infinity, hi: 0.001 }],
    ["a", { kind: "values", values: ["a"] }],
    ["1.5", { kind: "values", values: ["1.5"] }],
    ["a||b", { kind: "values", values: ["a", "b"] }],
    ["a\\|b|c", { kind: "values", values: ["a|b", "c"] }],
  ] satisfies [string, Filter][])("reads %s", (text, filter) => {
    expect(readFilter(text)).toEqual(filter);
    expect(readFilter(writeFilter(filter))).toEqual(filter);
  });
});
