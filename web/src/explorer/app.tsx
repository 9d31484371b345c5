// The whole page: head, what to look at first, and three panes; on a narrow screen one pane at a time.
import { useEffect } from "preact/hooks";
import { bind } from "./binding";
import { about, failure, keyOf, refresh } from "./data";
import { FilterPane } from "./filterpane";
import { Header } from "./header";
import { Help } from "./help";
import { MapPane } from "./mappane";
import { drawing } from "./mapview";
import { closeCase, SidePane } from "./sidepane";
import { Start } from "./start";
import { watched } from "./state";
import { Banners, Status } from "./status";
import { folded, helpOpen, lassoing, listOver, startArranging, tab, type Tab } from "./ui";
import { cursor, startAsking, startWanting, step, watch } from "./views";
import { commandOf } from "./watch/keys";

export function App() {
  useEffect(() => {
    const stops: (() => void)[] = [];
    let begun = false;
    const begin = async () => {
      await refresh();
      if (begun || !about.peek()) return;
      begun = true;
      stops.push(bind(), startWanting(), startAsking(), startArranging());
    };
    // Without an answer there is nothing to tie together yet: the banner's button asks again.
    stops.push(failure.subscribe((line) => { if (line === null && !begun) void begin(); }));
    document.addEventListener("keydown", onKey);
    return () => {
      begun = true;
      stops.forEach((stop) => stop());
      document.removeEventListener("keydown", onKey);
    };
  }, []);
  useEffect(() => {
    const name = watched.value ?? about.value?.av;
    document.title = name ? `${name} – cornerforge explorer` : "cornerforge explorer";
  }, [watched.value, about.value?.av]);
  const classes = ["app", watched.value !== null && !listOver.value ? "watching" : "", folded.value ? "folded" : ""];
  return (
    <div class={classes.filter(Boolean).join(" ")} data-tab={tab.value}>
      <p class="skip">
        <button type="button" onClick={() => show("list", "list")}>To the list</button>
        <button type="button" onClick={() => show("map", "map")}>To the map</button>
        {watched.value !== null && <button type="button" onClick={() => { listOver.value = false; show("case", "case"); }}>To the case</button>}
      </p>
      <Header />
      <Banners />
      <Start />
      <Status />
      <main class="panes">
        <section class="pane filters" aria-label="Filters"><FilterPane /></section>
        <section class="pane map" aria-label="Map"><MapPane /></section>
        <section class="pane side" aria-label={watched.value !== null && !listOver.value ? "Case" : "List"}><SidePane /></section>
      </main>
      <Tabs />
      <Help />
    </div>
  );
}

const TABS: readonly { readonly name: Tab; readonly text: string }[] = [
  { name: "start", text: "Start" },
  { name: "filters", text: "Filters" },
  { name: "map", text: "Map" },
  { name: "list", text: "List" },
  { name: "case", text: "Case" },
];

function Tabs() {
  return (
    <nav class="tabs" aria-label="Panes">
      {TABS.map(({ name, text }) => (
        <button
          key={name}
          type="button"
          aria-current={tab.value === name ? "page" : undefined}
          disabled={name === "case" && watched.value === null}
          onClick={() => {
            tab.value = name;
            listOver.value = name === "list";
          }}
        >{text}</button>
      ))}
    </nav>
  );
}

const FIELDS = "input, select, textarea, [contenteditable]";

/** Keys that work wherever no field needs them and no part has taken them. */
function onKey(event: KeyboardEvent): void {
  if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
  const target = event.target as HTMLElement;
  const inField = target.matches(FIELDS) && !target.matches("input[type=checkbox], input[type=range]");
  if (event.key === "Escape") {
    // The dialog closes itself; a field gives up the focus.
    if (isDialogOpen()) return;
    if (inField) target.blur();
    else if (drawing.peek().length > 0 || lassoing.peek()) {
      drawing.value = [];
      lassoing.value = false;
    } else if (watched.peek() !== null) {
      closeCase();
      focus("list");
    }
    return;
  }
  if (inField || isDialogOpen()) return;
  // A case that is shown has keys of its own, unless another part has the focus.
  const isCase = target === document.body || target.closest(".watch") !== null;
  if (isCase && watched.peek() !== null && !listOver.peek() && commandOf(event) !== null) return;
  const isFree = target === document.body || target.matches("input[type=checkbox]");
  const act = event.key === "Enter" && isFree && cursor.peek() >= 0 ? () => watch(keyOf(cursor.peek())) : KEYS[event.key];
  if (!act) return;
  event.preventDefault();
  act();
}

/** Whether the help is open now: `helpOpen` follows a moment after the dialog has closed itself. */
function isDialogOpen(): boolean {
  return document.querySelector("dialog[open]") !== null;
}

const KEYS: Readonly<Record<string, () => void>> = {
  j: () => step(1),
  k: () => step(-1),
  "/": () => focus("search"),
  f: () => { tab.value = "filters"; focusIn(".filters summary, .filters input"); },
  c: () => show("map", "colour"),
  l: () => { lassoing.value = !lassoing.peek(); show("map", "map"); },
  "?": () => (helpOpen.value = true),
};

/** A pane, with the focus on what it is for. */
function show(pane: Tab, id: string): void {
  tab.value = pane;
  if (pane === "list") listOver.value = true;
  focus(id);
}

function focus(id: string): void {
  requestAnimationFrame(() => document.getElementById(id)?.focus());
}

function focusIn(selector: string): void {
  requestAnimationFrame(() => document.querySelector<HTMLElement>(selector)?.focus());
}
