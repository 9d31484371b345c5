// All cases that pass as a table, of which only the visible rows exist.
import { useEffect, useRef, useState } from "preact/hooks";
import type { Column } from "./columns";
import { columns, infos, keyOf, n } from "./data";
import { capital, count, shortName } from "./format";
import { textOf } from "./histogram";
import { contentHeight, offsetOf, scrollTo, windowAt } from "./rows";
import { show, sort, watched } from "./state";
import { clearAll, cursor, isFiltered, listColumns, nameOf, rows, putBeside, sorting, step, watch, wordOf } from "./views";

/** Heights of a row and of the head [px]; the style sheet has the same. */
const ROW = 30;
const HEAD = 34;

export function List() {
  const scroller = useRef<HTMLDivElement>(null);
  const [scroll, setScroll] = useState(0);
  const [height, setHeight] = useState(400);
  useEffect(() => {
    const box = scroller.current!;
    const seen = new ResizeObserver(() => setHeight(box.clientHeight));
    seen.observe(box);
    return () => seen.disconnect();
  }, []);
  const all = rows.value;
  const at = cursor.value < 0 ? -1 : all.indexOf(cursor.value);
  const viewport = Math.max(ROW, height - HEAD);
  // The list follows the cursor, also where the map moved it.
  useEffect(() => {
    const box = scroller.current!;
    if (at >= 0 && box.clientHeight > 0) box.scrollTop = scrollTo(at, box.scrollTop, box.clientHeight - HEAD, ROW, all.length);
  }, [cursor.value, all, watched.value]);

  const names = listColumns.value;
  const { from, to } = windowAt(scroll, viewport, ROW, all.length);
  const shift = scroll - offsetOf(scroll, viewport, ROW, all.length);
  const widths = names.map((name) => widthOf(name, columns.value.get(name)));
  const template = widths.map((width) => `minmax(${width}px, ${width}fr)`).join(" ");
  const minWidth = `${widths.reduce((sum, width) => sum + width, 0)}px`;
  const drawn = [];
  for (let place = from; place < to; place++) drawn.push(place);

  const onKeyDown = (event: KeyboardEvent) => {
    const page = Math.max(1, Math.floor(viewport / ROW) - 1);
    const by: Record<string, number> = { ArrowDown: 1, ArrowUp: -1, PageDown: page, PageUp: -page, Home: -all.length, End: all.length };
    if (event.target !== scroller.current) return;
    if (event.key in by) {
      event.preventDefault();
      step(by[event.key]!, false);
    } else if (event.key === "Enter" && cursor.value >= 0) {
      event.preventDefault();
      if (event.shiftKey) putBeside(keyOf(cursor.value));
      else watch(keyOf(cursor.value));
    }
  };

  return (
    <>
      <header class="pane-head">
        <h2>{count(all.length)} {all.length === 1 ? "case" : "cases"}</h2>
        <Chooser />
      </header>
      <div
        class="list"
        id="list"
        ref={scroller}
        role="grid"
        tabIndex={0}
        aria-label="Cases that pass the filters"
        aria-rowcount={all.length + 1}
        aria-colcount={names.length}
        aria-activedescendant={at >= from && at < to ? `row-${cursor.value}` : undefined}
        onScroll={(event) => setScroll(event.currentTarget.scrollTop)}
        onKeyDown={onKeyDown}
      >
        <div class="list-head" role="row" style={{ gridTemplateColumns: template, minWidth }}>
          {names.map((name) => <Head key={name} name={name} />)}
        </div>
        {all.length === 0 && n.value > 0 && (
          <div class="empty">
            <p>No case passes the filters.</p>
            {isFiltered.value && <button type="button" onClick={clearAll}>Clear all filters</button>}
          </div>
        )}
        <div class="list-body" role="rowgroup" style={{ height: `${contentHeight(ROW, all.length)}px`, minWidth }}>
          {drawn.map((place) => {
            const row = all[place]!;
            const key = keyOf(row);
            return (
              <div
                key={row}
                id={`row-${row}`}
                role="row"
                aria-rowindex={place + 2}
                aria-selected={row === cursor.value}
                class={key === watched.value ? "list-row watched" : row === cursor.value ? "list-row cursor" : "list-row"}
                style={{ gridTemplateColumns: template, transform: `translateY(${place * ROW + shift}px)` }}
                onClick={(event) => (event.shiftKey ? putBeside(key) : watch(key))}
              >
                {names.map((name) => <Cell key={name} name={name} row={row} />)}
              </div>
            );
          })}
        </div>
      </div>
    </>
  );
}

function Head({ name }: { name: string }) {
  const { column, descending } = sorting.value;
  const info = infos.value.get(name);
  const sorted = column === name;
  const unit = name === "often" || !info?.unit ? "" : info.unit === "rad" ? "°" : info.unit;
  return (
    <div role="columnheader" aria-sort={sorted ? (descending ? "descending" : "ascending") : "none"} class={isRight(name) ? "right" : ""}>
      <button
        type="button"
        title={info?.meaning ?? "Sort by the name of the case"}
        onClick={() => (sort.value = { column: name, descending: sorted ? !descending : isRight(name) })}
      >
        <span class="name">{name === "often" ? "Once in" : capital(nameOf(name))}{unit && <small> {unit}</small>}</span>
        <span class="arrow" aria-hidden="true">{sorted ? (descending ? "▼" : "▲") : ""}</span>
      </button>
    </div>
  );
}

function Cell({ name, row }: { name: string; row: number }) {
  const text = cellOf(name, columns.value.get(name), row);
  return <div role="gridcell" class={isRight(name) ? "right" : ""} title={name === "case_id" ? keyOf(row) : text.length > 14 ? text : undefined}>{text}</div>;
}

/** A value as the list shows it; the unit stands in the head. */
export function cellOf(name: string, column: Column | undefined, row: number): string {
  if (!column) return "";
  if (column.kind === "text") return name === "case_id" ? shortName(column.values[row] ?? "") : (column.values[row] ?? "");
  if (column.kind === "category") return wordOf(name, column.names[column.codes[row]!]!);
  const text = textOf(name, column.values[row]!, column.info.unit === "rad" ? "rad" : "");
  return name === "often" ? text.replace("once in ", "") : text;
}

function isRight(name: string): boolean {
  const type = infos.value.get(name)?.type;
  return type === "number" || type === "integer";
}

/** Width of a column [px], at least; what is left over is shared in proportion. */
function widthOf(name: string, column: Column | undefined): number {
  if (name === "often") return 134;
  if (name === "case_id") return 92;
  return column?.kind === "category" && !column.values ? 130 : 84;
}

/** Which columns the list shows. */
function Chooser() {
  const names = listColumns.value;
  const choices = ["case_id", ...[...infos.value.keys()].filter((name) => name !== "case_id")];
  const toggle = (name: string) => {
    const next = names.includes(name) ? names.filter((other) => other !== name) : [...names, name];
    if (next.length > 0) show.value = next;
  };
  return (
    <details class="menu" onKeyDown={(event) => { if (event.key === "Escape") event.currentTarget.open = false; }}>
      <summary>Columns</summary>
      <div class="menu-body" role="group" aria-label="Columns of the list">
        <button type="button" class="small" onClick={() => (show.value = null)}>The usual ones</button>
        {choices.map((name) => (
          <label key={name} title={infos.value.get(name)?.meaning}>
            <input type="checkbox" checked={names.includes(name)} onChange={() => toggle(name)} />
            {nameOf(name)}
          </label>
        ))}
      </div>
    </details>
  );
}
