// All that is known of the case, by question.
import { useSignal } from "@preact/signals";
import type { ColumnInfo, Fact } from "../api";
import { type FactRow, factGroups } from "./facts";

export function Facts({ facts, columns }: { facts: readonly Fact[]; columns: readonly ColumnInfo[] }) {
  const isExplained = useSignal(false);
  return (
    <section class="facts" aria-label="Facts of this case">
      <label class="explain"><input type="checkbox" checked={isExplained.value} onChange={() => { isExplained.value = !isExplained.value; }} /> say what each value means</label>
      <div class="groups">
        {factGroups(facts, columns).map(({ title, rows, more }) => (
          <div key={title}>
            <h3>{title}</h3>
            <Rows rows={rows} isExplained={isExplained.value} />
            {more.length > 0 && (
              <details><summary>{more.length} {rows.length > 0 ? "more" : "values"}</summary><Rows rows={more} isExplained={isExplained.value} /></details>
            )}
          </div>
        ))}
      </div>
    </section>
  );
}

function Rows({ rows, isExplained }: { rows: readonly FactRow[]; isExplained: boolean }) {
  if (rows.length === 0) return null;
  return (
    <table>
      <tbody>
        {rows.map(({ name, label, value, meaning }) => (
          <tr key={name} title={isExplained ? undefined : meaning}>
            <th scope="row">{label}{isExplained && <span class="meaning">{meaning}</span>}</th><td>{value}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
