import { describe, expect, test } from "vitest";
import type { ColumnInfo, Fact } from "../src/explorer/api";
import { bestPlace, scaled } from "../src/explorer/watch/eye";
import { factGroups, factNumber, inWords } from "../src/explorer/watch/facts";
import { KEYS, commandOf, isTaken } from "../src/explorer/watch/keys";
import { withPartner } from "../src/explorer/watch/partner";
import { type Run, contactAt, frameOf, isOn, opensAt, settled, shiftOf, spanOf, stretchOf } from "../src/explorer/watch/run";
import { TTC_MOST, around, series } from "../src/explorer/watch/series";
import { motion, rearEnd, straight } from "./cases";

const run = (item = rearEnd(), shift = 0, mark: "A" | "B" = "A"): Run => ({ item, mark, name: mark, shift });
const late = rearEnd({ first: 100 });

describe("two recordings on one clock", () => {
  test("two cases meet their contacts at the same moment", () => {
    const shift = shiftOf(rearEnd(), late, false);
    expect(shift).toBe(10);
    expect(frameOf(run(late, shift, "B"), contactAt(rearEnd()))).toBe(50);
  });
  test("the same test driven by another AV keeps the time of the test", () => expect(shiftOf(rearEnd(), late, true)).toBe(0));
  test("the clock goes from the first begin to the last end", () => {
    const longer = rearEnd({ frames: 91, crash: 90 });
    expect(spanOf([run(), run(longer, shiftOf(rearEnd(), longer, false), "B")])).toEqual({ from: -4, to: 5 });
  });
  test("one that is over, or has not begun, stands still", () => {
    const short = run(rearEnd({ first: 10, frames: 21, crash: null }));
    expect([0, 1, 2, 3, 4].map((t) => frameOf(short, t))).toEqual([0, 0, 10, 20, 20]);
    expect([0.9, 1, 3, 3.1].map((t) => isOn(short, t))).toEqual([false, true, true, false]);
  });
  test("frames are whole at times of recorded frames, for all of them", () => {
    const item = rearEnd({ first: 3, frames: 301 });
    for (let k = 0; k <= 300; k++) expect(frameOf(run(item), settled(item, (3 + k) * 0.1))).toBe(k);
  });
});

describe("where a case opens", () => {
  const long = rearEnd({ frames: 101, crash: 100 });
  test("5 s before its contact", () => expect(opensAt(long, null)).toBeCloseTo(5));
  test("at its begin, if it is shorter", () => expect(opensAt(rearEnd({ crash: 30 }), null)).toBe(0));
  test("where the address says, but within the case", () => {
    expect(opensAt(long, "crash")).toBeCloseTo(10);
    expect(opensAt(long, 2.5)).toBe(2.5);
    expect(opensAt(long, 99)).toBeCloseTo(10);
    expect(opensAt(late, 1)).toBe(10);
  });
});

test("the short loop is the last 5 s before the contact, the long one all", () => {
  const long = run(rearEnd({ frames: 111, crash: 100 }));
  expect(stretchOf([long], true)).toEqual({ from: 5, to: 10 });
  expect(stretchOf([long], false)).toEqual({ from: 0, to: 11 });
});

describe("time series", () => {
  test("have one value a frame, and say where there is none", () => {
    const partial = rearEnd({ vehicles: [straight({ v: 30 }), straight({ x: 55, v: 20, slot: 7, from: 20, n: 31 })] });
    const { x, panels } = series([run(partial)], []);
    expect(x).toHaveLength(51);
    for (const { lines } of panels) for (const { values } of lines) expect(values).toHaveLength(51);
    const gap = panels.find(({ name }) => name.startsWith("gap"))!.lines[0]!.values;
    expect(gap[19]).toBeNull();
    expect(gap[20]).toBeCloseTo(30);
    expect(gap[50]).toBeCloseTo(0);
  });
  test("an infinite time to collision is a gap in the line, and its axis is bounded", () => {
    const ttc = series([run()], []).panels.find(({ name }) => name === "time to collision")!;
    expect(ttc.range).toEqual([0, TTC_MOST]);
    expect(ttc.lines.map(({ values }) => values[0])).toEqual([5, null]);
  });
  test("without a partner nothing is shown that needs one", () => {
    const alone = rearEnd({ vehicles: [straight()], crash: null, partner: -1, ttc: [], ttcPlane: [], critical: [], action: [], p_nde: [] });
    const { panels } = series([run(alone)], []);
    expect(panels.map(({ name }) => name)).toEqual(["speed", "acceleration", "place across the road"]);
    expect(panels[0]!.lines.map(({ label }) => label)).toEqual(["AV"]);
  });
  test("of two recordings, each is where it is on the clock, and both have their names", () => {
    const { x, panels } = series([run(), run(late, 10, "B")], [{ name: "fsm", motion: motion({ from: 30, n: 21, v: 9 }), colour: "ghost-1" }]);
    expect(x).toHaveLength(51);
    expect(panels[0]!.lines.map(({ label }) => label)).toEqual(["AV, A", "BV 7, A", "AV, B", "BV 7, B", "fsm"]);
    expect(panels[0]!.lines[4]!.values.slice(29, 31)).toEqual([null, 9]);
  });
  test("a constant speed does not look like a manoeuvre", () => {
    const [low, high] = around([{ label: "", colour: "ink", dash: [], values: [20, 20.01, null] }], 6, 0);
    expect(high - low).toBeGreaterThanOrEqual(6);
    expect(around([], 6)).toEqual([0, 6]);
  });
});

