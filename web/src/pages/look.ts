// The case to watch first: one picture on the first screen, which plays when its button, the picture or Space is pressed.
import type { Case } from "../shared/case";
import { tick } from "../shared/clock";
import { dark, readColours } from "../shared/colours";
import { crashFrame } from "../shared/motion";
import { drawScene, type Ghost } from "../shared/scene";
import { frameFor } from "../shared/framing";
import { onPrint } from "./print";

/** Seconds before the crash at which it begins. */
const BEFORE_S = 6;
const TRAIL_S = 4;

export function showFirst(cases: readonly Case[]): void {
  const place = document.getElementById("look");
  const item = cases[Number(place?.dataset.index ?? -1)];
  if (!place || !item) return;
  const canvas = document.getElementById("look-road") as HTMLCanvasElement;
  const button = document.getElementById("look-play") as HTMLButtonElement;
  const [end, last] = [crashFrame(item), item.frames - 1];
  const begin = Math.max(0, end - Math.round(BEFORE_S / item.dt));
  const view = frameFor(item, begin, end);
  let [frame, playing, before, colours] = [end, false, 0, readColours()];

  const draw = () => {
    const ghosts: Ghost[] = item.wayOut && playing
      ? [{ motion: item.wayOut, colour: colours["way-out-box"], name: "way out" }] : [];
    drawScene(canvas, item, frame, { ...view, detail: true, trail: TRAIL_S, ghosts }, colours);
  };

  function step(now: number): void {
    if (!playing) return;
    const passed = Math.max(0, now - before) / 1000;
    before = now;
    const next = tick(frame, passed, item!.dt, 1, { from: begin, to: last, loop: true });
    frame = next.frame;
    draw();
    requestAnimationFrame(step);
  }

  function toggle(): void {
    playing = !playing;
    button.querySelector("[aria-hidden]")!.textContent = playing ? "❚❚" : "▶";
    button.querySelector(".word")!.textContent = playing ? "Pause" : "Play";
    button.setAttribute("aria-label", button.getAttribute("aria-label")!.replace(/^\w+/, playing ? "Pause" : "Play"));
    if (playing) {
      if (frame >= end) frame = begin;
      before = performance.now();
      requestAnimationFrame(step);
    }
    draw();
  }

  const isSeen = () => {
    const { top, bottom } = canvas.getBoundingClientRect();
    return top < window.innerHeight && bottom > 0;
  };
  button.addEventListener("click", toggle);
  canvas.addEventListener("click", toggle);
  // While this picture is in sight Space is for it, not for the player farther down.
  document.addEventListener("keydown", (event) => {
    if (event.key !== " " || event.target !== document.body || !isSeen()) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    toggle();
  });
  const redraw = () => { colours = readColours(); draw(); };
  dark.addEventListener("change", redraw);
  onPrint(redraw);
  new ResizeObserver(draw).observe(canvas);
  draw();
}
