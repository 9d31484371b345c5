// How much is shown, of which source, and by which filters: one line above the panes, and what went wrong.
import { about, failure, infos, n, notices, refresh } from "./data";
import type { Filter } from "./filters";
import { count } from "./format";
import { textOf } from "./histogram";
import { planesDiffer } from "./mappane";
import { filters, lasso, sql } from "./state";
import { clearAll, isFiltered, nameOf, passing, placed, setFilter, sourceLabel, sqlState, together, wordOf } from "./views";

export function Banners() {
  const now = about.value;
  return (
    <div class="banners">
      {failure.value !== null && (
        <div class="banner wrong" role="alert">
          <p>{failure.value}</p>
          <button type="button" onClick={() => void refresh()}>Try again</button>
        </div>
      )}
      {now?.work && (
        <div class="banner" role="status">
          <p>{now.work.what}: {count(now.work.done)} of {count(now.work.total)}. The map, the verdicts and what to look at first appear when it is done.</p>
          <progress max={Math.max(1, now.work.total)} value={now.work.done} aria-label={now.work.what} />
        </div>
      )}
      {[...(now?.warnings ?? []), ...notices.value].map((line) => (
        <div key={line} class="banner" role="status">
          <p>{line}</p>
          {notices.value.includes(line) && <button type="button" class="small" aria-label="Put this line away" onClick={() => (notices.value = notices.value.filter((other) => other !== line))}>✕</button>}
        </div>
      ))}
    </div>
  );
}

export function Status() {
  const sources = about.value?.sources ?? [];
  const chosen = filters.value.get("source");
  const names = chosen?.kind === "values" ? chosen.values : sources.map(({ name }) => name);
  const total = sources.length === 0 ? n.value : sources.filter(({ name }) => names.includes(name)).reduce((sum, { cases }) => sum + cases, 0);
  const choose = (some: readonly string[]) => {
    lasso.value = [];
    setFilter("source", { kind: "values", values: some });
  };
  return (
    <div class="status">
      {sources.length > 1 && (
        <div class="sources" role="group" aria-label="Cases of">
          {sources.map(({ name, cases }) => (
            <button key={name} type="button" aria-pressed={names.length === 1 && names[0] === name} onClick={() => choose([name])}>
              {sourceLabel(name)} <span class="cases">{count(cases)}</span>
            </button>
          ))}
          <button type="button" aria-pressed={names.length === sources.length} onClick={() => choose(sources.map(({ name }) => name))}>all</button>
        </div>
      )}
      <p class="counted" role="status">
        <b>{count(passing.value)}</b> of {count(total)} cases
        {together.value && <> · together {together.value}</>}
        {placed.value !== null && placed.value.missing > 0 && <> · {count(placed.value.missing)} without a place on the map</>}
        {planesDiffer() && <> · each source has a plane of its own: places of the two are not comparable</>}
      </p>
      <ul class="chips" aria-label="Filters in use">
        {[...filters.value].filter(([name]) => name !== "source").map(([name, filter]) => (
          <Chip key={name} text={`${nameOf(name)}: ${said(name, filter)}`} clear={() => setFilter(name, null)} />
        ))}
        {lasso.value.length > 0 && <Chip text="inside the lasso" clear={() => (lasso.value = [])} />}
        {sql.value !== "" && <Chip text={`${sqlState.value.state === "failed" ? "SQL, fails" : "SQL"}: ${sql.value}`} clear={() => (sql.value = "")} />}
        {isFiltered.value && <li><button type="button" class="small" onClick={clearAll}>Clear all</button></li>}
      </ul>
    </div>
  );
}

function Chip({ text, clear }: { text: string; clear: () => void }) {
  return (
    <li class="chip">
      <span title={text}>{text}</span>
      <button type="button" aria-label={`Clear: ${text}`} onClick={clear}>✕</button>
    </li>
  );
}

function said(name: string, filter: Filter): string {
  if (filter.kind === "values") return filter.values.map((value) => wordOf(name, value)).join(" or ");
  const unit = infos.value.get(name)?.unit ?? "";
  if (filter.lo === -Infinity) return `up to ${textOf(name, filter.hi, unit)}`;
  if (filter.hi === Infinity) return `from ${textOf(name, filter.lo, unit)}`;
  return `${textOf(name, filter.lo, unit)} to ${textOf(name, filter.hi, unit)}`;
}
