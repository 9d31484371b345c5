"use strict";
// Plays a case as both versions drive it, on one clock: a version whose test is over stands still while the other drives on.
const player = (() => {
  const cases = JSON.parse(document.getElementById("cases").textContent);
  const $ = (id) => document.getElementById(id);
  if (cases.length === 0) return null;

  const SIDES = ["old", "new"];
  const held = (recording, frame) => Math.min(frame, recording.frames - 1);

  function write(side, item, frame) {
    const recording = item[side];
    const now = recording && held(recording, frame);
    const av = recording && scene.at(recording.vehicles[0], now);
    const partner = recording && recording.partner > 0 ? recording.vehicles[recording.partner] : null;
    const bv = partner && scene.at(partner, now);
    const touches = recording && recording.crash !== null && now >= recording.crash;
    const over = recording && frame > recording.frames - 1;
    const cells = {
      end: item.ends[side],
      av: av ? scene.show(av.v, "m/s") : "–",
      bv: bv ? scene.show(bv.v, "m/s") : "–",
      gap: bv ? scene.show(Math.abs(bv.x - av.x) - (bv.length + av.length) / 2, "m") : "–",
      state: touches ? "contact" : over ? "over" : recording ? "driving" : "–",
    };
    for (const [name, value] of Object.entries(cells)) $(`${side}-${name}`).textContent = value;
    $(`${side}-state`).classList.toggle("touches", Boolean(touches));
  }

  const made = makePlayer({
    cases,
    draw: (item, frame, metres) => {
      for (const side of SIDES) {
        const canvas = $(`road-${side}`);
        canvas.hidden = !item[side];
        if (!item[side]) continue;
        scene.fitHeight(canvas, item[side], metres);
        scene.draw(canvas, item[side], held(item[side], frame), metres, true);
      }
    },
    chosen: () => {},
    moved: (item, frame) => {
      SIDES.forEach((side) => write(side, item, frame));
      $("clock").textContent = scene.show(scene.seconds(item, frame), "s");
    },
    thumbnail: (item) => (item.new.crash === null && item.old ? item.old : item.new),
  });
  made.start(0);
  return made;
})();
