// Ties the state to the address bar, both ways.
import { batch, effect } from "@preact/signals";
import { type Place, read, write } from "./address";
import { about, infos, n, rowOf, say } from "./data";
import type { Filter } from "./filters";
import { axes, beside, camera, colour, filters, ghosts, lasso, opening, playing, show, sort, sql, time, watched } from "./state";
import { cursor, isNumeric } from "./views";
import { WAY_OUT } from "./watch/view";

/** How long after a change the address bar follows [ms]: browsers refuse more than some ten writes a second. */
const DELAY = 200;

function present(): Place {
  return {
    case: watched.value,
    // While time runs, the link keeps what it had.
    t: watched.value === null ? null : playing.value ? shownTime : (shownTime = wantedTime()),
    beside: watched.value === null ? null : beside.value,
    camera: camera.value,
    ghosts: [...ghosts.value],
    colour: colour.value,
    axes: axes.value,
    lasso: lasso.value,
    sql: sql.value,
    sort: sort.value,
    show: show.value,
    filters: filters.value,
  };
}

let shownTime: Place["t"] = null;

/** Until a case is read, the link keeps where it is to open. */
function wantedTime(): Place["t"] {
  return opening.value ?? (time.value > 0 ? time.value : null);
}

function apply(place: Place): void {
  batch(() => {
    if (place.case !== watched.peek()) {
      playing.value = false;
      opening.value = place.t;
    } else if (typeof place.t === "number" && !playing.peek()) time.value = place.t;
    watched.value = place.case;
    beside.value = place.beside;
    camera.value = place.camera;
    ghosts.value = new Set(place.ghosts);
    colour.value = place.colour;
    axes.value = place.axes;
    lasso.value = place.lasso;
    sql.value = place.sql;
    sort.value = place.sort;
    show.value = place.show;
    filters.value = place.filters;
  });
}

/** Leave out what this library does not have, with a line for each. */
function checked(place: Place): Place {
  const known = infos.peek();
  const missing = (name: string) => {
    if (known.has(name) || name === "case_id") return false;
    say(`The link names a column that is not here: ${name}`);
    return true;
  };
  const kept = new Map<string, Filter>();
  for (const [name, filter] of place.filters) {
    if (missing(name)) continue;
    if (filter.kind === "range" && !isNumeric(known.get(name))) say(`The link gives ${name} a range, but it is no number: ignored.`);
    else if (filter.kind === "values" && known.get(name)?.type === "number") say(`The link gives ${name} values, but it takes a range: ignored.`);
    else kept.set(name, filter);
  }
  const { avs, drivers } = about.peek()!;
  const shades = place.ghosts.filter((name) => name === WAY_OUT || drivers.includes(name));
  if (shades.length < place.ghosts.length) say("The link names a reference driver that is not here: ignored.");
  const isAv = place.beside?.startsWith("av:") ?? false;
  const isBeside = !isAv || avs.includes(place.beside!.slice(3));
  if (!isBeside) say(`The link names an AV that is not here: ${place.beside!.slice(3)}`);
  const numbers = place.axes?.every((name) => !missing(name) && isNumeric(known.get(name)));
  return {
    ...place,
    ghosts: shades,
    beside: isBeside ? place.beside : null,
    axes: numbers ? place.axes : null,
    lasso: place.axes && !numbers ? [] : place.lasso,
    colour: place.colour !== null && missing(place.colour) ? null : place.colour,
    sort: place.sort && missing(place.sort.column) ? null : place.sort,
    show: place.show?.filter((name) => !missing(name)) ?? null,
    filters: withSource(kept, place.case),
  };
}

/** Where there are several sources, one is chosen: that of the link's case, else the first. Their planes differ. */
function withSource(given: ReadonlyMap<string, Filter>, key: string | null): ReadonlyMap<string, Filter> {
  const sources = about.peek()?.sources.filter((source) => source.cases > 0) ?? [];
  if (sources.length < 2 || given.has("source")) return given;
  const named = sources.find((source) => key?.startsWith(`${source.name}/`));
  return new Map([...given, ["source", { kind: "values", values: [(named ?? sources[0]!).name] }]]);
}

/** Read the address bar now (what the library has must be known), then follow it and write to it. */
export function bind(): () => void {
  let written = "";
  let writtenCase: string | null = null;
  let timer = 0;
  const readNow = () => {
    written = location.hash.replace(/^#/, "");
    const { place, problems } = read(written);
    problems.forEach(say);
    // What was read is no new step of the history.
    writtenCase = place.case;
    apply(checked(place));
  };
  readNow();
  const follow = () => {
    if (location.hash.replace(/^#/, "") !== written) readNow();
  };
  const put = () => {
    const hash = write(present());
    const isNew = watched.peek() !== writtenCase;
    if (hash === written && !isNew) return;
    written = hash;
    const url = hash === "" ? `${location.pathname}${location.search}` : `#${hash}`;
    // A case that was chosen is a step that Back undoes; all else is the same step.
    if (isNew) history.pushState(null, "", url);
    else history.replaceState(null, "", url);
    // The browser may write some characters in another way.
    written = location.hash.replace(/^#/, "");
    writtenCase = watched.peek();
  };
  const stop = effect(() => {
    present();
    clearTimeout(timer);
    if (watched.value !== writtenCase) put();
    else timer = setTimeout(put, DELAY);
  });
  window.addEventListener("hashchange", follow);
  window.addEventListener("popstate", follow);
  const stopChecking = effect(() => {
    const key = watched.value;
    if (key === null || n.value === 0) return;
    const row = rowOf(key);
    if (row >= 0) {
      cursor.value = row;
      return;
    }
    say(`The link names a case that is not here: ${key}`);
    watched.value = null;
  });
  return () => {
    stop();
    stopChecking();
    clearTimeout(timer);
    window.removeEventListener("hashchange", follow);
    window.removeEventListener("popstate", follow);
  };
}
