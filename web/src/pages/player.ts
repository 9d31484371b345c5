// One clock for the pictures of a case: buttons, keys and links choose a case, move its frame and play it. A paused picture
// is always a recorded frame.
import { clamp, tick, whole } from "../shared/clock";
import { dark, readColours, type Colours } from "../shared/colours";
import type { Case } from "../shared/case";
import { crashFrame, secondsAt, type Timed } from "../shared/motion";
import { animate } from "./multiples";
import { onPrint } from "./print";

/** What the player needs of a case; `crash` is a frame, null: none. */
export interface Playable extends Timed {
  readonly id: string;
  readonly title: string;
  readonly verdict: string;
  readonly crash: number | null;
}

export interface Stage<T extends Playable> {
  readonly cases: readonly T[];
  /** Draw the pictures of a frame, which lies between two recorded ones while it plays. */
  draw(item: T, frame: number, metres: number, colours: Colours): void;
  /** Another case was chosen. */
  chosen(item: T): void;
  /** Write its readings at a recorded frame. */
  moved(item: T, frame: number): void;
  /** The recording for its small picture. */
  thumbnail(item: T): Case;
}

export interface Player<T extends Playable> {
  current(): T;
  /** Choose a case by its name; false if the page does not hold it. */
  selectId(id: string): boolean;
  seek(frame: number): void;
  /** Show the case that the address names, else this one at its crash. */
  start(index: number): void;
}

export const byId = (id: string): HTMLElement => document.getElementById(id)!;

/** The JSON that a page holds in a script. */
export const pageData = <T>(id: string): T => JSON.parse(byId(id).textContent!) as T;

