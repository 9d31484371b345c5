// Made by `make web`; do not edit. Its sources:
//   web/src/pages/charts.ts
//   web/src/pages/comparison.ts
//   web/src/pages/look.ts
//   web/src/pages/multiples.ts
//   web/src/pages/pages.ts
//   web/src/pages/player.ts
//   web/src/pages/print.ts
//   web/src/pages/report.ts
//   web/src/shared/clock.ts
//   web/src/shared/colours.ts
//   web/src/shared/format.ts
//   web/src/shared/framing.ts
//   web/src/shared/labels.ts
//   web/src/shared/motion.ts
//   web/src/shared/scene.ts
//   web/src/shared/site.ts
//   web/src/shared/surface.ts
//   web/src/shared/trails.ts
"use strict";
(() => {
  // src/shared/format.ts
  function show(value, unit, digits = 1) {
    if (value === null || value === void 0 || Number.isNaN(value)) return "–";
    if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
    const text = value.toFixed(digits).replace(/^-(0(\.0+)?)$/, "$1").replace("-", "−");
    return unit ? `${text} ${unit}` : text;
  }

  // src/shared/motion.ts
  function valueAt(motion, key, frame) {
    const local = frame - motion.from;
    const low = Math.floor(local);
    const part = local - low;
    const a = motion[key][low] ?? null;
    if (part === 0 || a === null) return a;
    const b = motion[key][low + 1] ?? null;
    return b === null ? null : a * (1 - part) + b * part;
  }
  function boxAt(motion, frame) {
    const [x, y, v, h] = ["x", "y", "v", "h"].map((key) => valueAt(motion, key, frame));
    if (x == null || y == null || v == null || h == null) return null;
    const lane = motion.lane[Math.floor(frame - motion.from)] ?? -1;
    return { x, y, v, h, lane, length: motion.length, width: motion.width };
  }
  var secondsAt = (item, frame) => (item.first + frame) * item.dt;
  var decisionAt = (item, frame) => Math.min(Math.floor((item.first + frame + 1e-6) / 10), item.critical.length - 1);
  function criticalAt(item, frame) {
    const k = decisionAt(item, frame);
    return k < 0 ? -1 : item.critical[k] ?? -1;
  }
  function corners(box) {
    const c = Math.cos(box.h);
    const s = Math.sin(box.h);
    const along = box.length / 2;
    const across = box.width / 2;
    const local = [[along, across], [-along, across], [-along, -across], [along, -across]];
    return local.map(([a, b]) => [box.x + a * c - b * s, box.y + a * s + b * c]);
  }
  function commonArea(subject, clip) {
    let result = [...subject];
    clip.forEach((p, i) => {
      const q = clip[(i + 1) % clip.length];
      const side = ([x, y]) => (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]);
      const input = result;
      result = [];
      input.forEach((b, j) => {
        const a = input[(j + input.length - 1) % input.length];
        const [sa, sb] = [side(a), side(b)];
        if (sa >= 0 !== sb >= 0) {
          const t = sa / (sa - sb);
          result.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
        }
        if (sb >= 0) result.push(b);
      });
    });
    return result;
  }
  function nearestIn(box, [x, y]) {
    const [c, s] = [Math.cos(box.h), Math.sin(box.h)];
    const [dx, dy] = [x - box.x, y - box.y];
    const keep = (value, most) => Math.max(-most, Math.min(most, value));
    const along = keep(dx * c + dy * s, box.length / 2);
    const across = keep(-dx * s + dy * c, box.width / 2);
    return [box.x + along * c - across * s, box.y + along * s + across * c];
  }
  function touch(a, b) {
    const area = commonArea(corners(a), corners(b));
    if (area.length >= 3) {
      const mean = (k) => area.reduce((sum, p2) => sum + p2[k], 0) / area.length;
      return { area, middle: [mean(0), mean(1)] };
    }
    const pairs = [...corners(a).map((p2) => [p2, nearestIn(b, p2)]), ...corners(b).map((p2) => [p2, nearestIn(a, p2)])];
    const gap = ([p2, q2]) => Math.hypot(p2[0] - q2[0], p2[1] - q2[1]);
    const [p, q] = pairs.reduce((best, pair) => gap(pair) < gap(best) ? pair : best);
    return { area: [], middle: [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2] };
  }
  var gapAlong = (a, b) => Math.abs(a.x - b.x) - (a.length + b.length) / 2;
  function apart(a, b) {
    if (commonArea(corners(a), corners(b)).length > 0) return 0;
    const far = (corner, other) => {
      const [x, y] = nearestIn(other, corner);
      return Math.hypot(corner[0] - x, corner[1] - y);
    };
    return Math.min(...corners(a).map((corner) => far(corner, b)), ...corners(b).map((corner) => far(corner, a)));
  }
  var gapOf = (item, a, b) => item.site ? apart(a, b) : gapAlong(a, b);
  function changesTo(box, laneWidth) {
    if (box.lane < 0) return null;
    const goal = (box.lane + 0.5) * laneWidth;
    return Math.abs(goal - box.y) < 0.25 ? null : goal;
  }
  var crashFrame = (item) => Math.max(0, Math.min(item.crash ?? item.frames - 1, item.frames - 1));

  // src/shared/clock.ts
  var PAUSE_S = 0.8;
  function tick(frame, passed, dt, rate, { from, to, loop }) {
    const next = frame + Math.max(0, passed) / dt * rate;
    if (!loop) return next >= to ? { frame: to, over: true } : { frame: next, over: false };
    const pause = PAUSE_S / dt * rate;
    return { frame: next >= to + pause ? from : next, over: false };
  }
  var whole = (frame) => Math.floor(frame + 1e-6);
  var clamp = (value, low, high) => Math.max(low, Math.min(high, value));

  // src/shared/framing.ts
  var [LEAST_M, MOST_M, ROOM_M] = [46, 110, 22];
  function frameFor(item, begin, end) {
    const partner = item.vehicles[item.partner];
    let [low, high] = [0, 0];
    for (let frame = begin; partner && frame <= end; frame++) {
      const [av, other] = [valueAt(item.vehicles[0], "x", frame), valueAt(partner, "x", frame)];
      if (av === null || other === null) continue;
      [low, high] = [Math.min(low, other - av), Math.max(high, other - av)];
    }
    if (item.site) return { metres: LEAST_M, ahead: 0 };
    return { metres: clamp(high - low + ROOM_M, LEAST_M, MOST_M), ahead: (low + high) / 2 };
  }
  function middleOf(item, av, wide, high) {
    const end = crashFrame(item);
    const [last, partner] = [boxAt(item.vehicles[0], end) ?? av, item.partner > 0 ? boxAt(item.vehicles[item.partner], end) : null];
    const [x, y] = partner ? touch(last, partner).middle : [last.x, last.y];
    return [clamp(x, av.x - 0.4 * wide, av.x + 0.4 * wide), clamp(y, av.y - 0.4 * high, av.y + 0.4 * high)];
  }

  // src/shared/labels.ts
  var meet = (a, b) => Math.abs(a.x - b.x) < a.w + b.w && Math.abs(a.y - b.y) < a.h + b.h;
  function place(wishes, obstacles, size) {
    const taken = [...obstacles];
    return wishes.map((wish) => {
      const found = candidates(wish).find((rect) => isInside(rect, size) && !taken.some((other) => meet(rect, other)));
      if (found) taken.push(found);
      return found ?? null;
    });
  }
  var isInside = (rect, { width, height }) => rect.x - rect.w >= 0 && rect.x + rect.w <= width && rect.y - rect.h >= 0 && rect.y + rect.h <= height;
  function candidates({ box, w, h, below, must }) {
    const at = (x, y) => ({ x, y, w, h });
    const up = below ? 1 : -1;
    const off = box.h + h + 2;
    const near = [at(box.x, box.y + up * off), at(box.x, box.y - up * off), at(box.x + box.w + w + 3, box.y), at(box.x - box.w - w - 3, box.y)];
    if (!must) return near;
    const far = [1, 2, 3, 4, 5, 6, 8, 10].flatMap(
      (n) => [up, -up].flatMap((side) => [0, 1, -1].map((aside) => at(box.x + aside * (box.w + w), box.y + side * (off + n * h))))
    );
    return [...near, ...far];
  }

  // src/shared/site.ts
  function letterAt({ from, letters }, frame) {
    let shown = 0;
    while (shown + 1 < from.length && from[shown + 1] <= frame + 1e-6) shown += 1;
    return letters[shown] ?? "r";
  }
  var lightColour = (letter, colours) => letter === "r" ? colours["signal-red"] : letter === "y" ? colours["signal-amber"] : colours["signal-green"];
  var WIDE = { edge: 0.12, stop: 0.4, light: 0.7 };
  function follow(g, view, line) {
    for (let i = 0; i < line.length; i += 2) {
      const [x, y] = [view.px(line[i]), view.py(line[i + 1])];
      i === 0 ? g.moveTo(x, y) : g.lineTo(x, y);
    }
  }
  function strokeAll(g, view, lines, colour, wide) {
    g.strokeStyle = colour;
    g.lineWidth = Math.max(1, wide * view.scale);
    g.beginPath();
    for (const line of lines) follow(g, view, line);
    g.stroke();
  }
  function drawSite(g, view, site, frame, colours) {
    g.fillStyle = g.strokeStyle = colours.road;
    g.lineWidth = 1.2 * view.scale;
    g.beginPath();
    for (const lane of site.lanes) {
      follow(g, view, lane);
      g.closePath();
    }
    g.fill();
    g.stroke();
    strokeAll(g, view, site.edges, colours.paint, WIDE.edge);
    g.fillStyle = colours.paint;
    g.beginPath();
    for (const bar of site.bars) follow(g, view, bar);
    g.fill();
    strokeAll(g, view, site.stops, colours.paint, WIDE.stop);
    for (const light of site.lights) {
      strokeAll(g, view, [light.at], lightColour(letterAt(light, frame), colours), WIDE.light * (light.walks ? 0.6 : 1));
    }
  }

  // src/shared/surface.ts
  var MARKS = {
    solid: [0.15, 0, 0],
    broken: [0.15, 3, 12],
    wide: [0.3, 3, 6],
    barrier: [0.4, 0, 0],
    hatch: [0.4, 3, 6]
  };
  function surfaceOf({ surface, lanes, laneWidth }) {
    if (surface) return surface;
    const lines = Array.from({ length: lanes + 1 }, (_, i) => [null, i * laneWidth, null, i * laneWidth, i % lanes === 0 ? "solid" : "broken"]);
    return { areas: [[null, null, 0, lanes * laneWidth, 0, lanes * laneWidth]], lines };
  }
  var outlines = ({ areas }, low, high, shoulder) => areas.map(([begin, end, right, left, rightEnd, leftEnd]) => [
    [begin ?? low, right - shoulder],
    [end ?? high, rightEnd - shoulder],
    [end ?? high, leftEnd + shoulder],
    [begin ?? low, left + shoulder]
  ]);
  function strokes([from, y, to, yEnd, mark], low, high) {
    const [, long, every] = MARKS[mark];
    const [first, last] = [from ?? -Infinity, to ?? Infinity];
    const [begin, end] = [Math.max(first, low), Math.min(last, high)];
    if (begin > end) return [];
    if (every === 0) return [y === yEnd ? [[begin, y], [end, y]] : [[first, y], [last, yEnd]]];
    const places = Array.from({ length: Math.floor(end / every) - Math.floor(begin / every) + 1 }, (_, i) => (Math.floor(begin / every) + i) * every);
    if (mark === "hatch") return places.filter((s) => first <= s && s + long <= last).map((s) => [[s, y], [s + long, yEnd]]);
    return places.filter((s) => s + long > begin && s < end).map((s) => [[Math.max(s, begin), y], [Math.min(s + long, end), y]]);
  }

  // src/shared/trails.ts
  function trail(motion, frame, seconds, dt) {
    const points = [];
    for (let back = 0; back <= Math.round(seconds / dt); back++) {
      const box = boxAt(motion, frame - back);
      if (!box) break;
      points.push({ x: box.x, y: box.y, age: back * dt });
    }
    return points;
  }
  var BRAKES_FROM = 1;
  function brakes(motion, frame, dt) {
    const [now, before] = [valueAt(motion, "v", frame), valueAt(motion, "v", frame - 1)];
    return now !== null && before !== null && (before - now) / dt > BRAKES_FROM;
  }

  // src/shared/scene.ts
  var [UNSEEN, MISPLACED] = [0.3, 0.25];
  function prepare(canvas) {
    const pixels = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const [wide, high] = [Math.round(width * pixels), Math.round(height * pixels)];
    if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
    const g = canvas.getContext("2d", { alpha: false });
    g.setTransform(pixels, 0, 0, pixels, 0, 0);
    return { g, width, height };
  }
  function makeSiteView(item, av, aside, width, height, metres) {
    const scale = Math.min(width / metres, height / (0.5 * metres));
    const [middle, centre] = middleOf(item, av, width / scale, height / scale);
    return {
      scale,
      width,
      height,
      left: middle + aside - width / 2 / scale,
      right: middle + aside + width / 2 / scale,
      px: (x) => (x - middle - aside) * scale + width / 2,
      py: (y) => height / 2 - (y - centre) * scale
    };
  }
  function makeView(item, middle, width, height, metres) {
    const scale = Math.min(width / metres, (height - 4) / (item.lanes * item.laneWidth + 0.6));
    const centre = item.lanes * item.laneWidth / 2;
    return {
      scale,
      width,
      height,
      left: middle - width / 2 / scale,
      right: middle + width / 2 / scale,
      px: (x) => (x - middle) * scale + width / 2,
      py: (y) => height / 2 - (y - centre) * scale
    };
  }
  function drawRoad(g, view, item, frame, colours, detail) {
    g.fillStyle = colours.verge;
    g.fillRect(0, 0, view.width, view.height);
    if (item.site) {
      drawSite(g, view, item.site, frame, colours);
      if (detail) drawNorth(g, view, colours);
      return;
    }
    const surface = surfaceOf(item);
    g.fillStyle = colours.road;
    g.beginPath();
    for (const corners2 of outlines(surface, view.left, view.right, 0.3)) {
      corners2.forEach(([x, y], i) => i === 0 ? g.moveTo(view.px(x), view.py(y)) : g.lineTo(view.px(x), view.py(y)));
    }
    g.fill();
    for (const line of surface.lines) {
      g.strokeStyle = line[4] === "barrier" ? colours.contact : colours.paint;
      g.lineWidth = Math.max(1, MARKS[line[4]][0] * view.scale);
      g.beginPath();
      for (const [[x0, y0], [x1, y1]] of strokes(line, view.left, view.right)) {
        g.moveTo(view.px(x0), view.py(y0));
        g.lineTo(view.px(x1), view.py(y1));
      }
      g.stroke();
    }
    if (detail) drawRuler(g, view, view.py(-0.5), colours);
  }
  function drawNorth(g, view, colours) {
    const [x, y, long] = [view.width - 14, view.height - 12, 10 * view.scale];
    g.fillStyle = colours.ink;
    g.fillRect(x - long, y, long, 2);
    g.font = "11px system-ui, sans-serif";
    g.textAlign = "right";
    g.fillText("10 m", x, y - 5);
    g.textAlign = "center";
    g.fillText("N", x - 4, y - 40);
    g.beginPath();
    for (const [right, up] of [[0, 36], [-4, 22], [4, 22]]) g.lineTo(x - 4 + right, y - up);
    g.fill();
  }
  function drawRuler(g, view, y, colours) {
    g.fillStyle = colours.muted;
    g.font = "11px system-ui, sans-serif";
    g.textAlign = "center";
    const every = 20 * view.scale > 60 ? 20 : 40;
    for (let x = Math.ceil(view.left / 10) * 10; x < view.right; x += 10) {
      g.fillRect(view.px(x), y, 1, 5);
      if (x % every === 0) g.fillText(`${x} m`.replace("-", "−"), view.px(x), y + 16);
    }
  }
  function within(g, view, box, draw) {
    g.save();
    g.translate(view.px(box.x), view.py(box.y));
    g.rotate(-box.h);
    draw(box.length * view.scale, box.width * view.scale);
    g.restore();
  }
  function drawVehicle(g, view, box, { fill, outline, kind, isBraking }) {
    within(g, view, box, (length, width) => {
      g.fillStyle = fill;
      if (kind === "person") {
        drawPerson(g, Math.max(3.5, 0.75 * length), outline);
        return;
      }
      g.fillRect(-length / 2, -width / 2, length, width);
      g.fillStyle = "rgba(255,255,255,0.55)";
      const [behindNose, deep] = kind === "truck" ? [0.9 * view.scale, 0.7 * view.scale] : [0.38 * length, 0.13 * length];
      g.fillRect(length / 2 - behindNose, -0.36 * width, deep, 0.72 * width);
      if (kind === "truck" && length > 20) {
        g.fillStyle = "rgba(0,0,0,0.35)";
        g.fillRect(length / 2 - 2.4 * view.scale, -width / 2, Math.max(1, 0.25 * view.scale), width);
      }
      if (isBraking) {
        g.fillStyle = "#ff3b30";
        const deepest = Math.max(2, 0.35 * view.scale);
        g.fillRect(-length / 2, -width / 2, deepest, width * 0.3);
        g.fillRect(-length / 2, width * 0.2, deepest, width * 0.3);
      }
      g.strokeStyle = outline ?? "rgba(0,0,0,0.45)";
      g.lineWidth = outline ? 2 : 1;
      g.strokeRect(-length / 2, -width / 2, length, width);
    });
  }
  function drawPerson(g, radius, outline) {
    g.beginPath();
    g.arc(0, 0, radius, 0.6, 2 * Math.PI - 0.6);
    g.lineTo(1.7 * radius, 0);
    g.closePath();
    g.fill();
    g.strokeStyle = outline ?? "rgba(0,0,0,0.7)";
    g.lineWidth = outline ? 2 : 1;
    g.stroke();
  }
  function drawGhost(g, view, box, colour) {
    within(g, view, box, (length, width) => {
      g.globalAlpha = 0.18;
      g.fillStyle = colour;
      g.fillRect(-length / 2, -width / 2, length, width);
      g.globalAlpha = 1;
      g.strokeStyle = colour;
      g.lineWidth = 2.5;
      g.setLineDash([6, 4]);
      g.strokeRect(-length / 2, -width / 2, length, width);
    });
  }
  function seenAt({ seenX, seenY, ...motion }, frame) {
    return seenX && seenY ? boxAt({ ...motion, x: seenX, y: seenY }, frame) : void 0;
  }
  function drawTrail(g, view, motion, frame, seconds, dt, colour) {
    const points = trail(motion, frame, seconds, dt);
    g.strokeStyle = g.fillStyle = colour;
    g.lineWidth = Math.max(1.5, 0.16 * view.scale);
    points.forEach(({ x, y, age }, i) => {
      const next = points[i + 1];
      g.globalAlpha = 0.75 * (1 - age / (seconds + dt));
      if (next) {
        g.beginPath();
        g.moveTo(view.px(x), view.py(y));
        g.lineTo(view.px(next.x), view.py(next.y));
        g.stroke();
      }
      if (age > 0 && Math.abs(age - Math.round(age)) < 1e-6) {
        g.beginPath();
        g.arc(view.px(x), view.py(y), g.lineWidth * 1.5, 0, 2 * Math.PI);
        g.fill();
      }
    });
    g.globalAlpha = 1;
  }
  function drawTarget(g, view, item, box, colour) {
    const goal = changesTo(box, item.laneWidth);
    if (goal === null) return;
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
  function drawContact(g, view, a, b, colours) {
    const { area, middle } = touch(a, b);
    g.fillStyle = g.strokeStyle = colours.contact;
    g.beginPath();
    area.forEach(([x, y]) => g.lineTo(view.px(x), view.py(y)));
    g.fill();
    const width = view.scale > 6 ? 2.5 : 1.5;
    g.beginPath();
    g.arc(view.px(middle[0]), view.py(middle[1]), Math.max(6, 1.7 * view.scale), 0, 2 * Math.PI);
    if (view.scale > 6) {
      g.strokeStyle = colours.paint;
      g.lineWidth = 2 * width;
      g.stroke();
    }
    g.strokeStyle = colours.contact;
    g.lineWidth = width;
    g.stroke();
  }
  function colourOf(item, index, critical, colours) {
    if (index === 0) return colours.av;
    if (index === item.partner) return colours.partner;
    if (index === critical) return colours.critical;
    return item.vehicles[index].kind === "person" ? colours.person : colours.other;
  }
  function around(view, box) {
    const [c, s] = [Math.abs(Math.cos(box.h)), Math.abs(Math.sin(box.h))];
    const w = (c * box.length + s * box.width) / 2 * view.scale;
    const h = (s * box.length + c * box.width) / 2 * view.scale;
    return { x: view.px(box.x), y: view.py(box.y), w, h };
  }
  function drawNames(g, view, names, boxes, colours) {
    const font = (strong) => `${strong ? "600 13px" : "11px"} system-ui, sans-serif`;
    const wishes = names.map(({ text, box, below, strong }) => {
      g.font = font(strong);
      return { box: around(view, box), w: g.measureText(text).width / 2 + 4, h: strong ? 9 : 7, below, must: strong };
    });
    const places = place(wishes, boxes.map((box) => around(view, box)), view);
    g.textAlign = "center";
    g.textBaseline = "middle";
    names.forEach(({ text, strong, colour }, i) => {
      const [at, wish] = [places[i], wishes[i]];
      if (!at) return;
      const gap = Math.abs(at.y - wish.box.y) - at.h - wish.box.h;
      if (gap > 6 || Math.abs(at.x - wish.box.x) > 1 && Math.abs(at.y - wish.box.y) > at.h) {
        g.strokeStyle = colour ?? colours.muted;
        g.lineWidth = 1;
        g.beginPath();
        g.moveTo(at.x, at.y - Math.sign(at.y - wish.box.y) * at.h);
        g.lineTo(wish.box.x, wish.box.y + Math.sign(at.y - wish.box.y) * wish.box.h);
        g.stroke();
      }
      g.fillStyle = colours.road;
      g.fillRect(at.x - at.w, at.y - at.h, 2 * at.w, 2 * at.h);
      if (colour) {
        g.fillStyle = colour;
        g.fillRect(at.x - at.w, at.y + at.h - 2, 2 * at.w, 2);
      }
      g.font = font(strong);
      g.fillStyle = colours.paint;
      g.fillText(text, at.x, at.y);
    });
    g.textBaseline = "alphabetic";
  }
  function nameOf(item, index, box, isBrief) {
    const vehicle = item.vehicles[index];
    const isOfPair = index === 0 || index === item.partner;
    const kind = vehicle.kind === "car" ? "" : vehicle.kind;
    const speed = box.v.toFixed(1);
    if (!isOfPair) return kind ? `${kind} ${speed}` : speed;
    const name = index === 0 ? "AV" : vehicle.kind === "person" ? `person ${vehicle.slot}` : `BV ${vehicle.slot}${kind ? `, ${kind},` : ""}`;
    return isBrief ? name.replace(/,$/, "") : `${name} ${speed} m/s`;
  }
  function drawScene(canvas, item, frame, look, colours) {
    const av = boxAt(item.vehicles[0], frame);
    const { g, width, height } = prepare(canvas);
    if (width === 0 || !av) return;
    const aside = look.ahead ?? 0;
    const view = item.site ? makeSiteView(item, av, aside, width, height, look.metres) : makeView(item, av.x + aside, width, height, look.metres);
    const critical = criticalAt(item, frame);
    drawRoad(g, view, item, frame, colours, look.detail);
    const boxes = item.vehicles.map((vehicle) => boxAt(vehicle, frame));
    const partner = item.partner > 0 ? boxes[item.partner] ?? null : null;
    const isOfPair = (i) => i === 0 || i === item.partner;
    const isSeen = ({ x, y, length }) => x + length / 2 > view.left && x - length / 2 < view.right && view.py(y - length / 2) > 0 && view.py(y + length / 2) < view.height;
    const others = boxes.map((_, i) => i).filter((i) => boxes[i] && !isOfPair(i) && isSeen(boxes[i]));
    const order = [...others, ...partner ? [item.partner] : [], 0];
    const colour = (i) => colourOf(item, i, critical, colours);
    if (look.trail) for (const i of order) drawTrail(g, view, item.vehicles[i], frame, look.trail, item.dt, colour(i));
    for (const i of order) {
      const box = boxes[i];
      if (look.detail) drawTarget(g, view, item, box, isOfPair(i) ? colours.paint : colour(i));
      const outline = i === critical ? colours.ink : i === 0 && look.detail ? colours.paint : null;
      const isBraking = look.detail && brakes(item.vehicles[i], frame, item.dt);
      const seen = seenAt(item.vehicles[i], frame);
      g.globalAlpha = seen === null ? UNSEEN : 1;
      drawVehicle(g, view, box, { fill: colour(i), outline, kind: item.vehicles[i].kind, isBraking });
      g.globalAlpha = 1;
      if (look.detail && seen && Math.hypot(seen.x - box.x, seen.y - box.y) > MISPLACED) drawGhost(g, view, seen, colours.av);
    }
    const shades = look.detail ? (look.ghosts ?? []).map((ghost) => ({ ...ghost, box: boxAt(ghost.motion, frame) })) : [];
    for (const { box, colour: shade } of shades) if (box) drawGhost(g, view, box, shade);
    if (item.crash !== null && frame >= item.crash && partner) drawContact(g, view, av, partner, colours);
    if (!look.detail) return;
    const isBrief = view.scale <= 5;
    const saw = (i) => seenAt(item.vehicles[i], frame) === null ? item.lineOfSight ? ", hidden" : ", not seen" : "";
    const below = (i) => partner !== null && isOfPair(i) ? i === 0 === av.y < partner.y : false;
    const named = [0, ...partner && isSeen(partner) ? [item.partner] : [], ...isBrief ? [] : others];
    const names = named.map((i) => ({
      text: nameOf(item, i, boxes[i], isBrief) + saw(i),
      box: boxes[i],
      below: below(i),
      strong: isOfPair(i),
      colour: isOfPair(i) ? colour(i) : null
    }));
    for (const { box, colour: shade, name } of shades) {
      if (box) names.push({ text: name, box, below: !below(0), strong: false, colour: shade });
    }
    const solid = [...order.map((i) => boxes[i]), ...shades.map(({ box }) => box).filter((box) => box !== null)];
    drawNames(g, view, names, solid, colours);
    if (partner && !item.site && !isSeen(partner)) drawPointer(g, view, `BV ${item.vehicles[item.partner].slot}`, av, partner, view.py(item.lanes * item.laneWidth + 0.3), colours);
  }
  function drawPointer(g, view, name, av, partner, top, colours) {
    const isAhead = partner.x > av.x;
    const text = `${name}, ${Math.max(0, gapAlong(av, partner)).toFixed(0)} m ${isAhead ? "ahead" : "behind"}`;
    g.font = "600 12px system-ui, sans-serif";
    const [wide, y, tip] = [g.measureText(text).width + 12, Math.max(12, top - 14), isAhead ? view.width - 4 : 4];
    const way = isAhead ? -1 : 1;
    g.fillStyle = colours.partner;
    g.beginPath();
    g.moveTo(tip, y);
    g.lineTo(tip + way * 9, y - 10);
    g.lineTo(tip + way * (9 + wide), y - 10);
    g.lineTo(tip + way * (9 + wide), y + 10);
    g.lineTo(tip + way * 9, y + 10);
    g.fill();
    g.fillStyle = "#ffffff";
    g.textAlign = "center";
    g.textBaseline = "middle";
    g.fillText(text, tip + way * (9 + wide / 2), y);
    g.textBaseline = "alphabetic";
  }
  function heightFor(item, width, metres) {
    const scale = width / metres;
    if (item.site) return Math.round(Math.min(720, Math.max(260, 0.6 * width)));
    return Math.round(Math.min(720, Math.max(150, scale * (item.lanes * item.laneWidth + 0.6) + 70)));
  }
  function fitHeight(canvas, item, metres) {
    const height = heightFor(item, canvas.clientWidth, metres);
    if (canvas.clientHeight !== height) canvas.style.height = `${height}px`;
  }

  // src/shared/colours.ts
  var NAMES = [
    "av",
    "partner",
    "critical",
    "other",
    "person",
    "road",
    "verge",
    "paint",
    "ink",
    "muted",
    "contact",
    "paper",
    "grid",
    "way-out",
    "way-out-box",
    "plane",
    "accent",
    "ghost-1",
    "ghost-2",
    "ghost-3",
    "ghost-4",
    "ghost-1-box",
    "ghost-2-box",
    "ghost-3-box",
    "ghost-4-box",
    "signal-green",
    "signal-amber",
    "signal-red"
  ];
  var css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  function readColours() {
    const style = getComputedStyle(document.documentElement);
    return Object.fromEntries(NAMES.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  }
  var dark = window.matchMedia("(prefers-color-scheme: dark)");

  // src/pages/multiples.ts
  var BEFORE_S = 4;
  var METRES = 36;
  function animate(pictures, colours) {
    const calm = window.matchMedia("(prefers-reduced-motion: reduce)");
    const frames = /* @__PURE__ */ new Map();
    const still2 = (one) => draw(one, crashFrame(one.item));
    let last = 0;
    function draw({ button, item }, frame) {
      drawScene(button.querySelector("canvas"), item, frame, { metres: METRES, detail: false, trail: 1.5 }, colours());
    }
    function step(now) {
      const passed = Math.max(0, now - last) / 1e3;
      last = now;
      for (const [one, frame] of frames) {
        const to = crashFrame(one.item);
        const from = Math.max(0, to - Math.round(BEFORE_S / one.item.dt));
        const next = tick(frame, passed, one.item.dt, 1, { from, to, loop: true }).frame;
        frames.set(one, next);
        draw(one, Math.min(next, to));
      }
      if (frames.size > 0) requestAnimationFrame(step);
    }
    function begin(one) {
      if (calm.matches || frames.has(one)) return;
      frames.set(one, Math.max(0, crashFrame(one.item) - Math.round(BEFORE_S / one.item.dt)));
      if (frames.size > 1) return;
      last = performance.now();
      requestAnimationFrame(step);
    }
    function end(one) {
      if (frames.delete(one)) still2(one);
    }
    const touch2 = window.matchMedia("(hover: none)").matches;
    const sight = new IntersectionObserver((seen) => {
      for (const { target, isIntersecting } of seen) {
        const one = pictures.find(({ button }) => button === target);
        isIntersecting ? begin(one) : end(one);
      }
    }, { threshold: 0.9 });
    for (const one of pictures) {
      if (touch2) sight.observe(one.button);
      else {
        for (const name of ["pointerenter", "focus"]) one.button.addEventListener(name, () => begin(one));
        for (const name of ["pointerleave", "blur"]) one.button.addEventListener(name, () => end(one));
      }
    }
    const all = () => pictures.forEach((one) => {
      if (!frames.has(one)) still2(one);
    });
    all();
    return all;
  }

  // src/pages/print.ts
  var SHEET = 688;
  function onPrint(redraw) {
    const root = document.documentElement;
    const take = (prints) => {
      root.toggleAttribute("data-print", prints);
      redraw(prints ? SHEET : null);
    };
    window.addEventListener("beforeprint", () => take(true));
    window.addEventListener("afterprint", () => take(false));
  }

  // src/pages/player.ts
  var byId = (id) => document.getElementById(id);
  var pageData = (id) => JSON.parse(byId(id).textContent);
  function makePlayer({ cases, draw, chosen, moved, thumbnail }) {
    const state = { index: 0, frame: 0, playing: false, rate: 1, view: 80, last: 0, ticket: 0 };
    let colours = readColours();
    const scrub = byId("scrub");
    const caseButtons = [...document.querySelectorAll("button.case")];
    const current = () => cases[state.index];
    const lastFrame2 = (item) => item.frames - 1;
    function refresh() {
      const item = current();
      const frame = whole(state.frame);
      draw(item, state.playing ? state.frame : frame, state.view, colours);
      scrub.value = String(frame);
      scrub.setAttribute("aria-valuetext", `${secondsAt(item, frame).toFixed(1)} seconds`);
      moved(item, frame);
    }
    function writeHash() {
      const frame = whole(state.frame);
      const t = frame === crashFrame(current()) ? "crash" : secondsAt(current(), frame).toFixed(1);
      history.replaceState(null, "", `#case=${encodeURIComponent(current().id).replaceAll("%3A", ":")}&t=${t}`);
    }
    function pause() {
      state.playing = false;
      state.frame = whole(state.frame);
      byId("play").textContent = "Play";
      refresh();
    }
    function play() {
      if (state.frame >= lastFrame2(current())) state.frame = 0;
      state.playing = true;
      state.last = performance.now();
      byId("play").textContent = "Pause";
      cancelAnimationFrame(state.ticket);
      state.ticket = requestAnimationFrame(step);
    }
    function step(now) {
      if (!state.playing) return;
      const passed = Math.max(0, now - state.last) / 1e3;
      state.last = now;
      const next = tick(state.frame, passed, current().dt, state.rate, { from: 0, to: lastFrame2(current()), loop: false });
      state.frame = next.frame;
      if (next.over) {
        pause();
        writeHash();
        return;
      }
      refresh();
      state.ticket = requestAnimationFrame(step);
    }
    function seek(frame) {
      state.frame = clamp(frame, 0, lastFrame2(current()));
      pause();
      writeHash();
    }
    function select(index, frame = 0) {
      state.index = index;
      state.playing = false;
      const item = current();
      for (const button of caseButtons) button.setAttribute("aria-pressed", String(Number(button.dataset.index) === index));
      byId("case-title").textContent = item.title;
      byId("case-verdict").textContent = item.verdict;
      scrub.max = String(lastFrame2(item));
      state.frame = clamp(frame, 0, lastFrame2(item));
      chosen(item);
      pause();
    }
    function bringIntoSight() {
      const place2 = byId("player");
      const { top, bottom } = byId("case-title").parentElement.querySelector("canvas").getBoundingClientRect();
      if (top < 0 || bottom > window.innerHeight) place2.scrollIntoView({ block: "start", behavior: "instant" });
      place2.classList.remove("flash");
      void place2.offsetWidth;
      place2.classList.add("flash");
    }
    function selectId(id) {
      const index = cases.findIndex((item) => item.id === id);
      if (index < 0) return false;
      select(index);
      writeHash();
      bringIntoSight();
      return true;
    }
    function readHash() {
      const wish = new URLSearchParams(location.hash.slice(1));
      const index = cases.findIndex((item2) => item2.id === wish.get("case"));
      const item = cases[index];
      if (!item) return false;
      const t = wish.get("t");
      select(index, t === "crash" ? crashFrame(item) : Math.round((Number(t) || 0) / item.dt) - item.first);
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
    function listen() {
      const onClick = (id, act) => byId(id).addEventListener("click", act);
      onClick("play", () => state.playing ? pause() : play());
      onClick("back", () => seek(state.frame - 1));
      onClick("forward", () => seek(Math.floor(state.frame) + 1));
      onClick("to-crash", () => seek(crashFrame(current())));
      scrub.addEventListener("input", () => seek(Number(scrub.value)));
      const choice = (id, take) => byId(id).addEventListener("change", (event) => take(Number(event.target.value)));
      choice("rate", (value) => {
        state.rate = value;
      });
      choice("view", (value) => {
        state.view = value;
        refresh();
      });
      for (const button of caseButtons) {
        button.addEventListener("click", () => {
          select(Number(button.dataset.index));
          writeHash();
          bringIntoSight();
          play();
        });
      }
      document.querySelectorAll("a.play").forEach((link) => {
        link.addEventListener("click", (event) => {
          event.preventDefault();
          selectId(link.dataset.case);
          play();
        });
      });
      document.addEventListener("keydown", onKey);
      window.addEventListener("hashchange", () => {
        if (readHash()) bringIntoSight();
      });
      const small = caseButtons.map((button) => ({ button, item: thumbnail(cases[Number(button.dataset.index)]) }));
      const drawSmall = animate(small, () => colours);
      const redraw = () => {
        colours = readColours();
        refresh();
        drawSmall();
      };
      dark.addEventListener("change", redraw);
      onPrint(redraw);
      new ResizeObserver(() => {
        refresh();
        drawSmall();
      }).observe(byId("player"));
    }
    function start(index) {
      if (readHash()) bringIntoSight();
      else select(index, crashFrame(cases[index]));
      listen();
    }
    return { current, selectId, seek, start };
  }

  // src/pages/comparison.ts
  var SIDES = ["old", "new"];
  var held = (recording, frame) => Math.min(frame, recording.frames - 1);
  function write(side, item, frame) {
    const recording = item[side];
    const now = recording ? held(recording, frame) : 0;
    const av = recording && boxAt(recording.vehicles[0], now);
    const bv = recording && recording.partner > 0 ? boxAt(recording.vehicles[recording.partner], now) : null;
    const touches = recording !== null && recording.crash !== null && now >= recording.crash;
    const isOver = recording !== null && frame > recording.frames - 1;
    const cells = {
      end: item.ends[side],
      av: show(av?.v, "m/s"),
      bv: show(bv?.v, "m/s"),
      gap: show(recording && av && bv && gapOf(recording, av, bv), "m"),
      state: touches ? "contact" : isOver ? "over" : recording ? "driving" : "–"
    };
    for (const [name, value] of Object.entries(cells)) byId(`${side}-${name}`).textContent = value;
    byId(`${side}-state`).classList.toggle("touches", touches);
  }
  function startComparison() {
    const cases = pageData("cases");
    if (cases.length === 0) return;
    makePlayer({
      cases,
      draw: (item, frame, metres, colours) => {
        for (const side of SIDES) {
          const canvas = byId(`road-${side}`);
          const recording = item[side];
          canvas.hidden = !recording;
          if (!recording) continue;
          const ghosts = recording.wayOut ? [{ motion: recording.wayOut, colour: colours["way-out-box"], name: "the other version" }] : [];
          fitHeight(canvas, recording, metres);
          drawScene(canvas, recording, held(recording, frame), { metres, detail: true, ghosts }, colours);
        }
      },
      chosen: () => void 0,
      moved: (item, frame) => {
        for (const side of SIDES) write(side, item, frame);
        byId("clock").textContent = show(secondsAt(item, frame), "s");
      },
      thumbnail: (item) => item.new.crash === null && item.old ? item.old : item.new
    }).start(0);
  }

  // src/pages/charts.ts
  var still = { responsive: true, displayModeBar: false };
  var zoomable = {
    responsive: true,
    displayModeBar: true,
    displaylogo: false,
    modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]]
  };
  var drawn = /* @__PURE__ */ new Map();
  function resolve(node) {
    if (typeof node === "string") return node.startsWith("css:") ? css(node.slice(4)) : node;
    if (Array.isArray(node)) return node.map(resolve);
    if (node === null || typeof node !== "object") return node;
    return Object.fromEntries(Object.entries(node).map(([key, value]) => [key, resolve(value)]));
  }
  function drawFigure(element, figure, width = null) {
    drawn.set(element, figure);
    const { data, layout } = resolve(figure);
    if (width !== null) Object.assign(layout, { width });
    Plotly.react(element, data, layout, figure.layout.dragmode === "zoom" ? zoomable : still);
  }
  var changeLayout = (element, change) => Plotly.relayout(element, change);
  function drawFigures(figures) {
    dark.addEventListener("change", () => drawn.forEach((figure, element) => drawFigure(element, figure)));
    onPrint((width) => drawn.forEach((figure, element) => {
      const share = element.closest(".two") ? 0.48 : 1;
      drawFigure(element, figure, width && Math.round(share * width));
    }));
    document.querySelectorAll("[data-figure]").forEach((element) => drawFigure(element, figures[element.dataset.figure]));
  }

  // src/pages/look.ts
  var BEFORE_S2 = 6;
  var TRAIL_S = 4;
  function showFirst(cases) {
    const place2 = document.getElementById("look");
    const item = cases[Number(place2?.dataset.index ?? -1)];
    if (!place2 || !item) return;
    const canvas = document.getElementById("look-road");
    const button = document.getElementById("look-play");
    const [end, last] = [crashFrame(item), item.frames - 1];
    const begin = Math.max(0, end - Math.round(BEFORE_S2 / item.dt));
    const view = frameFor(item, begin, end);
    let [frame, playing, before, colours] = [end, false, 0, readColours()];
    const draw = () => {
      const ghosts = item.wayOut && playing ? [{ motion: item.wayOut, colour: colours["way-out-box"], name: "way out" }] : [];
      drawScene(canvas, item, frame, { ...view, detail: true, trail: TRAIL_S, ghosts }, colours);
    };
    function step(now) {
      if (!playing) return;
      const passed = Math.max(0, now - before) / 1e3;
      before = now;
      const next = tick(frame, passed, item.dt, 1, { from: begin, to: last, loop: true });
      frame = next.frame;
      draw();
      requestAnimationFrame(step);
    }
    function toggle() {
      playing = !playing;
      button.querySelector("[aria-hidden]").textContent = playing ? "❚❚" : "▶";
      button.querySelector(".word").textContent = playing ? "Pause" : "Play";
      button.setAttribute("aria-label", button.getAttribute("aria-label").replace(/^\w+/, playing ? "Pause" : "Play"));
      if (playing) {
        if (frame >= end) frame = begin;
        before = performance.now();
        requestAnimationFrame(step);
      }
      draw();
    }
    const isSeen = () => {
      const { top, bottom } = canvas.getBoundingClientRect();
      return top < window.innerHeight && bottom > 0;
    };
    button.addEventListener("click", toggle);
    canvas.addEventListener("click", toggle);
    document.addEventListener("keydown", (event) => {
      if (event.key !== " " || event.target !== document.body || !isSeen()) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      toggle();
    });
    const redraw = () => {
      colours = readColours();
      draw();
    };
    dark.addEventListener("change", redraw);
    onPrint(redraw);
    new ResizeObserver(draw).observe(canvas);
    draw();
  }

  // src/pages/report.ts
  var chartFrame = -1;
  var lastFrame = (item) => item.frames - 1;
  var partnerOf = (item) => item.partner > 0 ? item.vehicles[item.partner] : null;
  function writeReadout(item, frame) {
    const av = boxAt(item.vehicles[0], frame);
    const partner = partnerOf(item);
    const bv = partner && boxAt(partner, frame);
    const k = decisionAt(item, frame);
    const critical = item.vehicles[item.critical[k] ?? -1];
    const p = item.p_nde[k] ?? null;
    const ttc = (value) => value === null ? "∞" : show(value, "s", 2);
    const cells = {
      frame: `${item.first + frame} of ${item.first + lastFrame(item)}`,
      time: show(secondsAt(item, frame), "s"),
      before: show(item.crash === null ? null : (item.crash - frame) * item.dt, "s"),
      av: show(av.v, "m/s"),
      bv: show(bv?.v, "m/s"),
      gap: show(bv && gapOf(item, av, bv), "m"),
      ttc: ttc(item.ttc[frame]),
      plane: ttc(item.ttcPlane[frame]),
      critical: critical && critical !== item.vehicles[0] ? `BV ${critical.slot}: ${item.action[k] || "–"}` : "–",
      p: p === null ? "–" : p === 0 ? "impossible" : String(p)
    };
    for (const [name, value] of Object.entries(cells)) byId(`read-${name}`).textContent = value;
  }
  function series(item, motion) {
    return { x: motion.v.map((_, i) => secondsAt(item, motion.from + i)), y: motion.v };
  }
  function speedRange(item) {
    const shown = [item.vehicles[0], partnerOf(item), item.wayOut];
    const speeds = shown.flatMap((motion) => motion?.v ?? []).filter((v) => v !== null);
    const [low, high] = [Math.min(...speeds), Math.max(...speeds)];
    const pad = Math.max(0.5, (6 - (high - low)) / 2);
    return [Math.max(-0.3, low - pad), high + pad];
  }
  function drawChart(item) {
    const range = [secondsAt(item, 0), secondsAt(item, lastFrame(item)) + 0.05 * item.frames * item.dt];
    const axis = { gridcolor: "css:grid", linecolor: "css:muted", zeroline: false };
    const data = [{ ...series(item, item.vehicles[0]), name: "speed of the AV", line: { color: "css:av", width: 2.5 } }];
    const partner = partnerOf(item);
    if (partner) {
      if (item.wayOut) {
        data.push({ ...series(item, item.wayOut), mode: "lines", name: "on its last way out", line: { color: "css:way-out", width: 2, dash: "dot" } });
      }
      data.push({ ...series(item, partner), name: `speed of BV ${partner.slot}`, line: { color: "css:partner", width: 2.5, dash: "dash" } });
      const x = item.ttcPlane.map((_, i) => secondsAt(item, i));
      if (item.ttc.length > 0) data.push({ x, y: item.ttc, yaxis: "y2", name: "time to collision in the lane", line: { color: "css:ink", width: 2.5 } });
      data.push({ x, y: item.ttcPlane, yaxis: "y2", name: "in the plane", line: { color: "css:plane", width: 2, dash: "dot" } });
    }
    const upright = { type: "line", yref: "paper", y0: 0, y1: 1 };
    const shapes = [{ ...upright, x0: range[0], x1: range[0], line: { color: "css:muted", width: 2 } }];
    const annotations = [];
    if (item.crash !== null) {
      const t = secondsAt(item, item.crash);
      shapes.push({ ...upright, x0: t, x1: t, line: { color: "css:contact", width: 2, dash: "dot" } });
      annotations.push({ x: t, xanchor: "right", xshift: -4, y: 0.52, yanchor: "top", yref: "paper", text: "crash", showarrow: false, font: { color: "css:contact" } });
    }
    const layout = {
      height: byId("case-chart").clientWidth < 480 ? 380 : 300,
      margin: { l: 56, r: 12, t: 30, b: 40 },
      hovermode: "x",
      dragmode: false,
      shapes,
      annotations,
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: "system-ui, sans-serif", size: 12, color: "css:ink" },
      hoverlabel: { bgcolor: "css:paper", font: { color: "css:ink" } },
      legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" },
      xaxis: { ...axis, title: { text: "time since the drive began [s]" }, range, anchor: "y2" },
      yaxis: { ...axis, title: { text: "m/s" }, domain: [0.52, 1], range: speedRange(item) },
      yaxis2: { ...axis, title: { text: "s" }, domain: [0, 0.42], range: [0, 10] }
    };
    chartFrame = -1;
    drawFigure(byId("case-chart"), { data, layout });
  }
  function moveCursor(item, frame) {
    if (frame === chartFrame) return;
    chartFrame = frame;
    const t = secondsAt(item, frame);
    changeLayout(byId("case-chart"), { "shapes[0].x0": t, "shapes[0].x1": t });
  }
  function playCases(cases) {
    const road = byId("road");
    const player = makePlayer({
      cases,
      draw: (item, frame, metres, colours) => {
        const ghosts = item.wayOut ? [{ motion: item.wayOut, colour: colours["way-out-box"], name: "way out" }] : [];
        fitHeight(road, item, metres);
        drawScene(road, item, frame, { metres, detail: true, ghosts }, colours);
      },
      chosen: (item) => {
        byId("case-role").textContent = `Case ${item.id}: ${item.role}.`;
        byId("key-critical").hidden = item.critical.every((index) => index <= 0);
        drawChart(item);
      },
      moved: (item, frame) => {
        writeReadout(item, frame);
        moveCursor(item, frame);
      },
      thumbnail: (item) => item
    });
    player.start(Math.max(0, cases.findIndex((item) => item.watchFirst)));
    document.querySelector('[data-figure="map"]').on("plotly_click", (event) => {
      const id = event.points[0].customdata;
      byId("map-note").textContent = player.selectId(id) ? "" : `Case ${id} is not among those on this page; play it with: cornerforge replay LIBRARY ${id}`;
    });
    byId("case-chart").on("plotly_click", (event) => {
      player.seek(Math.round(event.points[0].x / player.current().dt) - player.current().first);
    });
  }
  function startReport() {
    drawFigures(pageData("figures"));
    const cases = pageData("cases");
    showFirst(cases);
    if (cases.length > 0) playCases(cases);
  }

  // src/pages/pages.ts
  if (document.getElementById("figures")) startReport();
  else if (document.getElementById("look")) showFirst(pageData("cases"));
  else startComparison();
})();
