// Labels and a note on the watched case, saved as one types.
import { computed } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";
import type { Note } from "./api";
import { notes, saveNote, saving } from "./data";
import type { CaseKey } from "./state";

/** How long after the last key the note is saved [ms]. */
const DELAY = 600;
const LONGEST_LABEL = 40;
const LONGEST_NOTE = 10_000;

const allLabels = computed(() => [...new Set(Object.values(notes.value).flatMap(({ labels }) => labels))].sort());

export function Notes({ caseKey }: { caseKey: CaseKey }) {
  const [note, setNote] = useState<Note>(notes.value[caseKey] ?? { labels: [], note: "" });
  const [label, setLabel] = useState("");
  const timer = useRef(0);
  const waiting = useRef<Note | null>(null);

  const save = (leaving = false) => {
    clearTimeout(timer.current);
    const now = waiting.current;
    waiting.current = null;
    if (now) void saveNote(caseKey, now, leaving);
  };
  // What is typed is saved too when the case or the page is left.
  useEffect(() => {
    const leave = () => save(true);
    window.addEventListener("pagehide", leave);
    return () => {
      window.removeEventListener("pagehide", leave);
      save();
    };
  }, [caseKey]);
  // Notes that come from the server after the pane was drawn.
  const known = notes.value[caseKey];
  useEffect(() => {
    if (waiting.current === null && known) setNote(known);
  }, [known]);

  const change = (next: Note, delay: number) => {
    setNote(next);
    waiting.current = next;
    clearTimeout(timer.current);
    timer.current = setTimeout(() => save(), delay);
  };
  const add = () => {
    const name = label.replace(/[|,]/g, " ").trim().slice(0, LONGEST_LABEL);
    setLabel("");
    if (name !== "" && !note.labels.includes(name)) change({ ...note, labels: [...note.labels, name] }, 0);
  };
  const state = saving.value?.key === caseKey ? saving.value : null;
  return (
    <section class="notes" aria-label="Notes on this case">
      <h3>Labels and notes</h3>
      <form class="row" onSubmit={(event) => { event.preventDefault(); add(); }}>
        {note.labels.map((name) => (
          <span key={name} class="chip">
            <span>{name}</span>
            <button type="button" aria-label={`Remove the label ${name}`} onClick={() => change({ ...note, labels: note.labels.filter((other) => other !== name) }, 0)}>✕</button>
          </span>
        ))}
        <input
          type="text"
          list="labels"
          maxLength={LONGEST_LABEL}
          placeholder="add a label"
          aria-label="Add a label"
          value={label}
          onInput={(event) => setLabel(event.currentTarget.value)}
          onBlur={add}
        />
        <datalist id="labels">{allLabels.value.map((name) => <option key={name} value={name} />)}</datalist>
      </form>
      <textarea
        rows={3}
        maxLength={LONGEST_NOTE}
        placeholder="Write what you see"
        aria-label="Note"
        value={note.note}
        onInput={(event) => change({ ...note, note: event.currentTarget.value }, DELAY)}
        onBlur={() => save()}
      />
      <p class={state?.state === "failed" ? "wrong" : "quiet"} role="status">
        {state?.state === "saving" && "Saving"}
        {state?.state === "saved" && "Saved beside the library"}
        {state?.state === "failed" && <>Not saved: {state.line} <button type="button" class="small" onClick={() => void saveNote(caseKey, note)}>Try again</button></>}
      </p>
    </section>
  );
}
