// The page of `retest`: plays a case as both versions drive it, on one clock. A version whose test is over stands still
// while the other drives on.
import type { Case } from "../shared/case";
import { show } from "../shared/format";
import { boxAt, gapOf, secondsAt } from "../shared/motion";
import { drawScene, fitHeight } from "../shared/scene";
import { byId, makePlayer, pageData, type Playable } from "./player";

const SIDES = ["old", "new"] as const;
type Side = (typeof SIDES)[number];

interface Item extends Playable {
  readonly old: Case | null;
  readonly new: Case;
  /** How each version's test ended, in words. */
  readonly ends: Readonly<Record<Side, string>>;
}

const held = (recording: Case, frame: number) => Math.min(frame, recording.frames - 1);

function write(side: Side, item: Item, frame: number): void {
  const recording = item[side];
  const now = recording ? held(recording, frame) : 0;
  const av = recording && boxAt(recording.vehicles[0]!, now);
  const bv = recording && recording.partner > 0 ? boxAt(recording.vehicles[recording.partner]!, now) : null;
  const touches = recording !== null && recording.crash !== null && now >= recording.crash;
  const isOver = recording !== null && frame > recording.frames - 1;
  const cells: Record<string, string> = {
    end: item.ends[side],
    av: show(av?.v, "m/s"),
    bv: show(bv?.v, "m/s"),
    gap: show(recording && av && bv && gapOf(recording, av, bv), "m"),
    state: touches ? "contact" : isOver ? "over" : recording ? "driving" : "–",
  };
  for (const [name, value] of Object.entries(cells)) byId(`${side}-${name}`).textContent = value;
  byId(`${side}-state`).classList.toggle("touches", touches);
}

export function startComparison(): void {
  const cases = pageData<Item[]>("cases");
  if (cases.length === 0) return;
  makePlayer<Item>({
    cases,
    draw: (item, frame, metres, colours) => {
      for (const side of SIDES) {
        const canvas = byId(`road-${side}`) as HTMLCanvasElement;
        const recording = item[side];
        canvas.hidden = !recording;
        if (!recording) continue;
        const ghosts = recording.wayOut
          ? [{ motion: recording.wayOut, colour: colours["way-out-box"], name: "the other version" }] : [];
        fitHeight(canvas, recording, metres);
        drawScene(canvas, recording, held(recording, frame), { metres, detail: true, ghosts }, colours);
      }
    },
    chosen: () => undefined,
    moved: (item, frame) => {
      for (const side of SIDES) write(side, item, frame);
      byId("clock").textContent = show(secondsAt(item, frame), "s");
    },
    thumbnail: (item) => (item.new.crash === null && item.old ? item.old : item.new),
  }).start(0);
}
