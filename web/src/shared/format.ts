/** A value with its unit, as in print: a true minus sign, no negative zero, a dash where there is none. */
export function show(value: number | null | undefined, unit: string, digits = 1): string {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  const text = value.toFixed(digits).replace(/^-(0(\.0+)?)$/, "$1").replace("-", "−");
  return unit ? `${text} ${unit}` : text;
}

/** A number that may be tiny, two digits: 0.0053, 2.6 · 10⁻⁷. */
export function showSmall(value: number): string {
  const size = Math.abs(value);
  if (size === 0) return "0";
  const power = Math.floor(Math.log10(size) + 1e-12);
  if (power >= -4) return show(value, "", Math.max(0, 1 - power));
  return `${show(value / 10 ** power, "", 1)} · 10${String(power).replace(/./g, (sign) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(sign)]!)}`;
}
