// The filters at the left: what there is of each kind among the cases that the other filters leave.
import { useMemo, useState } from "preact/hooks";
import { type CategoryColumn, type Column, NOT_KNOWN } from "./columns";
import { columns, infos, n } from "./data";
import { byMember, countsOf } from "./filters";
import { capital, count } from "./format";
import { Histogram } from "./histogram";
import { filters } from "./state";
import { Sql } from "./sql";
import { clearAll, fails, isFiltered, isNumeric, masks, nameOf, setFilter, shownFilters, sourceMask, toggleValue, wordOf } from "./views";

/** So many values stand there at once; the others on demand. */
const SHOWN = 7;

export function FilterPane() {
  const [added, setAdded] = useState<readonly string[]>([]);
  const shown = shownFilters.value;
  const more = added.filter((name) => !shown.some(({ column }) => column === name)).map((column) => ({ column, open: true }));
  const here = new Set([...shown, ...more].map(({ column }) => column));
  const rest = [...infos.value.values()].filter((info) => !here.has(info.name) && info.name !== "source" && info.type !== "text");
  return (
    <>
      <header class="pane-head">
        <h2>Filters</h2>
        <button type="button" disabled={!isFiltered.value} onClick={clearAll}>Clear all</button>
      </header>
      <div class="pane-body">
        {[...shown, ...more].map(({ column, open }) => <Dimension key={column} column={column} open={open} />)}
        <label class="add">
          More
          <select
            value=""
            onChange={(event) => {
              const name = event.currentTarget.value;
              if (name) setAdded([...added, name]);
              event.currentTarget.value = "";
            }}
          >
            <option value="">filter by another column</option>
            {rest.map((info) => <option key={info.name} value={info.name}>{nameOf(info.name)}</option>)}
          </select>
        </label>
        <Sql />
      </div>
    </>
  );
}

function Dimension({ column, open }: { column: string; open: boolean }) {
  const [isOpen, setOpen] = useState(open);
  const filter = filters.value.get(column);
  const info = infos.value.get(column);
  const loaded = columns.value.get(column);
  const name = capital(nameOf(column));
  const others = sourceMask.value;
  const isEmpty = useMemo(() => loaded !== undefined && saysNothing(loaded, others), [loaded, others]);
  if (!filter && isEmpty) return null;
  return (
    <details class="dimension" open={isOpen || filter !== undefined} onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary title={info?.meaning}>
        <span class={filter ? "chosen" : ""}>{name}</span>
        {filter && (
          <button type="button" class="small" aria-label={`Clear the filter on ${name}`}
            onClick={(event) => { event.preventDefault(); setFilter(column, null); }}>clear</button>
        )}
      </summary>
      {(isOpen || filter) && (loaded?.kind === "category"
        ? <Values column={column} loaded={loaded} />
        : loaded?.kind === "number" || (isNumeric(info) && loaded) ? <Histogram column={column} />
        : <p class="quiet">{n.value > 0 ? "Loading" : ""}</p>)}
    </details>
  );
}

/** Whether no case of the chosen sources has a value. */
function saysNothing(column: Column, others: Uint8Array | null): boolean {
  if (column.kind === "category") {
    const unknown = column.names.indexOf(NOT_KNOWN);
    return unknown >= 0 && column.codes.every((code, row) => code === unknown || others?.[row] === 1);
  }
  return column.kind === "number" && column.values.every((value, row) => Number.isNaN(value) || others?.[row] === 1);
}

function Values({ column, loaded }: { column: string; loaded: CategoryColumn }) {
  const [all, setAll] = useState(false);
  const own = masks.value.get(column) ?? null;
  const failing = fails.value;
  const counts = useMemo(() => byMember(loaded, countsOf(loaded, failing, own)), [loaded, failing, own]);
  const filter = filters.value.get(column);
  const chosen = new Set(filter?.kind === "values" ? filter.values : []);
  const names = [...counts.keys()].filter((name) => name !== NOT_KNOWN || counts.get(name)! > 0 || chosen.has(name));
  // A link may choose a whole list of names at once; it must be seen to be undone.
  for (const value of chosen) if (!names.includes(value)) names.push(value);
  const top = Math.max(1, ...counts.values());
  const shown = all || names.length <= SHOWN + 1 ? names : names.filter((name, place) => place < SHOWN || chosen.has(name));
  return (
    <div class="values" role="group" aria-label={nameOf(column)}>
      {shown.map((value) => {
        const cases = counts.get(value) ?? 0;
        return (
          <label key={value} class={cases === 0 ? "value none" : "value"}>
            <input type="checkbox" checked={chosen.has(value)} onChange={() => toggleValue(column, value)} />
            <span class="word">{wordOf(column, value)}</span>
            <span class="cases">{count(cases)}</span>
            <span class="bar" style={{ width: `${(100 * cases) / top}%` }} />
          </label>
        );
      })}
      {shown.length < names.length && <button type="button" class="small" onClick={() => setAll(true)}>{names.length - shown.length} more</button>}
      {all && names.length > SHOWN + 1 && <button type="button" class="small" onClick={() => setAll(false)}>fewer</button>}
    </div>
  );
}
