// Arithmetic of a list of which only the visible rows exist.

export interface Window {
  /** First and one past the last row that exist. */
  readonly from: number;
  readonly to: number;
}

/** Browsers give up beyond some 10 million px; a longer list scrolls in proportion. */
export const MOST_PX = 8_000_000;

/** Which of `n` rows of `height` px to draw at a scroll position, with `spare` more on both sides. */
export function windowAt(scroll: number, viewport: number, height: number, n: number, spare = 6): Window {
  const first = Math.floor(offsetOf(scroll, viewport, height, n) / height);
  const shown = Math.ceil(viewport / height);
  const from = Math.max(0, Math.min(first, n - shown) - spare);
  return { from, to: Math.min(n, Math.max(first, 0) + shown + spare + 1) };
}

/** Height of the scrolled content [px]. */
export function contentHeight(height: number, n: number): number {
  return Math.min(height * n, MOST_PX);
}

/** Where in the full list [px] the viewport begins. */
export function offsetOf(scroll: number, viewport: number, height: number, n: number): number {
  const full = height * n;
  if (full <= MOST_PX || MOST_PX <= viewport) return scroll;
  return (scroll / (MOST_PX - viewport)) * (full - viewport);
}

/** The scroll position that shows a row, as near as possible to the present one. `head`: px covered at the top. */
export function scrollTo(row: number, scroll: number, viewport: number, height: number, n: number, head = 0): number {
  const offset = offsetOf(scroll, viewport, height, n);
  const top = row * height;
  let wanted = offset;
  if (top < offset) wanted = top;
  else if (top + height > offset + viewport - head) wanted = top + height - viewport + head;
  if (wanted === offset) return scroll;
  const full = height * n;
  return full <= MOST_PX ? wanted : (wanted / (full - viewport)) * (MOST_PX - viewport);
}
