"use strict";
// Plays the stored cases, with their readings and the chart of the one that is shown.
const player = (() => {
  const cases = JSON.parse(document.getElementById("cases").textContent);
  const $ = (id) => document.getElementById(id);
  if (cases.length === 0) return null;

  const lastFrame = (item) => item.frames - 1;
  let chartFrame = -1;

  function writeReadout(item, frame) {
    const av = scene.at(item.vehicles[0], frame);
    const bv = item.partner > 0 ? scene.at(item.vehicles[item.partner], frame) : null;
    const before = item.crash === null ? null : (item.crash - frame) * item.dt;
    const k = scene.decision(item, frame);
    const cells = {
      frame: `${item.first + frame} of ${item.first + lastFrame(item)}`,
      time: scene.show(scene.seconds(item, frame), "s"),
      before: scene.show(before, "s"),
      av: scene.show(av.v, "m/s"),
      bv: scene.show(bv && bv.v, "m/s"),
      gap: scene.show(bv && Math.abs(bv.x - av.x) - (bv.length + av.length) / 2, "m"),
      ttc: item.ttc[frame] === null ? "∞" : scene.show(item.ttc[frame], "s", 2),
      plane: item.ttcPlane[frame] === null ? "∞" : scene.show(item.ttcPlane[frame], "s", 2),
      critical: k >= 0 && item.critical[k] > 0 ? `BV ${item.vehicles[item.critical[k]].slot}: ${item.action[k] || "–"}` : "–",
      p: k >= 0 && item.p_nde[k] !== null ? (item.p_nde[k] === 0 ? "impossible" : String(item.p_nde[k])) : "–",
    };
    for (const [name, value] of Object.entries(cells)) $(`read-${name}`).textContent = value;
  }

  function series(item, vehicle, key) {
    const x = vehicle[key].map((_, i) => scene.seconds(item, vehicle.from + i));
    return { x, y: vehicle[key] };
  }

  // Lowest and highest speed of the two and of the way out, at least 6 m/s apart, so that noise does not look like a manoeuvre.
  function speedRange(item) {
    const shown = [0, item.partner].filter((i) => i >= 0).map((i) => item.vehicles[i]).concat(item.wayOut ?? []);
    const pair = shown.flatMap((vehicle) => vehicle.v).filter((v) => v !== null);
    const low = Math.min(...pair), high = Math.max(...pair);
    const pad = Math.max(0.5, (6 - (high - low)) / 2);
    return [Math.max(-0.3, low - pad), high + pad];
  }

  function drawChart(item) {
    const range = [scene.seconds(item, 0), scene.seconds(item, lastFrame(item)) + 0.05 * item.frames * item.dt];
    const axis = { gridcolor: "css:grid", linecolor: "css:muted", zeroline: false };
    const data = [{ ...series(item, item.vehicles[0], "v"), name: "AV speed", line: { color: "css:av", width: 2.5 } }];
    if (item.partner > 0) {
      const partner = item.vehicles[item.partner];
      if (item.wayOut) {
        data.push({ ...series(item, item.wayOut, "v"), mode: "lines", name: "AV speed on its last way out", line: { color: "css:way-out", width: 2, dash: "dot" } });
      }
      data.push({ ...series(item, partner, "v"), name: `BV ${partner.slot} speed`, line: { color: "css:partner", width: 2.5, dash: "dash" } });
      const x = item.ttc.map((_, i) => scene.seconds(item, i));
      data.push({ x, y: item.ttc, yaxis: "y2", name: "TTC in the lane", line: { color: "css:ink", width: 2.5 } });
      data.push({ x, y: item.ttcPlane, yaxis: "y2", name: "TTC in the plane", line: { color: "css:plane", width: 2, dash: "dot" } });
    }
    const upright = { type: "line", yref: "paper", y0: 0, y1: 1 };
    const shapes = [{ ...upright, x0: range[0], x1: range[0], line: { color: "css:muted", width: 2 } }];
    const annotations = [];
    if (item.crash !== null) {
      const t = scene.seconds(item, item.crash);
      shapes.push({ ...upright, x0: t, x1: t, line: { color: "css:contact", width: 2, dash: "dot" } });
      annotations.push({ x: t, xanchor: "right", xshift: -4, y: 0.52, yanchor: "top", yref: "paper", text: "crash", showarrow: false, font: { color: "css:contact" } });
    }
    const layout = {
      height: 330, margin: { l: 64, r: 16, t: 36, b: 46 }, hovermode: "x", dragmode: false, shapes, annotations,
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: "system-ui, sans-serif", size: 13, color: "css:ink" },
      hoverlabel: { bgcolor: "css:paper", font: { color: "css:ink" } },
      legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" },
      xaxis: { ...axis, title: { text: "time since the test began [s]" }, range, anchor: "y2" },
      yaxis: { ...axis, title: { text: "speed [m/s]" }, domain: [0.52, 1], range: speedRange(item) },
      yaxis2: { ...axis, title: { text: "TTC [s]" }, domain: [0, 0.42], range: [0, 10] },
    };
    chartFrame = -1;
    charts.draw($("case-chart"), { data, layout });
  }

  function moveCursor(item, frame) {
    if (frame === chartFrame) return;
    chartFrame = frame;
    const t = scene.seconds(item, frame);
    Plotly.relayout($("case-chart"), { "shapes[0].x0": t, "shapes[0].x1": t });
  }

  const made = makePlayer({
    cases,
    draw: (item, frame, metres) => {
      scene.fitHeight($("road"), item, metres);
      scene.draw($("road"), item, frame, metres, true);
    },
    chosen: drawChart,
    moved: (item, frame) => { writeReadout(item, frame); moveCursor(item, frame); },
    thumbnail: (item) => item,
  });

  made.start(Math.max(0, cases.findIndex((item) => item.top === 1)));
  document.querySelector('[data-figure="map"]').on("plotly_click", (event) => {
    const id = event.points[0].customdata;
    $("map-note").textContent = made.selectId(id)
      ? "" : `Case ${id} is not among those on this page; play it with: cornerforge replay LIBRARY ${id}`;
  });
  $("case-chart").on("plotly_click", (event) => {
    made.seek(Math.round(event.points[0].x / made.current().dt) - made.current().first);
  });
  return made;
})();
