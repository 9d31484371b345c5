// What to look at first: few cases that matter most, each with a button that plays it.
import { useEffect, useRef, useState } from "preact/hooks";
import { getCase, type StartCard, type WatchedCase } from "./api";
import { about } from "./data";
import { type Filter } from "./filters";
import { readFilter } from "./address";
import { capital } from "./format";
import { readColours } from "../shared/colours";
import { crashFrame } from "../shared/motion";
import { drawScene } from "../shared/scene";
import { filters, lasso, sql } from "./state";
import { dark } from "./theme";
import { folded } from "./ui";
import { watch } from "./views";

export function Start() {
  const cards = about.value?.start ?? [];
  if (cards.length === 0) return null;
  return (
    <section class={folded.value ? "start folded" : "start"} aria-label="What to look at first">
      <header>
        <h2>What to look at first</h2>
        <button type="button" class="small wide-only" aria-expanded={!folded.value} onClick={() => (folded.value = true)}>Fold away</button>
      </header>
      <ol class="cards">{cards.map((card, place) => <Card key={card.case} card={card} first={place === 0} />)}</ol>
    </section>
  );
}

function Card({ card, first }: { card: StartCard; first: boolean }) {
  // The rate has a line of its own.
  const text = card.often ? card.text.replace(` It happens ${card.often}.`, "") : card.text;
  const [much, interval] = card.often.split(" (");
  return (
    <li class={first ? "card first" : "card"}>
      <Thumbnail of={card.case} />
      <div class="told">
        <h3>{card.title}</h3>
        {card.often && <p class="often">{capital(much!)}{interval && <small> ({interval}</small>}</p>}
        <p class="text" title={text}>{text}</p>
        <button type="button" class={first ? "play primary" : "play"} aria-label={`Play: ${card.title}`} onClick={() => play(card)}>▶ Play</button>
      </div>
    </li>
  );
}

function play(card: StartCard): void {
  const chosen = new Map<string, Filter>();
  for (const [name, text] of Object.entries(card.filters)) {
    const filter = readFilter(text);
    if (filter) chosen.set(name.replace(/^f\./, ""), filter);
  }
  const source = filters.peek().get("source");
  if (source && !chosen.has("source")) chosen.set("source", source);
  filters.value = chosen;
  lasso.value = [];
  sql.value = "";
  watch(card.case, true);
}

/** The moment of the contact, small. */
function Thumbnail({ of }: { of: string }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const [item, setItem] = useState<WatchedCase | null>(null);
  useEffect(() => {
    const ending = new AbortController();
    getCase(of, ending.signal).then(setItem, () => undefined);
    return () => ending.abort();
  }, [of, about.value?.revision]);
  useEffect(() => {
    const box = canvas.current;
    if (!box || !item) return;
    const draw = () => {
      if (box.clientWidth > 0) drawScene(box, item, crashFrame(item), { metres: Math.max(30, box.clientWidth / 4), detail: false, trail: 2 }, readColours());
    };
    const seen = new ResizeObserver(draw);
    seen.observe(box);
    draw();
    return () => seen.disconnect();
  }, [item, dark.value, folded.value]);
  return <canvas class="thumbnail" ref={canvas} role="img" aria-label={`Case ${of} at the contact, from above`} />;
}
