// The map of all cases: points to look at, to point at, to choose, to draw a line around.
import { effect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { ticks, toData, toScreen } from "./camera";
import { columns, failure, infos, keyOf, n, rowOf } from "./data";
import { count, number } from "./format";
import { Legend } from "./legend";
import { cellOf } from "./list";
import { drawing, finishLasso, fitAll, hovered, isFitted, moveBy, rowAt, sceneOf, size, startFitting, view, zoomAt, zoomBy } from "./mapview";
import { paint } from "./painter";
import { axes, colour, filters, lasso, watched } from "./state";
import { css } from "../shared/colours";
import { dark } from "./theme";
import { lassoing } from "./ui";
import {
  axisColumns, clearAll, colourColumn, cursor, encoding, fails, isFiltered, isNumeric, nameOf, passing, placed, USUAL_AXES, USUAL_COLOURS, watch,
} from "./views";

/** How near a pointer must be to a point [px]. */
const MOUSE = 8;
const FINGER = 20;

export function MapPane() {
  return (
    <>
      <header class="pane-head map-head">
        <h2 class="hidden">Map</h2>
        <label class="pick">
          Colour
          <select id="colour" value={colourColumn.value ?? ""} onChange={(event) => (colour.value = event.currentTarget.value)}>
            <Options usual={USUAL_COLOURS} fits={(type) => type !== "text"} />
          </select>
        </label>
        <Axis index={0} />
        <Axis index={1} />
      </header>
      <Plane />
      <Legend />
    </>
  );
}

function Options({ usual, fits }: { usual: readonly string[]; fits: (type: string) => boolean }) {
  const all = [...infos.value.values()].filter((info) => fits(info.type) && info.name !== "source");
  const first = usual.filter((name) => all.some((info) => info.name === name));
  return (
    <>
      <optgroup label="Often used">{first.map((name) => <option key={name} value={name}>{nameOf(name)}</option>)}</optgroup>
      <optgroup label="All others">
        {all.filter(({ name }) => !first.includes(name)).map(({ name }) => <option key={name} value={name}>{nameOf(name)}</option>)}
      </optgroup>
    </>
  );
}

function Axis({ index }: { index: 0 | 1 }) {
  const now = axisColumns.value;
  if (!now) return null;
  return (
    <label class="pick">
      {index === 0 ? "Across" : "Up"}
      <select
        value={now[index]}
        onChange={(event) => {
          // A line drawn on other axes means nothing on these.
          lasso.value = [];
          axes.value = index === 0 ? [event.currentTarget.value, now[1]] : [now[0], event.currentTarget.value];
        }}
      >
        <Options usual={USUAL_AXES} fits={(type) => type === "number" || type === "integer"} />
      </select>
    </label>
  );
}

function Plane() {
  const box = useRef<HTMLDivElement>(null);
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const seen = new ResizeObserver(() => (size.value = { width: box.current!.clientWidth, height: box.current!.clientHeight }));
    seen.observe(box.current!);
    const stops = [startPainting(canvas.current!), startFitting(), listen(canvas.current!)];
    return () => {
      seen.disconnect();
      stops.forEach((stop) => stop());
    };
  }, []);
  const waits = n.value === 0 || !placed.value || !encoding.value;
  return (
    <div class={lassoing.value ? "plane lassoing" : "plane"} ref={box}>
      <canvas
        id="map"
        ref={canvas}
        tabIndex={0}
        role="application"
        aria-label={`Map of ${count(passing.value)} cases. The list holds the same cases as text.`}
        aria-keyshortcuts="ArrowLeft ArrowRight ArrowUp ArrowDown + - 0 Enter"
      />
      <Overlay />
      <Tip />
      <Buttons />
      {waits ? <Waiting /> : passing.value === 0 && (
        <div class="empty over" role="status">
          <p>No case passes the filters.</p>
          {isFiltered.value && <button type="button" onClick={clearAll}>Clear all filters</button>}
        </div>
      )}
    </div>
  );
}

function Waiting() {
  const hasPlane = axisColumns.value !== null && infos.value.size > 1;
  return (
    <div class="empty over" role="status">
      {failure.value !== null ? <p>Nothing to show: the server did not answer.</p> : infos.value.size <= 1 || hasPlane ? <p>Loading the cases …</p> : <p>The map appears when the analysis is done.</p>}
    </div>
  );
}

function Buttons() {
  return (
    <div class="map-buttons" role="group" aria-label="Map">
      <button type="button" aria-label="Nearer" title="Nearer (+)" onClick={() => zoomBy(1.8)}>+</button>
      <button type="button" aria-label="Farther" title="Farther (−)" onClick={() => zoomBy(1 / 1.8)}>−</button>
      <button type="button" disabled={isFitted.value} title="Everything in sight (0)" onClick={fitAll}>Fit</button>
      <button type="button" id="lasso" aria-pressed={lassoing.value} title="Draw a line around cases (l, or Shift and drag)" onClick={() => (lassoing.value = !lassoing.value)}>Lasso</button>
      {lasso.value.length > 0 && <button type="button" onClick={() => (lasso.value = [])}>Clear lasso</button>}
    </div>
  );
}

