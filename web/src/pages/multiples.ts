// Small pictures that move: while the pointer or the focus is on one, and on a touch screen while it is in sight. They stand
// still for people who ask for less motion.
import type { Case } from "../shared/case";
import { tick } from "../shared/clock";
import type { Colours } from "../shared/colours";
import { crashFrame } from "../shared/motion";
import { drawScene } from "../shared/scene";

/** Seconds before the crash that a small picture shows. */
const BEFORE_S = 4;
const METRES = 36;

export interface Small {
  readonly button: HTMLButtonElement;
  readonly item: Case;
}

/** Draw each picture at its crash, and animate it while it is wanted; what is returned draws all of them anew. */
export function animate(pictures: readonly Small[], colours: () => Colours): () => void {
  const calm = window.matchMedia("(prefers-reduced-motion: reduce)");
  const frames = new Map<Small, number>();
  const still = (one: Small) => draw(one, crashFrame(one.item));
  let last = 0;

  function draw({ button, item }: Small, frame: number): void {
    drawScene(button.querySelector("canvas")!, item, frame, { metres: METRES, detail: false, trail: 1.5 }, colours());
  }

  function step(now: number): void {
    const passed = Math.max(0, now - last) / 1000;
    last = now;
    for (const [one, frame] of frames) {
      const to = crashFrame(one.item);
      const from = Math.max(0, to - Math.round(BEFORE_S / one.item.dt));
      const next = tick(frame, passed, one.item.dt, 1, { from, to, loop: true }).frame;
      frames.set(one, next);
      draw(one, Math.min(next, to));
    }
    if (frames.size > 0) requestAnimationFrame(step);
  }

  function begin(one: Small): void {
    if (calm.matches || frames.has(one)) return;
    frames.set(one, Math.max(0, crashFrame(one.item) - Math.round(BEFORE_S / one.item.dt)));
    if (frames.size > 1) return;
    last = performance.now();
    requestAnimationFrame(step);
  }

  function end(one: Small): void {
    if (frames.delete(one)) still(one);
  }

  const touch = window.matchMedia("(hover: none)").matches;
  const sight = new IntersectionObserver((seen) => {
    for (const { target, isIntersecting } of seen) {
      const one = pictures.find(({ button }) => button === target)!;
      isIntersecting ? begin(one) : end(one);
    }
  }, { threshold: 0.9 });
  for (const one of pictures) {
    if (touch) sight.observe(one.button);
    else {
      for (const name of ["pointerenter", "focus"]) one.button.addEventListener(name, () => begin(one));
      for (const name of ["pointerleave", "blur"]) one.button.addEventListener(name, () => end(one));
    }
  }
  const all = () => pictures.forEach((one) => { if (!frames.has(one)) still(one); });
  all();
  return all;
}
