// A recording from above: follows the clock, zooms with the wheel or two fingers, and moves along the road with a drag.
import { useEffect, useRef } from "preact/hooks";
import { effect, signal } from "@preact/signals";
import { heightFor, drawScene } from "../../shared/scene";
import { time } from "../state";
import { togglePlay } from "./player";
import { type Run, frameOf } from "./run";
import { TRAIL_S, ahead, aheadFor, colours, metresFor, runs, shades, trails, zoom } from "./view";

/** Mark of the browser's performance timeline when a case is first drawn, by which tests measure how long a click takes. */
export const DRAWN = "case drawn";

export function Above({ run }: { run: Run }) {
  const ref = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const canvas = ref.current!;
    const width = signal(canvas.clientWidth);
    const watcher = new ResizeObserver(() => { width.value = canvas.clientWidth; });
    watcher.observe(canvas);
    let isDrawn = false;
    const stop = effect(() => {
      if (width.value === 0) return;
      const wide = metresFor(width.value);
      const height = Math.min(heightFor(run.item, width.value, wide), Math.max(150, window.innerHeight * (runs.value.length > 1 ? 0.3 : 0.45)));
      canvas.style.height = `${Math.round(height)}px`;
      const shown = colours.value;
      const ghosts = run.mark === "A" ? shades.value.map(({ motion, onRoad, name }) => ({ motion, name, colour: shown[onRoad] })) : [];
      const look = { metres: wide, detail: true, ahead: aheadFor(width.value), ghosts, ...(trails.value ? { trail: TRAIL_S } : {}) };
      drawScene(canvas, run.item, frameOf(run, time.value), look, shown);
      if (!isDrawn) performance.mark(DRAWN);
      isDrawn = true;
    });
    const unlisten = listen(canvas);
    return () => { stop(); unlisten(); watcher.disconnect(); };
  }, [run]);
  const kind = run.item.crash === null ? "The AV does not crash." : "";
  return (
    <canvas ref={ref} class="road" role="img" data-view="above"
      aria-label={`${run.name}: the road from above, driving to the right. ${kind} The values stand in the table below.`} />
  );
}

/** The wheel, a drag and a pinch move the view; a click plays and pauses. */
function listen(canvas: HTMLCanvasElement): () => void {
  const fingers = new Map<number, { x: number; y: number }>();
  const gap = () => {
    const [a, b] = [...fingers.values()];
    return a && b ? Math.hypot(a.x - b.x, a.y - b.y) : 0;
  };
  let [hasMoved, begun] = [false, { x: 0, y: 0 }];
  const onWheel = (event: WheelEvent) => {
    event.preventDefault();
    zoom(Math.exp(Math.max(-60, Math.min(60, event.deltaY)) * 0.004), canvas.clientWidth);
  };
  const onDown = (event: PointerEvent) => {
    hasMoved = fingers.size > 0;
    begun = { x: event.clientX, y: event.clientY };
    fingers.set(event.pointerId, begun);
    canvas.setPointerCapture(event.pointerId);
  };
  const onMove = (event: PointerEvent) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const wide = gap();
    hasMoved ||= Math.hypot(event.clientX - begun.x, event.clientY - begun.y) > 4;
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (fingers.size > 1) {
      if (wide > 0 && gap() > 0) zoom(wide / gap(), canvas.clientWidth);
      return;
    }
    if (!hasMoved) return;
    const perPixel = metresFor(canvas.clientWidth) / canvas.clientWidth;
    ahead.value = Math.max(-100, Math.min(100, aheadFor(canvas.clientWidth) - (event.clientX - before.x) * perPixel));
  };
  const onUp = (event: PointerEvent) => {
    fingers.delete(event.pointerId);
    if (event.type === "pointerup" && !hasMoved && fingers.size === 0) togglePlay();
  };
  canvas.addEventListener("wheel", onWheel, { passive: false });
  canvas.addEventListener("pointerdown", onDown);
  canvas.addEventListener("pointermove", onMove);
  canvas.addEventListener("pointerup", onUp);
  canvas.addEventListener("pointercancel", onUp);
  return () => {
    canvas.removeEventListener("wheel", onWheel);
    canvas.removeEventListener("pointerdown", onDown);
    canvas.removeEventListener("pointermove", onMove);
    canvas.removeEventListener("pointerup", onUp);
    canvas.removeEventListener("pointercancel", onUp);
  };
}
