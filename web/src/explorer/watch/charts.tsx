// Time series under the picture: a cursor moves with the clock, a click or a drag moves the clock, and hovering reads values.
import "uplot/dist/uPlot.min.css";
import uPlot from "uplot";
import { useEffect, useRef } from "preact/hooks";
import { effect } from "@preact/signals";
import { show } from "../../shared/format";
import { crashFrame, secondsAt } from "../../shared/motion";
import { playing, time } from "../state";
import { seek } from "./player";
import type { Run } from "./run";
import { type Panel, type Series, series } from "./series";
import { type Shade, colours, runs, shades } from "./view";

/** A moment that the charts mark [s of the clock]. */
export interface Mark {
  readonly at: number;
  readonly text: string;
  readonly colour: "contact" | "muted";
}

export function Charts({ manoeuvre }: { manoeuvre: number | null }) {
  const ref = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const host = ref.current!;
    let drawn: Chart[] = [];
    const stopMaking = effect(() => {
      for (const chart of drawn) chart.destroy();
      host.replaceChildren();
      drawn = [];
      if (runs.value.length === 0) return;
      colours.value; // made anew in other colours
      const shown = series(runs.value, shades.value.map(lineOf));
      const marks = marksOf(runs.value, manoeuvre);
      drawn = shown.panels.map((panel) => new Chart(host, panel, shown, marks));
      for (const chart of drawn) chart.fit(); // each has its width only when all of them stand
    });
    const stopMoving = effect(() => moveAll(drawn, time.value, !playing.value));
    const watcher = new ResizeObserver(() => { for (const chart of drawn) chart.fit(); });
    watcher.observe(host);
    return () => { stopMoving(); stopMaking(); watcher.disconnect(); for (const chart of drawn) chart.destroy(); };
  }, [manoeuvre]);
  return <div class="series" ref={ref} />;
}

const lineOf = ({ name, motion, colour }: Shade) => ({ name, motion, colour });

function marksOf(shown: readonly Run[], manoeuvre: number | null): Mark[] {
  const marks: Mark[] = [];
  if (manoeuvre !== null) marks.push({ at: manoeuvre, text: "manoeuvre begins", colour: "muted" });
  for (const { item, shift, mark } of shown) {
    const isAgain = mark === "B" && marks.some(({ at, colour }) => colour === "contact" && Math.abs(at + shift - secondsAt(item, crashFrame(item))) < 0.05);
    if (item.crash !== null && !isAgain) {
      marks.push({ at: secondsAt(item, crashFrame(item)) - shift, text: shown.length > 1 ? `contact ${mark}` : "contact", colour: "contact" });
    }
  }
  return marks;
}

/** Move the cursors; the readings follow at recorded frames only. */
function moveAll(drawn: readonly Chart[], now: number, isExact: boolean): void {
  for (const chart of drawn) chart.move(now, isExact);
}

const HEIGHT = 132;

/** One panel: a plot of uPlot with a cursor of our own, which costs no drawing. */
class Chart {
  private readonly plot: uPlot;
  private readonly figure = document.createElement("figure");
  private readonly now = document.createElement("div");
  private readonly legend = document.createElement("figcaption");
  private readonly values: HTMLElement[] = [];
  private index = -1;
  private hovered = -1;

