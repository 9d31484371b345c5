// How a number is spread over all cases and over those that pass, with a range to choose by two handles.
import { useMemo } from "preact/hooks";
import { columns, n } from "./data";
import { type Bins, histogramOf, placeOf, valueAt } from "./filters";
import { number, onceIn, quantity } from "./format";
import { binsOf } from "./scales";
import { filters } from "./state";
import { BINS, fails, masks, nameOf, setFilter, sourceMask } from "./views";

/** Positions of a handle. */
const STEPS = 200;
const HEIGHT = 40;

interface Props {
  readonly column: string;
  /** Colour of a bar by its place from 0 to 1; without it all have the accent. */
  readonly colourAt?: (place: number) => string;
}

export function Histogram({ column: name, colourAt }: Props) {
  const column = columns.value.get(name);
  const values = column && column.kind !== "text" ? column.values : null;
  const bins = useMemo(() => (column && values ? binsOf(column.info, values, BINS) : null), [column]);
  const own = masks.value.get(name) ?? null;
  const failing = fails.value;
  const others = sourceMask.value;
  const all = useMemo(() => values && bins && histogramOf(values, bins, others, null), [values, bins, others]);
  const now = useMemo(() => values && bins && histogramOf(values, bins, failing, own), [values, bins, failing, own]);
  if (!column || !values) return <p class="quiet">{n.value > 0 ? "Loading" : ""}</p>;
  if (!bins || !all || !now) return <p class="quiet">No case has a value.</p>;
  if (bins.hi === bins.lo) return <p class="quiet">{textOf(name, bins.lo, column.info.unit)} in every case.</p>;

  const filter = filters.value.get(name);
  const [lo, hi] = filter?.kind === "range" ? [filter.lo, filter.hi] : [-Infinity, Infinity];
  const handles = [stepOf(lo, bins, 0), stepOf(hi, bins, STEPS)] as const;
  const choose = (from: number, to: number) => {
    const ends = {
      lo: from <= 0 ? -Infinity : Number(valueAt(from / STEPS, bins).toPrecision(4)),
      hi: to >= STEPS ? Infinity : Number(valueAt(to / STEPS, bins).toPrecision(4)),
    };
    setFilter(name, from <= 0 && to >= STEPS ? null : { kind: "range", ...ends });
  };
  const top = Math.max(...all, 1);
  const nowTop = Math.max(...now, 1);
  const width = 100 / bins.count;
  const ends = [lo === -Infinity ? bins.lo : lo, hi === Infinity ? bins.hi : hi] as const;
  const said = (end: number) => textOf(name, end, column.info.unit);
  return (
    <div class="histogram">
      <svg viewBox={`0 0 100 ${HEIGHT}`} preserveAspectRatio="none" aria-hidden="true">
        {[...all].map((count, bin) => (
          <rect key={`a${bin}`} class="all" x={bin * width} width={width * 0.9} y={HEIGHT - heightOf(count, top)} height={heightOf(count, top)} />
        ))}
        {[...now].map((count, bin) => {
          const place = (bin + 0.5) / bins.count;
          const chosen = place * STEPS >= handles[0] && place * STEPS <= handles[1];
          const height = heightOf(count, nowTop);
          return (
            <rect key={`n${bin}`} class={chosen ? "now" : "out"} x={bin * width} width={width * 0.9} y={HEIGHT - height} height={height}
              fill={chosen && colourAt ? colourAt(place) : undefined} />
          );
        })}
      </svg>
      <div class="handles">
        <input type="range" min={0} max={STEPS} value={handles[0]} aria-label={`${nameOf(name)}: least`} aria-valuetext={said(ends[0])}
          onInput={(event) => choose(Math.min(Number(event.currentTarget.value), handles[1] - 1), handles[1])} />
        <input type="range" min={0} max={STEPS} value={handles[1]} aria-label={`${nameOf(name)}: most`} aria-valuetext={said(ends[1])}
          onInput={(event) => choose(handles[0], Math.max(Number(event.currentTarget.value), handles[0] + 1))} />
      </div>
      <p class="ends"><span>{said(ends[0])}</span><span>{said(ends[1])}</span></p>
    </div>
  );
}

/** Small counts stay visible: heights follow the square root. */
function heightOf(count: number, top: number): number {
  return count === 0 ? 0 : Math.max(1, Math.sqrt(count / top) * HEIGHT);
}

function stepOf(value: number, bins: Bins, open: number): number {
  if (!Number.isFinite(value)) return open;
  const place = placeOf(value, bins);
  return Number.isNaN(place) ? 0 : Math.round(Math.min(1, Math.max(0, place)) * STEPS);
}

/** A number of a column as people read it; rates as once in so many miles. */
export function textOf(column: string, value: number, unit: string): string {
  if (column === "often") return onceIn(value) || "–";
  return unit === "per billion miles" ? number(value) : quantity(value, unit);
}
