/** A value with its unit, as in print: a true minus sign, no negative zero, a dash where there is none. */
export function show(value: number | null | undefined, unit: string, digits = 1): string {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  const text = value.toFixed(digits).replace(/^-(0(\.0+)?)$/, "$1").replace("-", "−");
  return unit ? `${text} ${unit}` : text;
}
