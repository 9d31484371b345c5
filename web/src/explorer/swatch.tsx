// A mark of the map as a small picture, for the legend.
import { cssOf, type Mark, type Style } from "./scales";

const SHAPES: Record<Mark, string> = {
  disc: "M7 2a5 5 0 1 1 0 10a5 5 0 1 1 0-10z",
  square: "M2.5 2.5h9v9h-9z",
  triangle: "M7 1.5l5.5 10h-11z",
  diamond: "M7 1l6 6-6 6-6-6z",
  cross: "M2 4l2-2 3 3 3-3 2 2-3 3 3 3-2 2-3-3-3 3-2-2 3-3z",
  plus: "M5.4 1h3.2v4.4H13v3.2H8.6V13H5.4V8.6H1V5.4h4.4z",
  wedge: "M7 12.5l5.5-10h-11z",
  ring: "M7 2a5 5 0 1 1 0 10a5 5 0 1 1 0-10zM7 4.6a2.4 2.4 0 1 0 0 4.8a2.4 2.4 0 1 0 0-4.8z",
  dot: "M7 4a3 3 0 1 1 0 6a3 3 0 1 1 0-6z",
};

export function Swatch({ style }: { style: Style }) {
  return (
    <svg class="swatch" viewBox="0 0 14 14" aria-hidden="true">
      <path d={SHAPES[style.mark]} fill={cssOf(style.colour)} fill-rule="evenodd" />
    </svg>
  );
}