/** Axes, the lasso, and rings around what is pointed at and watched. */
function Overlay() {
  const now = view.value;
  const at = placed.value;
  if (!now || !at) return null;
  const { width, height } = size.value;
  const [left, low] = toData(now, size.value, 0, height);
  const [right, high] = toData(now, size.value, width, 0);
  const text = (value: number, isLog: boolean) => number(isLog ? 10 ** value : value);
  const closed = lasso.value.map((point) => toScreen(now, size.value, ...at.toAxis(point)));
  const ring = (row: number, name: string) => {
    const x = at.xs[row];
    const y = at.ys[row];
    if (row < 0 || x === undefined || y === undefined || Number.isNaN(x + y)) return null;
    const [px, py] = toScreen(now, size.value, x, y);
    return <circle class={name} cx={px} cy={py} r={name === "ring-watched" ? 10 : 8} />;
  };
  return (
    <svg class="overlay" width={width} height={height} aria-hidden="true">
      {ticks(left, right, Math.max(2, width / 130)).map((value) => {
        const [px] = toScreen(now, size.value, value, 0);
        return px > 30 && px < width - 30 && <g key={`x${value}`}><line class="tick" x1={px} x2={px} y1={height - 4} y2={height} /><text class="tick" x={px} y={height - 7} text-anchor="middle">{text(value, at.log[0])}</text></g>;
      })}
      {ticks(low, high, Math.max(2, height / 90)).map((value) => {
        const [, py] = toScreen(now, size.value, 0, value);
        return py > 16 && py < height - 24 && <g key={`y${value}`}><line class="tick" x1={0} x2={4} y1={py} y2={py} /><text class="tick" x={7} y={py + 4}>{text(value, at.log[1])}</text></g>;
      })}
      <text class="axis" x={width - 6} y={height - 20} text-anchor="end">{axisText(at.columns[0])} →</text>
      <text class="axis" x={6} y={14}>↑ {axisText(at.columns[1])}</text>
      {closed.length > 0 && <polygon class="lasso" points={closed.map(([x, y]) => `${x},${y}`).join(" ")} />}
      {drawing.value.length > 0 && <polyline class="lasso" points={drawing.value.map(([x, y]) => `${x},${y}`).join(" ")} />}
      {cursor.value !== hovered.value && ring(cursor.value, "ring-cursor")}
      {watched.value !== null && ring(rowOf(watched.value), "ring-watched")}
      {ring(hovered.value, "ring-hover")}
    </svg>
  );
}

function axisText(name: string): string {
  const unit = infos.value.get(name)?.unit;
  return unit ? `${nameOf(name)} [${unit.replace("m/s2", "m/s²")}]` : nameOf(name);
}

function Tip() {
  const row = hovered.value;
  const now = view.value;
  const at = placed.value;
  if (row < 0 || !now || !at) return null;
  const [px, py] = toScreen(now, size.value, at.xs[row]!, at.ys[row]!);
  const kind = ["mechanism", "crash_type"].find((name) => {
    const column = columns.value.get(name);
    return column?.kind === "category" && column.names[column.codes[row]!] !== "not known";
  });
  const shown = colourColumn.value;
  const info = shown === null ? undefined : infos.value.get(shown);
  const unit = isNumeric(info) && shown !== "often" && info?.unit !== "rad" ? (info?.unit ?? "") : "";
  const right = px > size.value.width / 2;
  return (
    <div class="tip" style={{ left: right ? "auto" : `${px + 14}px`, right: right ? `${size.value.width - px + 14}px` : "auto", top: `${Math.max(4, Math.min(size.value.height - 74, py - 20))}px` }}>
      <b>{keyOf(row)}</b>
      {kind && <p>{cellOf(kind, columns.value.get(kind), row)}</p>}
      {shown && shown !== kind && <p>{nameOf(shown)}: {shown === "often" && "once in "}{cellOf(shown, columns.value.get(shown), row)} {unit}</p>}
    </div>
  );
}

const colourNumber = (name: string): number => Number.parseInt(css(name).replace("#", ""), 16);

/** Paints whenever what is shown changes, once a frame at most. */
function startPainting(canvas: HTMLCanvasElement): () => void {
  const context = canvas.getContext("2d")!;
  let image: ImageData | null = null;
  let pixels = new Uint32Array(0);
  let ticket = 0;
  const put = () => {
    ticket = 0;
    const px = Math.min(2, window.devicePixelRatio || 1);
    const [width, height] = [Math.round(size.peek().width * px), Math.round(size.peek().height * px)];
    if (width === 0 || height === 0) return;
    if (!image || image.width !== width || image.height !== height) {
      canvas.width = width;
      canvas.height = height;
      image = context.createImageData(width, height);
      pixels = new Uint32Array(image.data.buffer);
    }
    const scene = sceneOf(px, colourNumber("paper"), colourNumber("faint"));
    const now = view.peek();
    if (!scene || !now) {
      context.clearRect(0, 0, width, height);
      return;
    }
    paint(pixels, { width, height }, { ...now, sx: now.sx * px, sy: now.sy * px }, scene);
    context.putImageData(image, 0, 0);
  };
  const stop = effect(() => {
    void dark.value;
    void size.value;
    sceneOf(1, 0, 0);
    if (ticket === 0) ticket = requestAnimationFrame(put);
  });
  return () => {
    stop();
    cancelAnimationFrame(ticket);
  };
}

