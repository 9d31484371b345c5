// The keys of watching, for the help and for the handler alike.

export type Command =
  | "play" | "back" | "on" | "back-second" | "on-second" | "begin" | "end" | "slower" | "faster"
  | "manoeuvre" | "contact" | "loop" | "view" | "in" | "out" | "reset" | "trails" | "way-out";

interface Key {
  /** As the help writes it. */
  readonly keys: string;
  readonly what: string;
}

const TABLE: readonly (Key & { readonly on: readonly string[]; readonly command: Command })[] = [
  { keys: "Space", what: "play, pause", on: [" "], command: "play" },
  { keys: "←", what: "0.1 s back", on: ["ArrowLeft"], command: "back" },
  { keys: "→", what: "0.1 s on", on: ["ArrowRight"], command: "on" },
  { keys: "Shift ←", what: "1 s back", on: ["Shift ArrowLeft"], command: "back-second" },
  { keys: "Shift →", what: "1 s on", on: ["Shift ArrowRight"], command: "on-second" },
  { keys: "Home", what: "to the begin", on: ["Home"], command: "begin" },
  { keys: "End", what: "to the end", on: ["End"], command: "end" },
  { keys: "m", what: "to the begin of the manoeuvre", on: ["m"], command: "manoeuvre" },
  { keys: "x", what: "to the crash", on: ["x"], command: "contact" },
  { keys: "[", what: "slower", on: ["["], command: "slower" },
  { keys: "]", what: "faster", on: ["]"], command: "faster" },
  { keys: "o", what: "over and over: off, all, the last 5 s", on: ["o"], command: "loop" },
  { keys: "v", what: "from above, or 3-D", on: ["v"], command: "view" },
  { keys: "+", what: "nearer", on: ["+", "="], command: "in" },
  { keys: "−", what: "farther", on: ["-", "_"], command: "out" },
  { keys: "0", what: "the view as it was first", on: ["0"], command: "reset" },
  { keys: "t", what: "trails", on: ["t"], command: "trails" },
  { keys: "g", what: "the AV's last way out", on: ["g"], command: "way-out" },
];

/** The keys of watching a case, for the help. */
export const KEYS: readonly Key[] = TABLE.map(({ keys, what }) => ({ keys, what }));

interface Pressed {
  readonly key: string;
  readonly shiftKey: boolean;
  readonly ctrlKey: boolean;
  readonly metaKey: boolean;
  readonly altKey: boolean;
}

/** What a key asks for; null: nothing here. */
export function commandOf(pressed: Pressed): Command | null {
  if (pressed.ctrlKey || pressed.metaKey || pressed.altKey) return null;
  const name = pressed.shiftKey && pressed.key.length > 1 ? `Shift ${pressed.key}` : pressed.key;
  return TABLE.find(({ on }) => on.includes(name))?.command ?? null;
}

const FIELDS = new Set(["INPUT", "SELECT", "TEXTAREA"]);
const BUTTONS = new Set(["BUTTON", "SUMMARY", "A"]);

/** Whether an element needs a key itself: fields need all, but for a slider's; what is clicked needs the space bar. */
export function isTaken(tag: string, type: string, key: string): boolean {
  if (tag === "INPUT" && type === "range") return false;
  if (tag === "INPUT" && type === "checkbox") return key === " ";
  return FIELDS.has(tag) || (BUTTONS.has(tag) && key === " ");
}
