import { describe, expect, it } from "vitest";
import { count, number, onceIn, plainName, quantity } from "../src/explorer/format";
import { contentHeight, MOST_PX, offsetOf, scrollTo, windowAt } from "../src/explorer/rows";

describe("numbers for people", () => {
  it("count with commas", () => {
    expect([0, 999, 1000, 1234567].map(count)).toEqual(["0", "999", "1,000", "1,234,567"]);
  });

  it("keep three digits", () => {
    expect([0.01234, -12.345, 12345, -12345, 0, NaN, null, Infinity, 1.5e-7, 2e9].map(number)).toEqual(
      ["0.0123", "−12.3", "12,300", "−12,300", "0", "–", "–", "∞", "1.5·10⁻⁷", "2·10⁹"]);
    expect(quantity(Math.PI / 2, "rad")).toBe("90°");
    expect(quantity(3, "m/s2")).toBe("3\u202fm/s²");
  });

  it("say rates as once in so many miles", () => {
    expect(onceIn(125)).toBe("once in 8 million miles");
    expect(onceIn(1)).toBe("once in 1 billion miles");
    expect(onceIn(1.0004)).toBe("once in 1 billion miles");
    expect(onceIn(45_000)).toBe("once in 22,000 miles");
    expect(onceIn(1 / 1234)).toBe("once in 1.2 trillion miles");
    expect(onceIn(0)).toBe("");
    expect(onceIn(NaN)).toBe("");
  });

  it("name columns without their unit", () => {
    expect(plainName("min_ttc_front_s")).toBe("min ttc front");
    expect(plainName("av_max_braking_mps2")).toBe("av max braking");
    expect(plainName("miles")).toBe("miles");
  });
});

describe("list of which only visible rows exist", () => {
  it("draws what is visible and a few more, never beyond the ends", () => {
    expect(windowAt(0, 300, 30, 1000, 5)).toEqual({ from: 0, to: 16 });
    expect(windowAt(3000, 300, 30, 1000, 5)).toEqual({ from: 95, to: 116 });
    expect(windowAt(29_700, 300, 30, 1000, 5)).toEqual({ from: 985, to: 1000 });
    expect(windowAt(500, 300, 30, 3, 5)).toEqual({ from: 0, to: 3 });
    expect(windowAt(0, 300, 30, 0, 5)).toEqual({ from: 0, to: 0 });
  });

  it("scrolls no farther than needed to show a row", () => {
    expect(scrollTo(5, 0, 300, 30, 1000)).toBe(0);
    expect(scrollTo(20, 0, 300, 30, 1000)).toBe(330);
    expect(scrollTo(2, 300, 300, 30, 1000)).toBe(60);
  });

  it("reaches the last of a million rows, which are taller than a browser allows", () => {
    const n = 1_000_000;
    expect(contentHeight(30, n)).toBe(MOST_PX);
    const bottom = MOST_PX - 300;
    expect(offsetOf(bottom, 300, 30, n)).toBeCloseTo(30 * n - 300, 3);
    expect(windowAt(bottom, 300, 30, n).to).toBe(n);
    const scroll = scrollTo(n - 1, 0, 300, 30, n);
    expect(windowAt(scroll, 300, 30, n).to).toBe(n);
  });
});
