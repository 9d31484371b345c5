// Colours by their meaning, from the custom properties of the page's style sheet, so that light and dark mode have their own.

const NAMES = [
  "av", "partner", "critical", "other", "person", "road", "verge", "paint", "ink", "muted", "contact", "paper", "grid", "way-out", "way-out-box", "plane", "accent",
  "ghost-1", "ghost-2", "ghost-3", "ghost-4", "ghost-1-box", "ghost-2-box", "ghost-3-box", "ghost-4-box",
  "signal-green", "signal-amber", "signal-red",
] as const;
export type ColourName = (typeof NAMES)[number];
export type Colours = Readonly<Record<ColourName, string>>;

/** The value of one custom property, such as `css("ink")`. */
export const css = (name: string): string => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

export function readColours(): Colours {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(NAMES.map((name) => [name, style.getPropertyValue(`--${name}`).trim()])) as Record<ColourName, string>;
}

/** Tells when light and dark mode change places. */
export const dark: MediaQueryList = window.matchMedia("(prefers-color-scheme: dark)");
