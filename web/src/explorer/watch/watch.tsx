// Watching a case: what happened in words, the picture that moves, its values over time, and all that is known of it.
import "./watch.css";
import { useComputed, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { type About, type Fact, type Ghost, type WatchedCase, getCase, getCaseWith, getGhosts } from "../api";
import type { Case } from "../../shared/case";
import { type CaseKey, beside, camera, ghosts, opening, time } from "../state";
import { Above } from "./above";
import { Beside } from "./beside";
import { Charts } from "./charts";
import { Chase } from "./chase";
import { Facts } from "./facts-table";
import { factNumber } from "./facts";
import { GhostToggles } from "./ghosts";
import { commandOf, isTaken } from "./keys";
import { type Loaded, useLoaded } from "./loaded";
import { obey, startClock } from "./player";
import { Readout } from "./readout";
import { type Run, contactAt, opensAt, settled, shiftOf } from "./run";
import { Take } from "./take";
import { Transport } from "./transport";
import { WAY_OUT, ghostColours, resetView, runs, shades } from "./view";
import { withPartner } from "./partner";

export function Watch({ about, caseKey }: { about: About; caseKey: CaseKey }) {
  const loaded = useLoaded((signal) => getCase(caseKey, signal).then((item) => asDriven(item, caseKey, about)), caseKey);
  return (
    <article class="watch" aria-busy={loaded.state === "loading"}>
      {loaded.state === "there" && loaded.value.key === caseKey ? (
        <Watched key={caseKey} about={about} item={loaded.value} />
      ) : loaded.state === "failed" ? (
        <Failed what={`Case ${caseKey} cannot be shown.`} loaded={loaded} />
      ) : (
        <Waiting caseKey={caseKey} />
      )}
    </article>
  );
}

function Waiting({ caseKey }: { caseKey: CaseKey }) {
  return (
    <div class="waiting" role="status">
      <p class="note">Loading case {caseKey} …</p>
      <div class="road blank" />
    </div>
  );
}

function Failed({ what, loaded }: { what: string; loaded: Loaded<unknown> & { state: "failed" } }) {
  return (
    <div class="warning" role="alert">
      <p><strong>{what}</strong> {loaded.message}</p>
      <button type="button" onClick={loaded.again}>Try again</button>
    </div>
  );
}

/** In natural traffic nobody is controlled: what is recorded as such is only the nearest vehicle. */
function asDriven<T extends Case>(item: T, key: CaseKey, about: About): T {
  const source = about.sources.find(({ name }) => key.startsWith(`${name}/`));
  return source?.natural ? { ...item, critical: [], action: [], p_nde: [] } : item;
}

/** The case with its partner, beside another one if there is one. */
function Watched({ about, item }: { about: About; item: WatchedCase }) {
  const wish = beside.value;
  const isSameTest = wish?.startsWith("av:") ?? false;
  const other = useLoaded(
    async (signal) => {
      if (wish === null) return null;
      if (!isSameTest) return asDriven(await getCase(wish, signal), wish, about);
      return asDriven(await getCaseWith(item.key, wish.slice(3), signal), item.key, about);
    },
    `${item.key} ${wish}`,
  );
  const drivers = useLoaded((signal) => (about.drivers.length === 0 ? Promise.resolve({ drivers: {} }) : getGhosts(item.key, signal)), item.key);
  const root = useRef<HTMLDivElement>(null);
  const width = () => root.current?.querySelector<HTMLElement>(".road")?.clientWidth ?? 800;

  useEffect(() => {
    time.value = settled(item, opensAt(item, opening.peek()));
    opening.value = null;
    const stop = startClock();
    return () => { stop(); runs.value = []; shades.value = []; resetView(); };
  }, [item]);

  const second = other.state === "there" ? other.value : null;
  useEffect(() => {
    const a: Run = { item, mark: "A", name: wish === null ? `Case ${item.key}` : isSameTest ? about.av : `Case ${item.key}`, shift: 0 };
    if (!second || wish === null) runs.value = [a];
    else {
      const shown = isSameTest ? withPartner(second, item) : second;
      runs.value = [a, { item: shown, mark: "B", name: isSameTest ? wish.slice(3) : `Case ${wish}`, shift: shiftOf(item, shown, isSameTest) }];
    }
  }, [item, second, wish]);

  const known = drivers.state === "there" ? drivers.value.drivers : null;
  const wanted = ghosts.value;
  useEffect(() => {
    const next = shadesOf(item, known ?? {}, wanted, about.drivers);
    const before = shades.peek();
    // What is shown already is not drawn anew when more drivers arrive.
    const isSame = next.length === before.length && next.every(({ name, motion }, i) => before[i]!.name === name && before[i]!.motion === motion);
    if (!isSame) shades.value = next;
  }, [item, known, wanted]);

  const manoeuvre = manoeuvreOf(item, item.facts);
  useEffect(() => {
    const onKey = (event: KeyboardEvent) => {
      const target = event.target as HTMLElement;
      const isOurs = target === document.body || root.current?.contains(target);
      const command = commandOf(event);
      if (event.defaultPrevented || !isOurs || command === null || isTaken(target.tagName, (target as HTMLInputElement).type ?? "", event.key)) return;
      event.preventDefault();
      obey(command, manoeuvre, width());
    };
    document.addEventListener("keydown", onKey);
    return () => document.removeEventListener("keydown", onKey);
  }, [item, manoeuvre]);

  // The picture comes first; curves and facts follow when it stands.
  const isLater = useSignal(false);
  useEffect(() => {
    const ticket = setTimeout(() => { isLater.value = true; });
    return () => clearTimeout(ticket);
  }, [item]);
  const ready = useComputed(() => runs.value.length > 0);
  const sentences = ([] as string[]).concat(item.verdict);
  return (
    <div class="watched" ref={root}>
      <header>
        <h2>{item.title}</h2>
        {sentences.filter(Boolean).length > 0 && <p class="verdict">{sentences.join(" ")}</p>}
      </header>
      {ready.value && (
        <>
          {wish !== null && other.state === "failed" && <Failed what="Nothing can be shown beside it." loaded={other} />}
          {wish !== null && other.state === "loading" && <p class="note" role="status">Loading what is to be shown beside it …</p>}
          <div class="pictures">
            {runs.value.map((run) => (
              <figure key={run.mark}>
                {runs.value.length > 1 && <figcaption><b class="mark">{run.mark}</b> {run.name}{run.mark === "B" && endOf(run)}{run.mark === "B" && !isSameTest && second?.title && <span class="note">. {second.title}</span>}</figcaption>}
                {camera.value === "above" ? <Above run={run} /> : <Chase run={run} />}
              </figure>
            ))}
          </div>
          <Transport manoeuvre={manoeuvre} width={width} />
          <Readout />
          <Key isSite={item.site !== undefined} hasPeople={item.vehicles.some(({ kind }) => kind === "person")} perceives={item.vehicles.some((one) => one.seenX)} isTold={item.lineOfSight === true} hasPartner={item.partner > 0} isControlled={item.critical.some((index) => index > 0)} />
          <GhostToggles item={item} drivers={about.drivers} loaded={drivers} />
          <Beside about={about} caseKey={item.key} />
          {isLater.value && <Charts manoeuvre={manoeuvre} />}
          <p class="note">Across: time since the test began [s]; click or drag to go there. Dashed lines: the manoeuvre begins, the contact.</p>
        </>
      )}
      <Take about={about} item={item} />
      {isLater.value && <Facts facts={item.facts} columns={about.columns} />}
    </div>
  );
}

const endOf = ({ item }: Run): string => (item.crash === null ? ": does not crash" : `: contact after ${contactAt(item).toFixed(1)} s`);

/** When the manoeuvre that led to the contact began [s since the test began]; null: not known. */
function manoeuvreOf(item: WatchedCase, facts: readonly Fact[]): number | null {
  const before = factNumber(facts, "manoeuvre_begin_s");
  return before === null || item.crash === null ? null : Math.max(item.first * item.dt, contactAt(item) - before);
}

function shadesOf(item: WatchedCase, known: Readonly<Record<string, Ghost>>, wanted: ReadonlySet<string>, drivers: readonly string[]) {
  const found = drivers.filter((name) => wanted.has(name) && known[name]).map((name) => ({ name, motion: known[name]!.motion, ...ghostColours(name, drivers) }));
  const way = wanted.has(WAY_OUT) && item.wayOut ? [{ name: "way out", motion: item.wayOut, ...ghostColours(WAY_OUT, drivers) }] : [];
  return [...way, ...found];
}

function Key({ hasPartner, isControlled, perceives, isTold, isSite, hasPeople }: { hasPartner: boolean; isControlled: boolean; perceives: boolean; isTold: boolean; isSite: boolean; hasPeople: boolean }) {
  return (
    <ul class="key" aria-label="Key to the picture">
      <li><span class="box av" />AV</li>
      {hasPartner && <li><span class="box partner" />BV it crashes with</li>}
      {isControlled && <li><span class="box critical" />other BV while the adversary controls it</li>}
      <li><span class="box other" />other BVs</li>
      {hasPeople && <li><span class="box person" />people on foot</li>}
      {isSite && <li>lines across lanes and at kerbs: lights as they show green, amber and red</li>}
      <li><span class="box contact" />contact</li>
      <li><span class="box braking" />red at the rear: brakes</li>
      {camera.value === "above" ? (
        <>
          {!isSite && <li>dashed arrow: lane change</li>}
          {perceives && <li>{isTold ? "faint: a vehicle hides it from the AV" : "faint: the AV does not see it; dashed box: where it sees it"}</li>}
          <li>line behind: the last 3 s, a dot each second</li>
          <li>numbers: speed [m/s]</li>
        </>
      ) : <li>line behind: the last 3 s</li>}
    </ul>
  );
}
