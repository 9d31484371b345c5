"use strict";
// One clock for the pictures of a case: buttons, keys and links choose a case, move its frame and play it. A paused picture
// is always a recorded frame.
//
// cases: objects with `id`, `first`, `frames`, `dt`, `crash` (a frame, or null) and what the other functions need.
// draw(item, frame, metres): draw the pictures of a frame, which lies between two recorded ones while it plays.
// chosen(item): another case was chosen. moved(item, frame): its readings at a recorded frame.
// thumbnail(item): the recording for its small picture.
function makePlayer({ cases, draw, chosen, moved, thumbnail }) {
  const $ = (id) => document.getElementById(id);
  const state = { index: 0, frame: 0, playing: false, rate: 1, view: 80, last: 0, ticket: 0 };
  const current = () => cases[state.index];
  const lastFrame = (item) => item.frames - 1;
  const crashFrame = (item) => Math.min(item.crash ?? lastFrame(item), lastFrame(item));

  function refresh() {
    const item = current();
    const whole = Math.floor(state.frame + 1e-6);
    draw(item, state.playing ? state.frame : whole, state.view);
    $("scrub").value = whole;
    $("scrub").setAttribute("aria-valuetext", `${scene.seconds(item, whole).toFixed(1)} seconds`);
    moved(item, whole);
  }

  function writeHash() {
    const frame = Math.floor(state.frame + 1e-6);
    const t = frame === crashFrame(current()) ? "crash" : scene.seconds(current(), frame).toFixed(1);
    history.replaceState(null, "", `#case=${encodeURIComponent(current().id).replaceAll("%3A", ":")}&t=${t}`);
  }

  function pause() {
    state.playing = false;
    state.frame = Math.floor(state.frame + 1e-6);
    $("play").textContent = "Play";
    refresh();
  }

  function play() {
    if (state.frame >= lastFrame(current())) state.frame = 0;
    state.playing = true;
    state.last = performance.now();
    $("play").textContent = "Pause";
    cancelAnimationFrame(state.ticket); // a case may be chosen while another plays
    state.ticket = requestAnimationFrame(tick);
  }

  function tick(now) {
    if (!state.playing) return;
    // The first picture's time is when it was begun, which may lie before the click that it answers.
    state.frame += (Math.max(0, now - state.last) / 1000 / current().dt) * state.rate;
    state.last = now;
    if (state.frame >= lastFrame(current())) {
      state.frame = lastFrame(current());
      pause();
      writeHash();
      return;
    }
    refresh();
    state.ticket = requestAnimationFrame(tick);
  }

  function seek(frame) {
    state.frame = Math.max(0, Math.min(lastFrame(current()), frame));
    pause();
    writeHash();
  }

  function select(index, frame = 0) {
    state.index = index;
    state.playing = false;
    const item = current();
    document.querySelectorAll("button.case").forEach((button) => {
      button.setAttribute("aria-pressed", String(Number(button.dataset.index) === index));
    });
    $("case-title").textContent = item.title;
    $("case-verdict").textContent = item.verdict;
    $("scrub").max = lastFrame(item);
    state.frame = Math.max(0, Math.min(lastFrame(item), frame));
    chosen(item);
    pause();
  }

  // Choose a case by its name; false if the page does not hold it.
  function selectId(id) {
    const index = cases.findIndex((item) => item.id === id);
    if (index < 0) return false;
    select(index);
    writeHash();
    $("player").scrollIntoView({ block: "nearest" });
    return true;
  }

  function readHash() {
    const wish = new URLSearchParams(location.hash.slice(1));
    const index = cases.findIndex((item) => item.id === wish.get("case"));
    if (index < 0) return false;
    const t = wish.get("t");
    const item = cases[index];
    const frame = t === "crash" ? crashFrame(item) : Math.round((Number(t) || 0) / item.dt) - item.first;
    select(index, frame);
    return true;
  }

  function onKey(event) {
    const tag = event.target.tagName;
    if (event.ctrlKey || event.metaKey || event.altKey || tag === "SELECT") return;
    if (event.key === " " && !["BUTTON", "SUMMARY", "A"].includes(tag)) state.playing ? pause() : play();
    else if (event.key === "ArrowLeft") seek(Math.ceil(state.frame) - 1);
    else if (event.key === "ArrowRight") seek(Math.floor(state.frame) + 1);
    else return;
    event.preventDefault();
  }

  function drawThumbnails() {
    document.querySelectorAll("button.case").forEach((button) => {
      const item = cases[Number(button.dataset.index)];
      scene.draw(button.querySelector("canvas"), thumbnail(item), crashFrame(item), 36, false);
    });
  }

  function listen() {
    $("play").addEventListener("click", () => (state.playing ? pause() : play()));
    $("back").addEventListener("click", () => seek(state.frame - 1));
    $("forward").addEventListener("click", () => seek(Math.floor(state.frame) + 1));
    $("to-crash").addEventListener("click", () => seek(crashFrame(current())));
    $("scrub").addEventListener("input", (event) => seek(Number(event.target.value)));
    $("rate").addEventListener("change", (event) => { state.rate = Number(event.target.value); });
    $("view").addEventListener("change", (event) => { state.view = Number(event.target.value); refresh(); });
    document.querySelectorAll("button.case").forEach((button) => {
      button.addEventListener("click", () => { select(Number(button.dataset.index)); writeHash(); play(); });
    });
    document.querySelectorAll("a.play").forEach((link) => {
      link.addEventListener("click", (event) => { event.preventDefault(); selectId(link.dataset.case); play(); });
    });
    document.addEventListener("keydown", onKey);
    window.addEventListener("hashchange", readHash);
    scene.dark.addEventListener("change", () => { refresh(); drawThumbnails(); });
    new ResizeObserver(() => { refresh(); drawThumbnails(); }).observe($("player"));
  }

  // Show the case that the address names, else this one at its crash.
  function start(index) {
    if (!readHash()) select(index, crashFrame(cases[index]));
    listen();
    drawThumbnails();
  }

  return { cases, state, current, select, selectId, seek, start };
}
