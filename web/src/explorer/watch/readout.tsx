// Values at the moment that is shown; with two recordings, both and their difference.
import { useComputed } from "@preact/signals";
import { show, showSmall } from "../../shared/format";
import { boxAt, crashFrame, decisionAt } from "../../shared/motion";
import { accelerationAt } from "../../shared/trails";
import { time } from "../state";
import { type Run, frameOf, isOn } from "./run";
import { gapAt, gapName } from "./series";
import { runs } from "./view";

interface Reading {
  readonly name: string;
  readonly unit: string;
  readonly digits: number;
  /** null: none; Infinity: never. */
  value(run: Run, frame: number): number | null | undefined;
}

const partner = ({ item }: Run) => (item.partner > 0 ? item.vehicles[item.partner]! : null);
const ttc = (values: readonly (number | null)[], frame: number) => (values.length === 0 ? null : (values[frame] ?? Infinity));

const gapOfPair = ({ item }: Run, frame: number) => gapAt(item, frame);

const READINGS: readonly Reading[] = [
  { name: "AV speed", unit: "m/s", digits: 1, value: ({ item }, frame) => boxAt(item.vehicles[0]!, frame)?.v },
  { name: "BV speed", unit: "m/s", digits: 1, value: (run, frame) => { const bv = partner(run); return bv && boxAt(bv, frame)?.v; } },
  { name: "AV acceleration", unit: "m/s²", digits: 1, value: ({ item }, frame) => accelerationAt(item.vehicles[0]!, frame, item.dt) },
  { name: "gap", unit: "m", digits: 1, value: gapOfPair },
  { name: "TTC in the lane", unit: "s", digits: 1, value: ({ item }, frame) => ttc(item.ttc, frame) },
  { name: "TTC in the plane", unit: "s", digits: 1, value: ({ item }, frame) => ttc(item.ttcPlane, frame) },
];

/** What goes on: before, at or without a contact. */
export function stateOf(run: Run, now: number, frame: number): string {
  const { item } = run;
  if (item.crash !== null && frame >= crashFrame(item)) return "contact";
  if (!isOn(run, now)) return frame <= 0 ? "not begun" : "over, no contact";
  return item.crash === null ? "drives" : `${((crashFrame(item) - frame) * item.dt).toFixed(1)} s before contact`;
}

const rounded = (now: number, run: Run): number => Math.floor(frameOf(run, now) + 1e-6);

function controlled(run: Run, frame: number): string {
  const k = decisionAt(run.item, frame);
  const index = run.item.critical[k] ?? -1;
  const p = run.item.p_nde[k] ?? null;
  if (k < 0 || index <= 0) return "";
  const chance = p === null ? "" : p === 0 ? ", impossible in natural traffic" : `, natural probability ${showSmall(p)}`;
  return `The adversary controls BV ${run.item.vehicles[index]!.slot}: ${(run.item.action[k] || "no action").replace("-", "−")}${chance}.`;
}

export function Readout() {
  // Written anew at recorded frames only, so at most 10 times a second of the recording.
  const tenth = useComputed(() => Math.round(time.value * 1000) / 1000);
  const step = useComputed(() => Math.floor(tenth.value * 10 + 1e-6) / 10);
  const now = step.value;
  const shown = runs.value;
  if (shown.length === 0) return null;
  const frames = shown.map((run) => rounded(now, run));
  const [a, b] = [shown[0]!, shown[1]];
  const isSite = a.item.site !== undefined;
  const readings = READINGS.filter(({ name }) => !(isSite && name === "TTC in the lane"));
  const rows = readings.map((reading) => ({ ...reading, name: reading.value === gapOfPair ? gapName(a.item) : reading.name, values: shown.map((run, i) => reading.value(run, frames[i]!)) }));
  const said = controlled(a, frames[0]!);
  if (!b) {
    return (
      <>
        <dl class="readout">
          {rows.map(({ name, unit, digits, values }) => <div key={name}><dt>{name}</dt><dd>{show(values[0], unit, digits)}</dd></div>)}
        </dl>
        {said && <p class="note">{said}</p>}
      </>
    );
  }
  const difference = (x: number | null | undefined, y: number | null | undefined) =>
    typeof x === "number" && typeof y === "number" && Number.isFinite(x) && Number.isFinite(y) ? y - x : null;
  return (
    <table class="readings">
      <thead><tr><td /><th scope="col">A</th><th scope="col">B</th><th scope="col">B − A</th></tr></thead>
      <tbody>
        <tr><th scope="row">now</th>{shown.map((run, i) => <td key={run.mark}>{stateOf(run, now, frames[i]!)}</td>)}<td /></tr>
        {rows.map(({ name, unit, digits, values }) => {
          const gap = difference(values[0], values[1]);
          return (
            <tr key={name}>
              <th scope="row">{name}</th>
              {values.map((value, i) => <td key={i}>{show(value, unit, digits)}</td>)}
              <td class={gap !== null && Math.abs(gap) >= 0.05 ? "differs" : ""}>{gap === null ? "–" : `${gap > 0.05 ? "+" : ""}${show(gap, unit, digits)}`}</td>
            </tr>
          );
        })}
      </tbody>
    </table>
  );
}