  constructor(host: HTMLElement, private readonly panel: Panel, private readonly shown: Series, marks: readonly Mark[]) {
    const palette = colours.value;
    this.now.className = "now";
    this.figure.append(this.legend);
    host.append(this.figure);
    this.writeLegend();
    const axis = { stroke: palette.muted, grid: { stroke: palette.grid, width: 1 }, ticks: { stroke: palette.grid, width: 1 }, font: "11px system-ui, sans-serif" };
    this.plot = new uPlot(
      {
        width: Math.max(120, this.figure.clientWidth),
        height: HEIGHT,
        legend: { show: false },
        cursor: { sync: { key: "watch" }, drag: { x: false, y: false }, y: false, points: { size: 6 } },
        scales: { x: { time: false, range: (_, low, high) => [low, high + 0.03 * (high - low)] }, y: { range: () => [...panel.range] } },
        axes: [{ ...axis, size: 24 }, { ...axis, size: 38 }],
        series: [
          {},
          ...panel.lines.map((line) => ({
            label: line.label, stroke: palette[line.colour], width: 2, dash: [...line.dash], points: { show: false }, spanGaps: false,
          })),
        ],
        hooks: {
          draw: [(plot: uPlot) => drawMarks(plot, marks)],
          setCursor: [(plot: uPlot) => this.hover(plot.cursor.idx ?? -1)],
        },
      },
      [[...shown.x], ...panel.lines.map((line) => [...line.values])],
      this.figure,
    );
    this.plot.over.append(this.now);
    this.drag();
  }

  private writeLegend(): void {
    const { panel, legend } = this;
    legend.append(`${panel.name[0]!.toUpperCase()}${panel.name.slice(1)} [${panel.unit}]`);
    for (const line of panel.lines) {
      const entry = document.createElement("span");
      const swatch = document.createElement("i");
      swatch.style.borderTop = `3px ${line.dash.length === 0 ? "solid" : line.dash[0]! > 3 ? "dashed" : "dotted"} ${colours.value[line.colour]}`;
      const value = document.createElement("b");
      entry.append(swatch, `${line.label} `, value);
      this.values.push(value);
      legend.append(entry);
    }
  }

  /** A press or a drag moves the clock. */
  private drag(): void {
    const over = this.plot.over;
    const take = (event: PointerEvent) => seek(this.plot.posToVal(event.clientX - over.getBoundingClientRect().left, "x"));
    over.addEventListener("pointerdown", (event) => {
      over.setPointerCapture(event.pointerId);
      take(event);
    });
    over.addEventListener("pointermove", (event) => { if (over.hasPointerCapture(event.pointerId)) take(event); });
  }

  private hover(index: number): void {
    this.hovered = index;
    this.write();
  }

  move(now: number, isExact: boolean): void {
    const x = this.plot.valToPos(now, "x");
    this.now.style.transform = `translateX(${x.toFixed(1)}px)`;
    const index = Math.round((now - this.shown.x[0]!) / ((this.shown.x[1] ?? 0.1) - this.shown.x[0]!));
    if (index === this.index && !isExact) return;
    this.index = index;
    this.write();
  }

  private write(): void {
    const index = this.hovered >= 0 ? this.hovered : this.index;
    this.legend.classList.toggle("hovered", this.hovered >= 0);
    this.panel.lines.forEach((line, i) => {
      const value = line.values[index] ?? null;
      const text = value === null && this.panel.name === "time to collision" ? "∞" : show(value, "", 1);
      if (this.values[i]!.textContent !== text) this.values[i]!.textContent = text;
    });
  }

  fit(): void {
    const width = Math.max(120, this.figure.clientWidth);
    if (width !== this.plot.width) this.plot.setSize({ width, height: HEIGHT });
    this.move(time.peek(), true);
  }

  destroy(): void {
    this.plot.destroy();
  }
}

function drawMarks(plot: uPlot, marks: readonly Mark[]): void {
  const pen = plot.ctx;
  const { left, top, width, height } = plot.bbox;
  const pixels = window.devicePixelRatio || 1;
  pen.save();
  for (const { at, colour } of marks) {
    const x = plot.valToPos(at, "x", true);
    if (x < left || x > left + width) continue;
    pen.strokeStyle = colours.peek()[colour];
    pen.lineWidth = 1.5 * pixels;
    pen.setLineDash([4 * pixels, 3 * pixels]);
    pen.beginPath();
    pen.moveTo(x, top);
    pen.lineTo(x, top + height);
    pen.stroke();
  }
  pen.restore();
}