/** Pointer, wheel and keys of the map. */
function listen(canvas: HTMLCanvasElement): () => void {
  const ending = new AbortController();
  const on = <K extends keyof HTMLElementEventMap>(type: K, act: (event: HTMLElementEventMap[K]) => void, passive = true) =>
    canvas.addEventListener(type, act, { signal: ending.signal, passive });
  const placeOf = (event: { clientX: number; clientY: number }): [number, number] => {
    const rect = canvas.getBoundingClientRect();
    return [event.clientX - rect.left, event.clientY - rect.top];
  };
  const held = new Map<number, [number, number]>();
  let mode: "none" | "move" | "lasso" = "none";
  let travelled = 0;
  let ticket = 0;

  on("pointerdown", (event) => {
    if (event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, placeOf(event));
    if (held.size === 1) {
      travelled = 0;
      mode = lassoing.peek() || event.shiftKey ? "lasso" : "move";
      if (mode === "lasso") drawing.value = [placeOf(event)];
    } else {
      // A second finger zooms, whatever the first began.
      mode = "move";
      drawing.value = [];
      travelled = Infinity;
    }
    hovered.value = -1;
  });
  on("pointermove", (event) => {
    const before = held.get(event.pointerId);
    const at = placeOf(event);
    if (!before) {
      if (event.pointerType === "touch" || ticket !== 0) return;
      ticket = requestAnimationFrame(() => {
        ticket = 0;
        if (held.size === 0) hovered.value = rowAt(...at, MOUSE);
      });
      return;
    }
    const [dx, dy] = [at[0] - before[0], at[1] - before[1]];
    travelled += Math.hypot(dx, dy);
    if (held.size === 2) {
      const [, other] = [...held].find(([id]) => id !== event.pointerId)!;
      const spread = (p: readonly [number, number]) => Math.max(10, Math.hypot(p[0] - other[0], p[1] - other[1]));
      const middle = (p: readonly [number, number]) => [(p[0] + other[0]) / 2, (p[1] + other[1]) / 2] as const;
      moveBy(middle(at)[0] - middle(before)[0], middle(at)[1] - middle(before)[1]);
      zoomAt(spread(at) / spread(before), ...middle(at));
    } else if (mode === "lasso") drawing.value = [...drawing.peek(), at];
    else if (mode === "move" && travelled > 3) moveBy(dx, dy);
    held.set(event.pointerId, at);
  });
  const release = (event: PointerEvent, cancelled: boolean) => {
    if (!held.delete(event.pointerId) || held.size > 0) return;
    if (mode === "lasso" && !cancelled && travelled > 8) {
      finishLasso();
      lassoing.value = false;
    } else if (!cancelled && travelled <= 4) {
      const row = rowAt(...placeOf(event), event.pointerType === "touch" ? FINGER : MOUSE);
      if (row >= 0) watch(keyOf(row));
    }
    drawing.value = [];
    mode = "none";
  };
  on("pointerup", (event) => release(event, false));
  on("pointercancel", (event) => release(event, true));
  on("pointerleave", () => {
    cancelAnimationFrame(ticket);
    ticket = 0;
    if (held.size === 0) hovered.value = -1;
  });
  on("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
    zoomAt(Math.exp(-Math.max(-240, Math.min(240, event.deltaY * lines)) * (event.ctrlKey ? 0.01 : 0.0018)), ...placeOf(event));
    hovered.value = -1;
  }, false);
  on("dblclick", (event) => zoomAt(event.shiftKey ? 0.5 : 2, ...placeOf(event)));
  on("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const far = event.shiftKey ? 120 : 40;
    const acts: Record<string, () => void> = {
      ArrowLeft: () => moveBy(far, 0),
      ArrowRight: () => moveBy(-far, 0),
      ArrowUp: () => moveBy(0, far),
      ArrowDown: () => moveBy(0, -far),
      "+": () => zoomBy(1.8),
      "=": () => zoomBy(1.8),
      "-": () => zoomBy(1 / 1.8),
      "0": fitAll,
      Enter: () => { if (cursor.peek() >= 0) watch(keyOf(cursor.peek())); },
    };
    const act = acts[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }, false);
  return () => {
    ending.abort();
    cancelAnimationFrame(ticket);
  };
}

/** Whether cases of several sources share axes that each source has for itself. */
export function planesDiffer(): boolean {
  const at = axisColumns.value;
  const source = filters.value.get("source");
  const sources = columns.value.get("source");
  const several = sources?.kind === "category" && sources.names.length > 1 && (source?.kind !== "values" || source.values.length > 1);
  return several && at !== null && at.some((name) => /^pc\d/.test(name)) && fails.value.length > 0;
}