export function makePlayer<T extends Playable>({ cases, draw, chosen, moved, thumbnail }: Stage<T>): Player<T> {
  const state = { index: 0, frame: 0, playing: false, rate: 1, view: 80, last: 0, ticket: 0 };
  let colours = readColours();
  const scrub = byId("scrub") as HTMLInputElement;
  const caseButtons = [...document.querySelectorAll<HTMLButtonElement>("button.case")];
  const current = () => cases[state.index]!;
  const lastFrame = (item: T) => item.frames - 1;

  function refresh(): void {
    const item = current();
    const frame = whole(state.frame);
    draw(item, state.playing ? state.frame : frame, state.view, colours);
    scrub.value = String(frame);
    scrub.setAttribute("aria-valuetext", `${secondsAt(item, frame).toFixed(1)} seconds`);
    moved(item, frame);
  }

  function writeHash(): void {
    const frame = whole(state.frame);
    const t = frame === crashFrame(current()) ? "crash" : secondsAt(current(), frame).toFixed(1);
    history.replaceState(null, "", `#case=${encodeURIComponent(current().id).replaceAll("%3A", ":")}&t=${t}`);
  }

  function pause(): void {
    state.playing = false;
    state.frame = whole(state.frame);
    byId("play").textContent = "Play";
    refresh();
  }

  function play(): void {
    if (state.frame >= lastFrame(current())) state.frame = 0;
    state.playing = true;
    state.last = performance.now();
    byId("play").textContent = "Pause";
    cancelAnimationFrame(state.ticket); // a case may be chosen while another plays
    state.ticket = requestAnimationFrame(step);
  }

  function step(now: number): void {
    if (!state.playing) return;
    // The first picture's time is when it was begun, which may lie before the click that it answers.
    const passed = Math.max(0, now - state.last) / 1000;
    state.last = now;
    const next = tick(state.frame, passed, current().dt, state.rate, { from: 0, to: lastFrame(current()), loop: false });
    state.frame = next.frame;
    if (next.over) {
      pause();
      writeHash();
      return;
    }
    refresh();
    state.ticket = requestAnimationFrame(step);
  }

  function seek(frame: number): void {
    state.frame = clamp(frame, 0, lastFrame(current()));
    pause();
    writeHash();
  }

  function select(index: number, frame = 0): void {
    state.index = index;
    state.playing = false;
    const item = current();
    for (const button of caseButtons) button.setAttribute("aria-pressed", String(Number(button.dataset.index) === index));
    byId("case-title").textContent = item.title;
    byId("case-verdict").textContent = item.verdict;
    scrub.max = String(lastFrame(item));
    state.frame = clamp(frame, 0, lastFrame(item));
    chosen(item);
    pause();
  }

  /** A case was chosen elsewhere on the page: what it chose must be seen, or the click looks dead. */
  function bringIntoSight(): void {
    const place = byId("player");
    const { top, bottom } = byId("case-title").parentElement!.querySelector("canvas")!.getBoundingClientRect();
    if (top < 0 || bottom > window.innerHeight) place.scrollIntoView({ block: "start", behavior: "instant" });
    place.classList.remove("flash");
    void place.offsetWidth; // so that the flash begins anew
    place.classList.add("flash");
  }

  function selectId(id: string): boolean {
    const index = cases.findIndex((item) => item.id === id);
    if (index < 0) return false;
    select(index);
    writeHash();
    bringIntoSight();
    return true;
  }

  function readHash(): boolean {
    const wish = new URLSearchParams(location.hash.slice(1));
    const index = cases.findIndex((item) => item.id === wish.get("case"));
    const item = cases[index];
    if (!item) return false;
    const t = wish.get("t");
    select(index, t === "crash" ? crashFrame(item) : Math.round((Number(t) || 0) / item.dt) - item.first);
    return true;
  }

  function onKey(event: KeyboardEvent): void {
    const tag = (event.target as HTMLElement).tagName;
    if (event.ctrlKey || event.metaKey || event.altKey || tag === "SELECT") return;
    if (event.key === " " && !["BUTTON", "SUMMARY", "A"].includes(tag)) state.playing ? pause() : play();
    else if (event.key === "ArrowLeft") seek(Math.ceil(state.frame) - 1);
    else if (event.key === "ArrowRight") seek(Math.floor(state.frame) + 1);
    else return;
    event.preventDefault();
  }

  function listen(): void {
    const onClick = (id: string, act: () => void) => byId(id).addEventListener("click", act);
    onClick("play", () => (state.playing ? pause() : play()));
    onClick("back", () => seek(state.frame - 1));
    onClick("forward", () => seek(Math.floor(state.frame) + 1));
    onClick("to-crash", () => seek(crashFrame(current())));
    scrub.addEventListener("input", () => seek(Number(scrub.value)));
    const choice = (id: string, take: (value: number) => void) =>
      byId(id).addEventListener("change", (event) => take(Number((event.target as HTMLSelectElement).value)));
    choice("rate", (value) => { state.rate = value; });
    choice("view", (value) => { state.view = value; refresh(); });
    for (const button of caseButtons) {
      button.addEventListener("click", () => { select(Number(button.dataset.index)); writeHash(); bringIntoSight(); play(); });
    }
    document.querySelectorAll<HTMLAnchorElement>("a.play").forEach((link) => {
      link.addEventListener("click", (event) => { event.preventDefault(); selectId(link.dataset.case!); play(); });
    });
    document.addEventListener("keydown", onKey);
    window.addEventListener("hashchange", () => { if (readHash()) bringIntoSight(); });
    const small = caseButtons.map((button) => ({ button, item: thumbnail(cases[Number(button.dataset.index)]!) }));
    const drawSmall = animate(small, () => colours);
    const redraw = () => { colours = readColours(); refresh(); drawSmall(); };
    dark.addEventListener("change", redraw);
    onPrint(redraw);
    new ResizeObserver(() => { refresh(); drawSmall(); }).observe(byId("player"));
  }

  function start(index: number): void {
    if (readHash()) bringIntoSight();
    else select(index, crashFrame(cases[index]!));
    listen();
  }

  return { current, selectId, seek, start };
}
