// The page's head: which AV, what was found in one sentence, a box to find a case by its name.
import { useState } from "preact/hooks";
import { about, columns, keyOf, n, rowOf, say } from "./data";
import { dark, toggleTheme } from "./theme";
import { folded, helpOpen } from "./ui";
import { watch } from "./views";

const MOST = 8;

export function Header() {
  const { value } = about;
  return (
    <header class="top">
      <div class="who">
        <h1>{value ? value.av || value.name : "cornerforge"}</h1>
        <p class="headline" title={value?.headline}>{value?.headline}</p>
      </div>
      {value && value.start.length > 0 && folded.value && (
        <button type="button" class="wide-only" aria-expanded={false} onClick={() => (folded.value = false)}>What to look at first</button>
      )}
      <Search />
      <button type="button" class="round" aria-label={dark.value ? "Light page" : "Dark page"} title={dark.value ? "Light page" : "Dark page"} onClick={toggleTheme}>
        <svg viewBox="0 0 20 20" aria-hidden="true"><path d="M10 2a8 8 0 1 0 0 16z" fill="currentColor" /><circle cx="10" cy="10" r="7.2" fill="none" stroke="currentColor" stroke-width="1.6" /></svg>
      </button>
      <button type="button" class="round" aria-label="Help" title="Help (?)" onClick={() => (helpOpen.value = true)}>?</button>
    </header>
  );
}

/** Rows whose key or name holds a text; the exact one first. */
function find(text: string): number[] {
  const wanted = text.trim().toLowerCase();
  if (wanted === "") return [];
  const found: number[] = [];
  const ids = columns.value.get("case_id");
  if (ids?.kind !== "text") return [];
  for (let row = 0; row < n.value; row++) {
    const id = ids.values[row]!.toLowerCase();
    if (id === wanted) found.unshift(row);
    else if (found.length < MOST && id.includes(wanted)) found.push(row);
  }
  return found.slice(0, MOST);
}

function Search() {
  const [text, setText] = useState("");
  const exact = rowOf(text.trim());
  const found = text.includes("/") ? (exact >= 0 ? [exact] : []) : find(text);
  const go = () => {
    if (text.trim() === "") return;
    if (found.length === 0) say(`No case is called ${text.trim()}.`);
    else {
      watch(keyOf(found[0]!));
      setText("");
    }
  };
  return (
    <form class="search" role="search" onSubmit={(event) => { event.preventDefault(); go(); }}>
      <input
        id="search"
        type="search"
        list="found"
        autocomplete="off"
        spellcheck={false}
        placeholder="Find a case"
        aria-label="Find a case by its name"
        value={text}
        onInput={(event) => {
          const now = event.currentTarget.value;
          setText(now);
          // A choice from the suggestions is a whole key.
          if (now.includes("/") && rowOf(now) >= 0) {
            watch(now);
            setText("");
          }
        }}
      />
      <datalist id="found">{found.map((row) => <option key={row} value={keyOf(row)} />)}</datalist>
    </form>
  );
}
