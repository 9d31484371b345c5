import { describe, expect, it } from "vitest";
import type { ColumnInfo } from "../src/explorer/api";
import { binsOf, categoryStyles, encodeNumbers, LEVELS, lightnessOf, ramp } from "../src/explorer/scales";

const info = (name: string): ColumnInfo => ({ name, type: "number", unit: "", meaning: "", source: "analysis" });

describe("colours of numbers", () => {
  it.each([[false], [true]])("change in lightness evenly (dark: %s)", (dark) => {
    const steps = Array.from({ length: 17 }, (_, i) => lightnessOf(ramp(i / 16, dark)));
    const changes = steps.slice(1).map((value, i) => value - steps[i]!);
    const mean = changes.reduce((a, b) => a + b) / changes.length;
    expect(Math.abs(mean)).toBeGreaterThan(0.02);
    for (const change of changes) expect(Math.abs(change - mean)).toBeLessThan(0.012);
    // High values stand out from the page.
    expect(Math.sign(mean)).toBe(dark ? 1 : -1);
  });

  it("uses logarithms for rates and for what spans a thousandfold, not for signed or narrow values", () => {
    expect(binsOf(info("often"), Float64Array.of(0, 2, 4), 8)).toMatchObject({ lo: 2, hi: 4, log: true });
    expect(binsOf(info("av_injury_probability"), Float64Array.of(1e-30, 0.2), 8)).toMatchObject({ lo: 2e-10, log: true });
    expect(binsOf(info("x"), Float64Array.of(1, 5000), 8)).toMatchObject({ log: true });
    expect(binsOf(info("x"), Float64Array.of(-1, 5000), 8)).toMatchObject({ lo: -1, log: false });
    expect(binsOf(info("impact_speed_mps"), Float64Array.of(1, 30), 8)).toMatchObject({ log: false });
    expect(binsOf(info("x"), Float64Array.of(NaN), 8)).toBeNull();
  });

  it("gives unknown and impossible values a style of their own", () => {
    const bins = { lo: 1, hi: 100, log: true, count: 8 };
    expect([...encodeNumbers(Float64Array.of(1, 10, 100, 1000, 0, -1, NaN), bins, false).codes]).toEqual(
      [0, Math.round((LEVELS - 1) / 2), LEVELS - 1, LEVELS - 1, LEVELS, LEVELS, LEVELS]);
  });
});

describe("colours of categories", () => {
  it("differ in colour and in mark, and grey is for the rest", () => {
    const names = [..."abcdefghij", "not known"];
    for (const dark of [false, true]) {
      const styles = categoryStyles(names, dark);
      expect(new Set(styles.slice(0, 8).map((s) => s.colour)).size).toBe(8);
      expect(new Set(styles.slice(0, 8).map((s) => s.mark)).size).toBe(8);
      expect(new Set(styles.slice(8).map((s) => s.colour)).size).toBe(1);
    }
    // Grey takes no colour from the others.
    expect(categoryStyles(["not judged", "a"], false)[1]!.colour).toBe(0x0072b2);
  });
});
