// A note that two pages changed: nothing that anybody wrote is lost.
import type { Note } from "./api";

export const EMPTY: Note = { labels: [], note: "" };

/** What is to be kept, when this page changed `base` to `mine` and the file holds `theirs` by now. */
export function merged(base: Note, mine: Note, theirs: Note): Note {
  const added = mine.labels.filter((name) => !base.labels.includes(name) && !theirs.labels.includes(name));
  const removed = base.labels.filter((name) => !mine.labels.includes(name));
  const labels = [...theirs.labels.filter((name) => !removed.includes(name)), ...added];
  if (mine.note === base.note || mine.note === theirs.note) return { labels, note: theirs.note };
  if (theirs.note === base.note) return { labels, note: mine.note };
  return { labels, note: [theirs.note, mine.note].filter((text) => text !== "").join("\n\n") };
}

export function sameNote(one: Note, other: Note): boolean {
  return one.note === other.note && one.labels.length === other.labels.length && one.labels.every((name, k) => name === other.labels[k]);
}
