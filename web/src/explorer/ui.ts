// How the page is arranged now: what no link needs to hold.
import { effect, signal } from "@preact/signals";
import { watched } from "./state";

export type Tab = "start" | "filters" | "map" | "list" | "case";

/** Which pane a narrow screen shows. */
export const tab = signal<Tab>("start");
/** Whether the pane at the right shows the watched case, or the list although a case is watched. */
export const listOver = signal(false);
/** Whether "what to look at first" is folded away. */
export const folded = signal(false);
export const helpOpen = signal(false);
/** Whether dragging on the map draws a line around cases, or moves the map. */
export const lassoing = signal(false);
/** Style whose cases stand out on the map, while its entry in the legend is pointed at; -1: all are equal. */
export const lit = signal(-1);

/** A case that is chosen takes the pane at the right, and what to look at first makes room. */
export function startArranging(): () => void {
  let before: string | null = null;
  return effect(() => {
    const now = watched.value;
    if (now !== null && now !== before) {
      listOver.value = false;
      folded.value = true;
      tab.value = "case";
    } else if (now === null && before !== null) {
      folded.value = false;
      if (tab.peek() === "case") tab.value = "list";
    }
    before = now;
  });
}
