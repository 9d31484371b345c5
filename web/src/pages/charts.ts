// Draws the figures of a page with plotly, which the page brings along, and keeps their colours in step with light and dark.
import { css, dark } from "../shared/colours";
import { onPrint } from "./print";

export interface Figure {
  readonly data: unknown[];
  readonly layout: { readonly dragmode?: string | false; readonly [key: string]: unknown };
}

/** An element that plotly has drawn in. */
export interface Drawn extends HTMLElement {
  on(name: "plotly_click", act: (event: { points: { x: number; customdata: string }[] }) => void): void;
}

declare const Plotly: {
  react(element: HTMLElement, data: unknown[], layout: unknown, config: unknown): void;
  relayout(element: HTMLElement, change: Record<string, unknown>): void;
};

// Only the map of cases is worth zooming; elsewhere the tool bar would hide what it belongs to.
const still = { responsive: true, displayModeBar: false };
const zoomable = {
  responsive: true, displayModeBar: true, displaylogo: false,
  modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]],
};
/** The figures with their colours by meaning. */
const drawn = new Map<HTMLElement, Figure>();

/** A copy of a figure in which "css:ink" and the like have become colours. */
function resolve<T>(node: T): T {
  if (typeof node === "string") return (node.startsWith("css:") ? css(node.slice(4)) : node) as T;
  if (Array.isArray(node)) return node.map(resolve) as T;
  if (node === null || typeof node !== "object") return node;
  return Object.fromEntries(Object.entries(node).map(([key, value]) => [key, resolve(value)])) as T;
}

/** Draw a figure, as wide as its element or as told [px]. */
export function drawFigure(element: HTMLElement, figure: Figure, width: number | null = null): void {
  drawn.set(element, figure);
  const { data, layout } = resolve(figure);
  if (width !== null) Object.assign(layout, { width });
  Plotly.react(element, data, layout, figure.layout.dragmode === "zoom" ? zoomable : still);
}

export const changeLayout = (element: HTMLElement, change: Record<string, unknown>): void => Plotly.relayout(element, change);

/** Draw each figure in the element that names it in `data-figure`. */
export function drawFigures(figures: Readonly<Record<string, Figure>>): void {
  dark.addEventListener("change", () => drawn.forEach((figure, element) => drawFigure(element, figure)));
  onPrint((width) => drawn.forEach((figure, element) => {
    const share = element.closest(".two") ? 0.48 : 1; // two figures stand side by side
    drawFigure(element, figure, width && Math.round(share * width));
  }));
  document.querySelectorAll<HTMLElement>("[data-figure]").forEach((element) => drawFigure(element, figures[element.dataset.figure!]!));
}
