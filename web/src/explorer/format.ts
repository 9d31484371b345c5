// Numbers as people read them.

const NARROW = "\u202f";

/** 1234567 -> "1,234,567". */
export function count(n: number): string {
  return Math.round(n).toString().replace(/\B(?=(\d{3})+$)/g, ",");
}

/** Three digits that matter: 0.01234 -> "0.0123", 12345 -> "12,300"; very small and very large ones in powers of ten. */
export function number(value: number | null | undefined): string {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-3) {
    const [digits, power] = value.toExponential(2).split("e") as [string, string];
    return `${minus(String(Number(digits)))}·10${[...String(Number(power))].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(c)])).join("")}`;
  }
  if (size >= 1000) return minus(`${value < 0 ? "-" : ""}${count(Number(size.toPrecision(3)))}`);
  return minus(String(Number(value.toPrecision(3))));
}

/** With its unit; radians as degrees. */
export function quantity(value: number | null | undefined, unit: string): string {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (unit === "rad") return `${number((value * 180) / Math.PI)}°`;
  return unit === "" ? number(value) : `${number(value)}${NARROW}${unit.replace("m/s2", "m/s²")}`;
}

/** Crashes per billion miles as people say it: 125 -> "once in 8 million miles". */
export function onceIn(perBillionMiles: number): string {
  if (!(perBillionMiles > 0)) return "";
  const miles = 1e9 / perBillionMiles;
  for (const [size, word] of [[1e12, "trillion"], [1e9, "billion"], [1e6, "million"]] as const) {
    // 999,600,000 is said as "1 billion".
    if (Number(miles.toPrecision(2)) >= size) return `once in ${twoDigits(miles / size)} ${word} miles`;
  }
  return `once in ${twoDigits(miles)} miles`;
}

function twoDigits(value: number): string {
  const rounded = Number(value.toPrecision(2));
  return rounded >= 1000 ? count(rounded) : String(rounded);
}

function minus(text: string): string {
  return text.replace("-", "−");
}

export function capital(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/** A case's name without most of a long seed, which all cases of a library share: "2918264622725855778:12" -> "…:12". */
export function shortName(caseId: string): string {
  return caseId.replace(/^\d{6,}:/, "…:");
}

/** "min_ttc_front_s" -> "min ttc front": for columns without a better title. */
export function plainName(column: string): string {
  return column.replace(/_(mps2|mps|rad|nats|m|s)$/, "").replaceAll("_", " ");
}
