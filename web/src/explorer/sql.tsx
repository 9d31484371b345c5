// A condition in SQL for experts; the server answers which cases fulfil it, or says what is wrong.
import { useEffect, useState } from "preact/hooks";
import { infos } from "./data";
import { sql } from "./state";
import { sqlState, wordOf } from "./views";

export function Sql() {
  const [text, setText] = useState(sql.value);
  useEffect(() => setText(sql.value), [sql.value]);
  const { state, line } = sqlState.value;
  const unchanged = text.trim() === sql.value.trim();
  return (
    <details class="dimension sql" open={sql.value !== "" ? true : undefined}>
      <summary><span class={sql.value !== "" ? "chosen" : ""}>SQL, for experts</span></summary>
      <form
        onSubmit={(event) => {
          event.preventDefault();
          sql.value = text.trim();
        }}
      >
        <textarea
          rows={3}
          spellcheck={false}
          aria-label="Condition in SQL"
          aria-describedby="sql-says"
          placeholder="impact_speed_mps > 5 and fault = 'av'"
          value={text}
          onInput={(event) => setText(event.currentTarget.value)}
          onKeyDown={(event) => {
            if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) sql.value = text.trim();
          }}
        />
        <p class="row">
          <button type="submit" disabled={unchanged}>Apply</button>
          <button type="button" disabled={sql.value === "" && text === ""} onClick={() => { setText(""); sql.value = ""; }}>Clear</button>
        </p>
        <p id="sql-says" role="status" class={state === "failed" ? "wrong" : "quiet"}>
          {state === "asking" ? "The server looks." : state === "failed" ? line : ""}
        </p>
      </form>
      <details class="names">
        <summary>Names of columns</summary>
        <ul>
          {[...infos.value.values()].map((info) => (
            <li key={info.name}>
              <button type="button" class="link" title={`Add ${info.name} to the condition`} onClick={() => setText(`${text}${text === "" || text.endsWith(" ") ? "" : " "}${info.name} `)}>
                <code>{info.name}</code>
              </button>
              {info.unit && ` [${info.unit}]`} {info.meaning}
              {info.values && Object.keys(info.values).length <= 16 && (
                <> {Object.keys(info.values).map((value) => <code key={value} class="value-name" title={wordOf(info.name, value)}>'{value}'</code>)}</>
              )}
            </li>
          ))}
        </ul>
      </details>
    </details>
  );
}
