// Paper is white: for printing, the page takes its light colours and the width of a sheet, and what scripts have drawn is drawn anew.

/** Width of an A4 sheet between its margins [CSS px]. */
const SHEET = 688;

/** Call `redraw` when the page has taken the colours and width of paper, and again when it is back on the screen. */
export function onPrint(redraw: (width: number | null) => void): void {
  const root = document.documentElement;
  const take = (prints: boolean) => {
    root.toggleAttribute("data-print", prints);
    redraw(prints ? SHEET : null);
  };
  window.addEventListener("beforeprint", () => take(true));
  window.addEventListener("afterprint", () => take(false));
}
