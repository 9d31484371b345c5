// The report: its figures, and the stored cases with their readings and the chart of the one that is shown.
import type { Case, Motion } from "../shared/case";
import { show } from "../shared/format";
import { boxAt, decisionAt, gapOf, secondsAt } from "../shared/motion";
import { drawScene, fitHeight, type Ghost } from "../shared/scene";
import { changeLayout, drawFigure, drawFigures, type Drawn, type Figure } from "./charts";
import { showFirst } from "./look";
import { byId, makePlayer, pageData, type Playable } from "./player";

interface Item extends Case, Playable {
  /** It is the one to watch first. */
  readonly watchFirst: boolean;
  /** Why it is here. */
  readonly role: string;
}

let chartFrame = -1;

const lastFrame = (item: Item) => item.frames - 1;
const partnerOf = (item: Item) => (item.partner > 0 ? item.vehicles[item.partner]! : null);

function writeReadout(item: Item, frame: number): void {
  const av = boxAt(item.vehicles[0]!, frame)!;
  const partner = partnerOf(item);
  const bv = partner && boxAt(partner, frame);
  const k = decisionAt(item, frame);
  const critical = item.vehicles[item.critical[k] ?? -1];
  const p = item.p_nde[k] ?? null;
  const ttc = (value: number | null | undefined) => (value === null ? "∞" : show(value, "s", 2));
  const cells: Record<string, string> = {
    frame: `${item.first + frame} of ${item.first + lastFrame(item)}`,
    time: show(secondsAt(item, frame), "s"),
    before: show(item.crash === null ? null : (item.crash - frame) * item.dt, "s"),
    av: show(av.v, "m/s"),
    bv: show(bv?.v, "m/s"),
    gap: show(bv && gapOf(item, av, bv), "m"),
    ttc: ttc(item.ttc[frame]),
    plane: ttc(item.ttcPlane[frame]),
    critical: critical && critical !== item.vehicles[0] ? `BV ${critical.slot}: ${item.action[k] || "–"}` : "–",
    p: p === null ? "–" : p === 0 ? "impossible" : String(p),
  };
  for (const [name, value] of Object.entries(cells)) byId(`read-${name}`).textContent = value;
}

function series(item: Item, motion: Motion): { x: number[]; y: readonly (number | null)[] } {
  return { x: motion.v.map((_, i) => secondsAt(item, motion.from + i)), y: motion.v };
}

/** Lowest and highest speed of the two and of the way out, at least 6 m/s apart, so that noise does not look like a manoeuvre. */
function speedRange(item: Item): [number, number] {
  const shown = [item.vehicles[0]!, partnerOf(item), item.wayOut];
  const speeds = shown.flatMap((motion) => motion?.v ?? []).filter((v) => v !== null);
  const [low, high] = [Math.min(...speeds), Math.max(...speeds)];
  const pad = Math.max(0.5, (6 - (high - low)) / 2);
  return [Math.max(-0.3, low - pad), high + pad];
}

function drawChart(item: Item): void {
  const range = [secondsAt(item, 0), secondsAt(item, lastFrame(item)) + 0.05 * item.frames * item.dt];
  const axis = { gridcolor: "css:grid", linecolor: "css:muted", zeroline: false };
  const data: unknown[] = [{ ...series(item, item.vehicles[0]!), name: "speed of the AV", line: { color: "css:av", width: 2.5 } }];
  const partner = partnerOf(item);
  if (partner) {
    if (item.wayOut) {
      data.push({ ...series(item, item.wayOut), mode: "lines", name: "on its last way out", line: { color: "css:way-out", width: 2, dash: "dot" } });
    }
    data.push({ ...series(item, partner), name: `speed of BV ${partner.slot}`, line: { color: "css:partner", width: 2.5, dash: "dash" } });
    const x = item.ttc.map((_, i) => secondsAt(item, i));
    data.push({ x, y: item.ttc, yaxis: "y2", name: "time to collision in the lane", line: { color: "css:ink", width: 2.5 } });
    data.push({ x, y: item.ttcPlane, yaxis: "y2", name: "in the plane", line: { color: "css:plane", width: 2, dash: "dot" } });
  }
  const upright = { type: "line", yref: "paper", y0: 0, y1: 1 };
  const shapes: unknown[] = [{ ...upright, x0: range[0], x1: range[0], line: { color: "css:muted", width: 2 } }];
  const annotations: unknown[] = [];
  if (item.crash !== null) {
    const t = secondsAt(item, item.crash);
    shapes.push({ ...upright, x0: t, x1: t, line: { color: "css:contact", width: 2, dash: "dot" } });
    annotations.push({ x: t, xanchor: "right", xshift: -4, y: 0.52, yanchor: "top", yref: "paper", text: "crash", showarrow: false, font: { color: "css:contact" } });
  }
  const layout = {
    height: byId("case-chart").clientWidth < 480 ? 380 : 300, margin: { l: 56, r: 12, t: 30, b: 40 }, hovermode: "x", dragmode: false as const, shapes, annotations,
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: "system-ui, sans-serif", size: 12, color: "css:ink" },
    hoverlabel: { bgcolor: "css:paper", font: { color: "css:ink" } },
    legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" },
    xaxis: { ...axis, title: { text: "time since the drive began [s]" }, range, anchor: "y2" },
    yaxis: { ...axis, title: { text: "m/s" }, domain: [0.52, 1], range: speedRange(item) },
    yaxis2: { ...axis, title: { text: "s" }, domain: [0, 0.42], range: [0, 10] },
  };
  chartFrame = -1;
  drawFigure(byId("case-chart"), { data, layout });
}

function moveCursor(item: Item, frame: number): void {
  if (frame === chartFrame) return;
  chartFrame = frame;
  const t = secondsAt(item, frame);
  changeLayout(byId("case-chart"), { "shapes[0].x0": t, "shapes[0].x1": t });
}

function playCases(cases: readonly Item[]): void {
  const road = byId("road") as HTMLCanvasElement;
  const player = makePlayer<Item>({
    cases,
    draw: (item, frame, metres, colours) => {
      const ghosts: Ghost[] = item.wayOut ? [{ motion: item.wayOut, colour: colours["way-out-box"], name: "way out" }] : [];
      fitHeight(road, item, metres);
      drawScene(road, item, frame, { metres, detail: true, ghosts }, colours);
    },
    chosen: (item) => {
      byId("case-role").textContent = `Case ${item.id}: ${item.role}.`;
      byId("key-critical").hidden = item.critical.every((index) => index <= 0);
      drawChart(item);
    },
    moved: (item, frame) => { writeReadout(item, frame); moveCursor(item, frame); },
    thumbnail: (item) => item,
  });
  player.start(Math.max(0, cases.findIndex((item) => item.watchFirst)));
  document.querySelector<Drawn>('[data-figure="map"]')!.on("plotly_click", (event) => {
    const id = event.points[0]!.customdata;
    byId("map-note").textContent = player.selectId(id)
      ? "" : `Case ${id} is not among those on this page; play it with: cornerforge replay LIBRARY ${id}`;
  });
  (byId("case-chart") as Drawn).on("plotly_click", (event) => {
    player.seek(Math.round(event.points[0]!.x / player.current().dt) - player.current().first);
  });
}

export function startReport(): void {
  drawFigures(pageData<Record<string, Figure>>("figures"));
  const cases = pageData<Item[]>("cases");
  showFirst(cases); // before the player, so that Space is for the picture in sight
  if (cases.length > 0) playCases(cases);
}
