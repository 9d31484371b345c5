// What is shown beside the case: another AV in the same test, or another case.
import { useSignal } from "@preact/signals";
import type { About } from "../api";
import { type CaseKey, beside } from "../state";

const OTHER = "other case";

export function Beside({ about, caseKey }: { about: About; caseKey: CaseKey }) {
  const isAsking = useSignal(false);
  const text = useSignal("");
  const problem = useSignal("");
  const shown = beside.value;
  const value = isAsking.value || (shown !== null && !shown.startsWith("av:")) ? OTHER : (shown ?? "");
  const choose = (choice: string) => {
    isAsking.value = choice === OTHER;
    if (choice !== OTHER) beside.value = choice === "" ? null : choice;
  };
  const show = (event: Event) => {
    event.preventDefault();
    const name = text.value.trim();
    // A name without its source is one of the same source.
    const key = name.includes("/") ? name : `${caseKey.slice(0, caseKey.indexOf("/"))}/${name}`;
    problem.value = name === "" ? "Type the name of a case, such as 0:12." : key === caseKey ? "This is the case itself." : "";
    if (problem.value !== "") return;
    isAsking.value = false;
    beside.value = key;
  };
  return (
    <div class="beside">
      <label>beside it <select value={value} onChange={(event) => choose(event.currentTarget.value)}>
        <option value="">nothing</option>
        {about.avs.map((name) => <option key={name} value={`av:${name}`}>the same test driven by {name}</option>)}
        <option value={OTHER}>another case …</option>
      </select></label>
      {value === OTHER && (
        <form onSubmit={show}>
          <label>case <input type="text" size={22} placeholder={shown ?? "0:12"} value={text.value} onInput={(event) => { text.value = event.currentTarget.value; }} /></label>
          <button type="submit">Show</button>
          {problem.value && <span role="alert">{problem.value}</span>}
        </form>
      )}
      {shown !== null && <button type="button" onClick={() => { beside.value = null; isAsking.value = false; }}>Close</button>}
      {shown !== null && <span class="note">{shown.startsWith("av:") ? "It drives from the start of the test; the other vehicles do what they did, and drive on naturally after the recorded end. A ghost does what the AV did until it sees danger, or until the manoeuvre began." : "Both meet their contact at the same moment."}</span>}
    </div>
  );
}
