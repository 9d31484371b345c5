// All that is known of the case, by question.
import type { ColumnInfo, Fact } from "../api";
import { type FactRow, factGroups } from "./facts";

export function Facts({ facts, columns }: { facts: readonly Fact[]; columns: readonly ColumnInfo[] }) {
  return (
    <section class="facts" aria-label="Facts of this case">
      {factGroups(facts, columns).map(({ title, rows, more }) => (
        <div key={title}>
          <h3>{title}</h3>
          <Rows rows={rows} />
          {more.length > 0 && (rows.length > 0 ? <details><summary>{more.length} more</summary><Rows rows={more} /></details> : <details><summary>{more.length} values</summary><Rows rows={more} /></details>)}
        </div>
      ))}
    </section>
  );
}

function Rows({ rows }: { rows: readonly FactRow[] }) {
  if (rows.length === 0) return null;
  return (
    <table>
      <tbody>
        {rows.map(({ name, label, value, meaning }) => (
          <tr key={name} title={meaning}><th scope="row">{label}</th><td>{value}</td></tr>
        ))}
      </tbody>
    </table>
  );
}
