// What the colours of the map mean; each entry is a filter too.
import { useMemo } from "preact/hooks";
import { columns } from "./data";
import { countsOf } from "./filters";
import { count } from "./format";
import { Histogram } from "./histogram";
import { categoryStyles, cssOf, ramp } from "./scales";
import { filters } from "./state";
import { Swatch } from "./swatch";
import { dark } from "./theme";
import { lit } from "./ui";
import { colourColumn, fails, masks, nameOf, onlyValue, wordOf } from "./views";

export function Legend() {
  const name = colourColumn.value;
  const column = name === null ? undefined : columns.value.get(name);
  const failing = fails.value;
  const own = (name !== null && masks.value.get(name)) || null;
  const counts = useMemo(() => (column?.kind === "category" ? countsOf(column, failing, own) : null), [column, failing, own]);
  if (name === null || !column || column.kind === "text") return <div class="legend" />;
  if (column.kind === "number") {
    return (
      <div class="legend numbers" aria-label={`Colours: ${nameOf(name)}`} role="group">
        <Histogram column={name} colourAt={(place) => cssOf(ramp(place, dark.value))} />
      </div>
    );
  }
  const filter = filters.value.get(name);
  const chosen = filter?.kind === "values" ? new Set(filter.values) : null;
  const styles = categoryStyles(column.names, dark.value);
  return (
    <ul class="legend" aria-label={`Colours: ${nameOf(name)}`}>
      {column.names.map((value, code) => {
        const isOff = chosen !== null && !chosen.has(value) && !column.members[code]!.some((member) => chosen.has(member));
        return (
          <li key={value}>
            <button
              type="button"
              class={isOff ? "entry off" : "entry"}
              aria-pressed={chosen?.size === 1 && chosen.has(value)}
              title={chosen?.size === 1 && chosen.has(value) ? "Show all again" : "Show only these"}
              onClick={() => onlyValue(name, value)}
              onPointerEnter={() => (lit.value = code)}
              onPointerLeave={() => (lit.value = -1)}
              onFocus={() => (lit.value = code)}
              onBlur={() => (lit.value = -1)}
            >
              <Swatch style={styles[code]!} />
              {wordOf(name, value)} <span class="cases">{count(counts?.[code] ?? 0)}</span>
            </button>
          </li>
        );
      })}
    </ul>
  );
}
