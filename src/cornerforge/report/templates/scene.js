"use strict";
// Draws a recorded moment from above, to scale in metres. Frames are 0.1 s apart; between two the picture is interpolated.
const scene = (() => {
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const seconds = (item, frame) => (item.first + frame) * item.dt;

  const colours = {};
  function readColours() {
    for (const name of ["av", "partner", "critical", "other", "road", "verge", "paint", "ink", "muted", "contact", "paper", "way-out-box"]) {
      colours[name] = css(name);
    }
  }

  // ---- data ------------------------------------------------------------------------------------------------------------
  // State of a vehicle at a frame, between two frames by straight lines; null where it was not recorded.
  function at(vehicle, frame) {
    const local = frame - vehicle.from;
    const low = Math.floor(local);
    const part = local - low;
    const high = part > 0 ? low + 1 : low;
    if (low < 0 || high >= vehicle.x.length || vehicle.x[low] === null || vehicle.x[high] === null) return null;
    const mix = (values) => values[low] * (1 - part) + values[high] * part;
    const [x, y, v, h] = ["x", "y", "v", "h"].map((key) => mix(vehicle[key]));
    return { x, y, v, h, lane: vehicle.lane[low], kind: vehicle.kind, length: vehicle.length, width: vehicle.width };
  }

  const decision = (item, frame) => Math.min(Math.floor((item.first + frame + 1e-6) / 10), item.critical.length - 1);

  function criticalVehicle(item, frame) {
    const k = decision(item, frame);
    return k < 0 ? -1 : item.critical[k];
  }

  function corners(box) {
    const c = Math.cos(box.h), s = Math.sin(box.h);
    const along = box.length / 2, across = box.width / 2;
    return [[along, across], [-along, across], [-along, -across], [along, -across]].map(
      ([a, b]) => [box.x + a * c - b * s, box.y + a * s + b * c]);
  }

  // Common area of two convex polygons given counter-clockwise (Sutherland and Hodgman's clipping).
  function commonArea(subject, clip) {
    let result = subject;
    clip.forEach((p, i) => {
      const q = clip[(i + 1) % clip.length];
      const side = ([x, y]) => (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]);
      const input = result;
      result = [];
      input.forEach((b, j) => {
        const a = input[(j + input.length - 1) % input.length];
        const sa = side(a), sb = side(b);
        if ((sa >= 0) !== (sb >= 0)) {
          const t = sa / (sa - sb);
          result.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
        }
        if (sb >= 0) result.push(b);
      });
    });
    return result;
  }

  // ---- picture ---------------------------------------------------------------------------------------------------------
  function prepare(canvas) {
    const pixels = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = Math.round(width * pixels);
    canvas.height = Math.round(height * pixels);
    const context = canvas.getContext("2d");
    context.setTransform(pixels, 0, 0, pixels, 0, 0);
    return { context, width, height };
  }

  // Map of metres to pixels: x to the right, y to the left of the driver, so upwards.
  function makeView(item, frame, width, height, metres) {
    const av = at(item.vehicles[0], frame);
    const scale = Math.min(width / metres, (height - 4) / (item.lanes * item.laneWidth + 0.6));
    const middle = (item.lanes * item.laneWidth) / 2;
    return {
      scale, width, height, left: av.x - width / 2 / scale, right: av.x + width / 2 / scale,
      px: (x) => (x - av.x) * scale + width / 2,
      py: (y) => height / 2 - (y - middle) * scale,
    };
  }

  function drawRoad(g, view, item, detail) {
    const top = view.py(item.lanes * item.laneWidth), bottom = view.py(0);
    g.fillStyle = colours.verge;
    g.fillRect(0, 0, view.width, view.height);
    g.fillStyle = colours.road;
    g.fillRect(0, top - 0.3 * view.scale, view.width, bottom - top + 0.6 * view.scale);
    g.fillStyle = colours.paint;
    const line = Math.max(1, 0.15 * view.scale);
    for (const y of [top, bottom]) g.fillRect(0, y - line / 2, view.width, line);
    for (let lane = 1; lane < item.lanes; lane++) {
      const y = view.py(lane * item.laneWidth) - line / 2;
      for (let x = Math.floor(view.left / 12) * 12; x < view.right; x += 12) g.fillRect(view.px(x), y, 3 * view.scale, line);
    }
    if (detail) drawRuler(g, view, bottom + 0.5 * view.scale);
  }

  function drawRuler(g, view, y) {
    g.fillStyle = colours.muted;
    g.font = "11px system-ui, sans-serif";
    g.textAlign = "center";
    for (let x = Math.ceil(view.left / 10) * 10; x < view.right; x += 10) {
      g.fillRect(view.px(x), y, 1, 5);
      if (x % 20 === 0) g.fillText(`${x} m`, view.px(x), y + 16);
    }
  }

  function drawVehicle(g, view, box, colour, outlined) {
    const length = box.length * view.scale, width = box.width * view.scale;
    g.save();
    g.translate(view.px(box.x), view.py(box.y));
    g.rotate(-box.h);
    g.fillStyle = colour;
    g.fillRect(-length / 2, -width / 2, length, width);
    g.fillStyle = "rgba(255,255,255,0.55)"; // the windscreen shows which end is the front
    // A truck's cab is at its nose; a car has a bonnet before it.
    const [behindNose, deep] = box.kind === "truck" ? [0.9 * view.scale, 0.7 * view.scale] : [0.38 * length, 0.13 * length];
    g.fillRect(length / 2 - behindNose, -0.36 * width, deep, 0.72 * width);
    g.strokeStyle = outlined ? colours.ink : "rgba(0,0,0,0.45)";
    g.lineWidth = outlined ? 2 : 1;
    g.strokeRect(-length / 2, -width / 2, length, width);
    g.restore();
  }

  // The AV on its way out: an outline, since it is not what happened.
  function drawWayOut(g, view, box) {
    const length = box.length * view.scale, width = box.width * view.scale;
    g.save();
    g.translate(view.px(box.x), view.py(box.y));
    g.rotate(-box.h);
    g.strokeStyle = colours["way-out-box"];
    g.lineWidth = 2.5;
    g.setLineDash([6, 4]);
    g.strokeRect(-length / 2, -width / 2, length, width);
    g.restore();
  }

  // An arrow from the nose to the lane that the vehicle changes to; none while it keeps its lane.
  function drawTarget(g, view, item, box, colour) {
    const goal = (box.lane + 0.5) * item.laneWidth;
    if (box.lane < 0 || Math.abs(goal - box.y) < 0.25) return;
    const nose = box.x + box.length / 2;
    const [x0, y0, x1, y1] = [view.px(nose), view.py(box.y), view.px(nose + 7), view.py(goal)];
    g.strokeStyle = colour;
    g.fillStyle = colour;
    g.lineWidth = 2;
    g.setLineDash([5, 4]);
    g.beginPath();
    g.moveTo(x0, y0);
    g.bezierCurveTo((x0 + x1) / 2, y0, (x0 + x1) / 2, y1, x1, y1);
    g.stroke();
    g.setLineDash([]);
    g.beginPath();
    g.moveTo(x1 + 8, y1);
    g.lineTo(x1 - 1, y1 - 5);
    g.lineTo(x1 - 1, y1 + 5);
    g.fill();
  }

  function drawLabel(g, view, box, label, below, strong) {
    const reach = (box.width / 2) * view.scale + Math.abs(Math.sin(box.h)) * (box.length / 2) * view.scale;
    const y = view.py(box.y) + (below ? reach + 14 : -reach - 5);
    g.font = `${strong ? "600 13px" : "11px"} system-ui, sans-serif`;
    g.textAlign = "center";
    // A plate of the road's colour keeps the text clear of lane markings.
    const wide = g.measureText(label).width + 6;
    g.fillStyle = colours.road;
    g.fillRect(view.px(box.x) - wide / 2, y - (strong ? 12 : 10), wide, strong ? 16 : 13);
    g.fillStyle = colours.paint;
    g.fillText(label, view.px(box.x), y);
  }

  function drawContact(g, view, a, b) {
    const area = commonArea(corners(a), corners(b));
    if (area.length < 3) return;
    g.fillStyle = colours.contact;
    g.beginPath();
    area.forEach(([x, y]) => g.lineTo(view.px(x), view.py(y)));
    g.fill();
    const cx = area.reduce((sum, p) => sum + p[0], 0) / area.length;
    const cy = area.reduce((sum, p) => sum + p[1], 0) / area.length;
    g.strokeStyle = colours.contact;
    g.lineWidth = view.scale > 6 ? 2.5 : 1.5;
    g.beginPath();
    g.arc(view.px(cx), view.py(cy), 1.7 * view.scale, 0, 2 * Math.PI);
    g.stroke();
  }

  function colourOf(item, index, critical) {
    if (index === 0) return colours.av;
    if (index === item.partner) return colours.partner;
    return index === critical ? colours.critical : colours.other;
  }

  function draw(canvas, item, frame, metres, detail) {
    const { context: g, width, height } = prepare(canvas);
    if (width === 0) return;
    const view = makeView(item, frame, width, height, metres);
    const critical = criticalVehicle(item, frame);
    drawRoad(g, view, item, detail);
    const boxes = item.vehicles.map((vehicle) => at(vehicle, frame));
    const partner = item.partner > 0 ? boxes[item.partner] : null;
    const isOfPair = (i) => i === 0 || i === item.partner;
    const vehicles = (chosen) => {
      for (const i of chosen) {
        const colour = colourOf(item, i, critical);
        if (detail) drawTarget(g, view, item, boxes[i], isOfPair(i) ? colours.paint : colour);
        drawVehicle(g, view, boxes[i], colour, i === critical);
      }
    };
    const labels = (chosen) => {
      if (!detail || view.scale <= 5) return;
      for (const i of chosen) {
        const box = boxes[i];
        const kind = item.vehicles[i].kind;
        const name = i === 0 ? "AV" : `BV ${item.vehicles[i].slot}${kind === "car" ? "" : `, ${kind},`}`;
        // The two that meet carry their labels on the sides turned away from each other.
        const below = isOfPair(i) && partner ? (i === 0) === boxes[0].y < partner.y : false;
        drawLabel(g, view, box, isOfPair(i) ? `${name} ${box.v.toFixed(1)} m/s` : box.v.toFixed(1), below, isOfPair(i));
      }
    };
    // The AV and its partner are drawn last, so that nothing hides them, not even a label.
    const others = boxes.map((_, i) => i).filter((i) => boxes[i] && !isOfPair(i));
    const pair = partner ? [item.partner, 0] : [0];
    vehicles(others);
    labels(others);
    vehicles(pair);
    const wayOut = detail && item.wayOut ? at(item.wayOut, frame) : null;
    if (wayOut) drawWayOut(g, view, wayOut);
    if (item.crash !== null && frame >= item.crash && partner) drawContact(g, view, boxes[0], partner);
    labels(pair);
  }

  // The road's width follows from the scale, so the view shows the metres that it promises.
  function fitHeight(canvas, item, metres) {
    const scale = canvas.clientWidth / metres;
    const height = Math.round(Math.min(720, Math.max(150, scale * (item.lanes * item.laneWidth + 0.6) + 70)));
    if (canvas.clientHeight !== height) canvas.style.height = `${height}px`;
  }

  // A value with its unit, as in print.
  const show = (value, unit, digits = 1) => (value === null || value === undefined ? "–" : `${value.toFixed(digits).replace(/^-(0\.0+)$/, "$1").replace("-", "−")} ${unit}`);

  readColours();
  dark.addEventListener("change", readColours);
  return { css, dark, seconds, at, decision, draw, fitHeight, show };
})();
