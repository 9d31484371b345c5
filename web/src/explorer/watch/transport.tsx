// Buttons of the clock and of the view.
import { useComputed, useSignalEffect } from "@preact/signals";
import { useRef } from "preact/hooks";
import { camera, looping, playing, rate, time } from "../state";
import type { Place } from "./eye";
import { RATES, obey, seek, togglePlay } from "./player";
import { contactAt, spanOf } from "./run";
import { ahead, isShortLoop, lookFrom, metres, resetView, runs, trails } from "./view";

const loopName = () => (!looping.value ? "off" : isShortLoop.value ? "last" : "all");

function setLoop(name: string): void {
  looping.value = name !== "off";
  isShortLoop.value = name === "last";
}

/** `manoeuvre`: when it began [s of the clock]; `width`: of the picture [px]. */
export function Transport({ manoeuvre, width }: { manoeuvre: number | null; width: () => number }) {
  const shown = runs.value;
  const { from, to } = spanOf(shown);
  const first = shown[0]!.item;
  const contact = contactAt(first);
  const does = (command: Parameters<typeof obey>[0]) => () => obey(command, manoeuvre, width());
  const isMoved = useComputed(() => metres.value !== null || ahead.value !== null || camera.value === "chase");
  return (
    <>
      <div class="transport time" role="group" aria-label="Time">
        <button type="button" class="play" onClick={togglePlay} aria-keyshortcuts="Space">{playing.value ? "Pause" : "Play"}</button>
        <button type="button" onClick={does("back")} aria-label="0.1 s back" title="0.1 s back (←)">−1</button>
        <Scrub from={from} to={to} dt={first.dt} contact={first.crash === null ? null : contact} manoeuvre={manoeuvre} />
        <button type="button" onClick={does("on")} aria-label="0.1 s on" title="0.1 s on (→)">+1</button>
        <Clock contact={contact} crashes={first.crash !== null} />
      </div>
      <div class="transport" role="group" aria-label="View">
        <button type="button" onClick={does("manoeuvre")} disabled={manoeuvre === null} title="Begin of the manoeuvre that led to it (m)">To the manoeuvre</button>
        <button type="button" onClick={does("contact")} title={first.crash === null ? "The end (End)" : "Contact (x)"}>{first.crash === null ? "To the end" : "To the crash"}</button>
        <label>speed <select value={String(rate.value)} onChange={(event) => { rate.value = Number(event.currentTarget.value); }}>
          {RATES.map((one) => <option key={one} value={String(one)}>×{one}</option>)}
        </select></label>
        <label>loop <select value={loopName()} onChange={(event) => setLoop(event.currentTarget.value)}>
          <option value="off">off</option><option value="all">all</option><option value="last">last 5 s</option>
        </select></label>
        <span class="choice" role="group" aria-label="Camera">
          <button type="button" aria-pressed={camera.value === "above"} onClick={() => { camera.value = "above"; }} title="From above, to scale (v)">From above</button>
          <button type="button" aria-pressed={camera.value === "chase"} onClick={() => { camera.value = "chase"; }} title="From behind the AV (v)">3-D</button>
        </span>
        {camera.value === "chase" && (
          <label>from <select value={lookFrom.value} onChange={(event) => { lookFrom.value = event.currentTarget.value as Place; }}>
            <option value="behind">behind the AV</option><option value="ahead">ahead, looking back</option><option value="beside">its right</option>
          </select></label>
        )}
        <span class="choice" role="group" aria-label="Zoom">
          <button type="button" onClick={does("out")} aria-label="Farther" title="Farther (−)">−</button>
          <button type="button" onClick={does("in")} aria-label="Nearer" title="Nearer (+)">+</button>
          <button type="button" onClick={resetView} disabled={!isMoved.value} title="The view as it was first (0)">Reset view</button>
        </span>
        <label><input type="checkbox" checked={trails.value} onChange={() => { trails.value = !trails.value; }} /> trails</label>
      </div>
    </>
  );
}

interface ScrubProps {
  from: number;
  to: number;
  dt: number;
  contact: number | null;
  manoeuvre: number | null;
}

function Scrub({ from, to, dt, contact, manoeuvre }: ScrubProps) {
  const ref = useRef<HTMLInputElement>(null);
  const list = "moments";
  useSignalEffect(() => {
    const seconds = time.value;
    const slider = ref.current;
    if (!slider) return;
    slider.value = String(Math.round(seconds / dt));
    if (!playing.value) slider.setAttribute("aria-valuetext", `${seconds.toFixed(1)} seconds`);
  });
  const step = (seconds: number) => Math.round(seconds / dt);
  return (
    <>
      <input ref={ref} type="range" min={step(from)} max={step(to)} step={1} defaultValue={String(step(time.peek()))} list={list} aria-label="Time"
        onInput={(event) => seek(Number(event.currentTarget.value) * dt)} />
      <datalist id={list}>
        {manoeuvre !== null && <option value={step(manoeuvre)} label="manoeuvre" />}
        {contact !== null && <option value={step(contact)} label="contact" />}
      </datalist>
    </>
  );
}

function Clock({ contact, crashes }: { contact: number; crashes: boolean }) {
  const text = useComputed(() => {
    const now = Math.floor(time.value * 10 + 1e-6) / 10;
    const left = contact - now;
    return `${now.toFixed(1)} s${crashes ? (left > 0.05 ? `, ${left.toFixed(1)} s before contact` : ", contact") : ""}`;
  });
  return <span class="clock" role="timer" title="time since the test began">{text}</span>;
}
