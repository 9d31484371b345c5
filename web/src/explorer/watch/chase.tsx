// A recording in 3-D, from behind and above the AV; a drag orbits, the wheel zooms. three.js comes when it is first needed.
import { effect, signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { time } from "../state";
import { type Eye, PLACES, bestPlace, scaled } from "./eye";
import { togglePlay } from "./player";
import { type Run, frameOf } from "./run";
import type { View3d } from "./view3d";
import { TRAIL_S, colours, lookFrom, looksAnew, nearer, runs, shades, trails } from "./view";

/** Where the camera stands from what it looks at [m]; all views share it, so that two recordings are seen alike. */
const eye = signal<Eye>(PLACES.behind);

effect(() => {
  looksAnew.value;
  lookFrom.value = bestPlace(runs.value[0]?.item);
  eye.value = PLACES[lookFrom.value];
});
effect(() => { eye.value = PLACES[lookFrom.value]; });

let steps = 0;
effect(() => {
  const factor = 0.85 ** (nearer.value - steps);
  steps = nearer.value;
  if (factor !== 1) eye.value = scaled(eye.peek(), factor);
});

/** A click that turns nothing plays and pauses. */
function playOnClick(element: HTMLElement): void {
  let begun = { x: 0, y: 0 };
  element.addEventListener("pointerdown", ({ clientX, clientY }) => { begun = { x: clientX, y: clientY }; });
  element.addEventListener("click", ({ clientX, clientY }) => { if (Math.hypot(clientX - begun.x, clientY - begun.y) < 4) togglePlay(); });
}

export function Chase({ run }: { run: Run }) {
  const ref = useRef<HTMLDivElement>(null);
  const names = useRef<(HTMLSpanElement | null)[]>([]);
  const note = useRef<HTMLParagraphElement>(null);
  const partner = run.item.partner > 0 ? run.item.vehicles[run.item.partner]! : null;
  useEffect(() => {
    const host = ref.current!;
    let stop = () => {};
    let isOver = false;
    const size = signal({ width: host.clientWidth, height: host.clientHeight });
    const watcher = new ResizeObserver(() => { size.value = { width: host.clientWidth, height: host.clientHeight }; });
    watcher.observe(host);
    import("./view3d").then(({ makeView3d }) => {
      if (isOver) return;
      note.current!.textContent = "";
      const view = signal<View3d | null>(null);
      const stopMaking = effect(() => {
        const made = makeView3d(run.item, colours.value, (at) => { eye.value = at; });
        host.prepend(made.element);
        playOnClick(made.element);
        view.value = made;
        return () => made.dispose();
      });
      const stopDrawing = effect(() => {
        const { width, height } = size.value;
        if (!view.value || width === 0 || height === 0) return;
        view.value.resize(width, height);
      });
      const stopPutting = effect(() => {
        const shown = colours.value;
        if (!view.value || size.value.width === 0) return;
        const ghosts = run.mark === "A" ? shades.value.map(({ motion, onRoad }) => ({ motion, colour: shown[onRoad] })) : [];
        const tags = view.value.draw({ frame: frameOf(run, time.value), eye: eye.value, ghosts, trail: trails.value ? TRAIL_S : 0 });
        [0, run.item.partner].forEach((index, i) => {
          const [span, tag] = [names.current[i], tags.find((one) => one.index === index)];
          if (!span) return;
          span.hidden = !tag;
          if (tag) span.style.transform = `translate(${tag.x.toFixed(1)}px, ${tag.y.toFixed(1)}px) translate(-50%, -100%)`;
        });
      });
      stop = () => { stopPutting(); stopDrawing(); stopMaking(); };
    }, () => { if (note.current) note.current.textContent = "The 3-D view could not be loaded. Is the server still running?"; });
    return () => { isOver = true; stop(); watcher.disconnect(); };
  }, [run]);
  return (
    <div ref={ref} class="road chase" role="img" data-view="chase"
      aria-label={`${run.name} in 3-D, from behind and above the AV. A drag turns the view. The values stand in the table below.`}>
      <p ref={note} class="note" role="status">Loading the 3-D view …</p>
      <span class="tag av" ref={(span) => { names.current[0] = span; }} hidden>AV</span>
      {partner && <span class="tag partner" ref={(span) => { names.current[1] = span; }} hidden>BV {partner.slot}</span>}
    </div>
  );
}