test("the vehicle that one AV touched is marked in the drive of the other too", () => {
  const other = rearEnd({ vehicles: [straight(), straight({ slot: 3 }), straight({ slot: 7 })], partner: -1, crash: 44 });
  const shown = withPartner(other, rearEnd());
  expect([shown.partner, shown.crash]).toEqual([2, null]);
  expect(withPartner(rearEnd(), rearEnd()).crash).toBe(50);
  expect(withPartner({ ...other, vehicles: [straight()] }, rearEnd()).partner).toBe(-1);
});

describe("the camera", () => {
  test("stays at a distance that the view allows", () => {
    expect(Math.hypot(...scaled([-19, 0, 7.5], 100))).toBeCloseTo(140);
    expect(Math.hypot(...scaled([-19, 0, 7.5], 0.001))).toBeCloseTo(5);
    const [x, , z] = scaled([-20, 0, 10], 0.5);
    expect([x, z]).toEqual([-10, 5]);
  });
  test("looks back where the crash comes from behind", () => {
    const struck = rearEnd({ vehicles: [straight({ x: 60, v: 20 }), straight({ v: 30, slot: 7 })] });
    expect(bestPlace(struck)).toBe("beside");
    expect(bestPlace(rearEnd())).toBe("behind");
    expect(bestPlace(rearEnd({ partner: -1 }))).toBe("behind");
    expect(bestPlace(undefined)).toBe("behind");
  });
});

describe("facts", () => {
  const fact = (name: string, value: Fact["value"], unit = ""): Fact => ({ name, value, unit, meaning: `about ${name}` });
  test("are written for people", () => {
    expect(inWords(fact("a", true))).toBe("yes");
    expect(inWords(fact("a", null))).toBe("–");
    expect(inWords(fact("a", "infinite", "s"))).toBe("∞");
    expect(inWords(fact("a", 12.345, "m/s"))).toBe("12.3 m/s");
    expect(inWords(fact("a", 3.14159, "m/s2"))).toBe("3.1 m/s²");
    expect(inWords(fact("a", -2, "m"))).toBe("−2 m");
    expect(inWords(fact("a", 9.8e-9, "crashes per test"))).toBe("9.8 · 10⁻⁹ crashes per test");
    expect(inWords(fact("a", "bv"), { bv: "the other" })).toBe("the other");
  });
  test("each stands once, those that are not known not first, and none is lost", () => {
    const facts = ["crash_type", "often", "fault", "fault_s", "prevented_by", "value", "min_ttc_s", "pc1"].map((name) => fact(name, 1)).concat(fact("mechanism", null), fact("case_id", "0:1"));
    const names = factGroups(facts, []).flatMap(({ rows, more }) => [...rows, ...more].map(({ name }) => name));
    expect([...names].sort()).toEqual(facts.map(({ name }) => name).filter((name) => name !== "case_id").sort());
    expect(factGroups(facts, [])[0]!.rows.map(({ name }) => name)).toEqual(["crash_type"]);
  });
  test("take the server's name and words", () => {
    const column = { name: "fault", type: "category", unit: "", meaning: "", source: "", label: "who broke a rule", values: { av: "the AV" } } as ColumnInfo;
    const row = factGroups([fact("fault", "av")], [column])[0]!.rows[0]!;
    expect([row.label, row.value]).toEqual(["who broke a rule", "the AV"]);
  });
  test("a number that is not finite is not known", () => {
    expect(factNumber([fact("a", "infinite")], "a")).toBeNull();
    expect(factNumber([fact("a", 2)], "a")).toBe(2);
  });
});

describe("keys", () => {
  const press = (key: string, more = {}) => commandOf({ key, shiftKey: false, ctrlKey: false, metaKey: false, altKey: false, ...more });
  test("do what the help says", () => {
    expect(press(" ")).toBe("play");
    expect(press("ArrowLeft", { shiftKey: true })).toBe("back-second");
    expect(press("+", { shiftKey: true })).toBe("in");
    expect(press("Home")).toBe("begin");
    expect(KEYS.every(({ keys, what }) => keys !== "" && what !== "")).toBe(true);
  });
  test("leave the browser's own alone", () => {
    expect(press("x", { ctrlKey: true })).toBeNull();
    expect(press("ArrowLeft", { altKey: true })).toBeNull();
    expect(press("Escape")).toBeNull();
  });
  test("leave a field its keys, and a button its space bar", () => {
    expect(isTaken("INPUT", "text", "c")).toBe(true);
    expect(isTaken("SELECT", "", "ArrowLeft")).toBe(true);
    expect(isTaken("INPUT", "range", "ArrowLeft")).toBe(false);
    expect(isTaken("BUTTON", "button", " ")).toBe(true);
    expect(isTaken("BUTTON", "button", "ArrowLeft")).toBe(false);
  });
});
