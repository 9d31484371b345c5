// Draws a moment of a recording from above, to scale. Between two recorded frames the picture is interpolated.
import type { Case, Motion, Vehicle } from "./case";
import type { Colours } from "./colours";
import { middleOf } from "./framing";
import { type Rect, place } from "./labels";
import { type Box, type Point, boxAt, changesTo, criticalAt, gapAlong, touch } from "./motion";
import { drawSite } from "./site";
import { MARKS, outlines, strokes, surfaceOf } from "./surface";
import { brakes, trail } from "./trails";

/** A vehicle that was not there: where the AV would be had it acted otherwise. */
export interface Ghost {
  readonly motion: Motion;
  readonly colour: string;
  readonly name: string;
}

const [UNSEEN, MISPLACED] = [0.3, 0.25]; // how faint what the AV does not see is; what it sees so far off is shown [m]

export interface Look {
  /** Width of the picture [m]. */
  readonly metres: number;
  /** With names, arrows, ghosts and a ruler; small pictures go without. */
  readonly detail: boolean;
  /** How long the trails are [s]. */
  readonly trail?: number;
  readonly ghosts?: readonly Ghost[];
  /** How far the picture's middle is ahead of the AV [m]. */
  readonly ahead?: number;
}

interface View {
  readonly scale: number;
  readonly width: number;
  readonly height: number;
  readonly left: number;
  readonly right: number;
  px(x: number): number;
  py(y: number): number;
}

type Pen = CanvasRenderingContext2D;

function prepare(canvas: HTMLCanvasElement): { g: Pen; width: number; height: number } {
  const pixels = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const [wide, high] = [Math.round(width * pixels), Math.round(height * pixels)];
  if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
  const g = canvas.getContext("2d", { alpha: false })!;
  g.setTransform(pixels, 0, 0, pixels, 0, 0);
  return { g, width, height };
}

/** Map of metres to pixels at a site, to the north upwards; at least half of `metres` are seen from south to north. */
function makeSiteView(item: Case, av: Box, aside: number, width: number, height: number, metres: number): View {
  const scale = Math.min(width / metres, height / (0.5 * metres));
  const [middle, centre] = middleOf(item, av, width / scale, height / scale);
  return {
    scale, width, height,
    left: middle + aside - width / 2 / scale, right: middle + aside + width / 2 / scale,
    px: (x) => (x - middle - aside) * scale + width / 2,
    py: (y) => height / 2 - (y - centre) * scale,
  };
}

/** Map of metres to pixels: x to the right, y to the left of the driver, so upwards. */
function makeView(item: Case, middle: number, width: number, height: number, metres: number): View {
  const scale = Math.min(width / metres, (height - 4) / (item.lanes * item.laneWidth + 0.6));
  const centre = (item.lanes * item.laneWidth) / 2;
  return {
    scale,
    width,
    height,
    left: middle - width / 2 / scale,
    right: middle + width / 2 / scale,
    px: (x) => (x - middle) * scale + width / 2,
    py: (y) => height / 2 - (y - centre) * scale,
  };
}

function drawRoad(g: Pen, view: View, item: Case, frame: number, colours: Colours, detail: boolean): void {
  g.fillStyle = colours.verge;
  g.fillRect(0, 0, view.width, view.height);
  if (item.site) {
    drawSite(g, view, item.site, frame, colours);
    if (detail) drawNorth(g, view, colours);
    return;
  }
  const surface = surfaceOf(item);
  g.fillStyle = colours.road;
  g.beginPath(); // one path, so that no seams show
  for (const corners of outlines(surface, view.left, view.right, 0.3)) {
    corners.forEach(([x, y], i) => (i === 0 ? g.moveTo(view.px(x), view.py(y)) : g.lineTo(view.px(x), view.py(y))));
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

/** A length of 10 m, and where north is. */
function drawNorth(g: Pen, view: View, colours: Colours): void {
  const [x, y, long] = [view.width - 14, view.height - 12, 10 * view.scale];
  g.fillStyle = colours.ink;
  g.fillRect(x - long, y, long, 2);
  g.font = "11px system-ui, sans-serif";
  g.textAlign = "right";
  g.fillText("10 m", x, y - 5);
  g.textAlign = "center";
  g.fillText("N", x - 4, y - 40);
  g.beginPath();
  for (const [right, up] of [[0, 36], [-4, 22], [4, 22]] as const) g.lineTo(x - 4 + right, y - up);
  g.fill();
}

function drawRuler(g: Pen, view: View, y: number, colours: Colours): void {
  g.fillStyle = colours.muted;
  g.font = "11px system-ui, sans-serif";
  g.textAlign = "center";
  const every = 20 * view.scale > 60 ? 20 : 40;
  for (let x = Math.ceil(view.left / 10) * 10; x < view.right; x += 10) {
    g.fillRect(view.px(x), y, 1, 5);
    if (x % every === 0) g.fillText(`${x} m`.replace("-", "−"), view.px(x), y + 16);
  }
}

/** Draw with the origin in the middle of a box and its front to the right. */
function within(g: Pen, view: View, box: Box, draw: (length: number, width: number) => void): void {
  g.save();
  g.translate(view.px(box.x), view.py(box.y));
  g.rotate(-box.h);
  draw(box.length * view.scale, box.width * view.scale);
  g.restore();
}

interface Paint {
  readonly fill: string;
  readonly outline: string | null;
  readonly kind: string;
  readonly isBraking: boolean;
}

function drawVehicle(g: Pen, view: View, box: Box, { fill, outline, kind, isBraking }: Paint): void {
  within(g, view, box, (length, width) => {
    g.fillStyle = fill;
    if (kind === "person") {
      drawPerson(g, Math.max(3.5, 0.75 * length), outline);
      return;
    }
    g.fillRect(-length / 2, -width / 2, length, width);
    g.fillStyle = "rgba(255,255,255,0.55)"; // the windscreen shows which end is the front
    // A truck's cab is at its nose; a car has a bonnet before it.
    const [behindNose, deep] = kind === "truck" ? [0.9 * view.scale, 0.7 * view.scale] : [0.38 * length, 0.13 * length];
    g.fillRect(length / 2 - behindNose, -0.36 * width, deep, 0.72 * width);
    if (kind === "truck" && length > 20) {
      g.fillStyle = "rgba(0,0,0,0.35)"; // between cab and load
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

/** A dot that points ahead, and larger than a body, which would hardly be seen. */
function drawPerson(g: Pen, radius: number, outline: string | null): void {
  g.beginPath();
  g.arc(0, 0, radius, 0.6, 2 * Math.PI - 0.6);
  g.lineTo(1.7 * radius, 0);
  g.closePath();
  g.fill();
  g.strokeStyle = outline ?? "rgba(0,0,0,0.7)";
  g.lineWidth = outline ? 2 : 1;
  g.stroke();
}

/** An outline, since it is not what happened; its front is open. */
function drawGhost(g: Pen, view: View, box: Box, colour: string): void {
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

/** Where the AV saw a vehicle: null where it did not, undefined where it sees what there is. */
function seenAt({ seenX, seenY, ...motion }: Vehicle, frame: number): Box | null | undefined {
  return seenX && seenY ? boxAt({ ...motion, x: seenX, y: seenY }, frame) : undefined;
}

/** Where a vehicle was: a line that fades, with a dot each full second. */
function drawTrail(g: Pen, view: View, motion: Motion, frame: number, seconds: number, dt: number, colour: string): void {
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

/** An arrow from the nose to the lane that the vehicle changes to; none while it keeps its lane. */
function drawTarget(g: Pen, view: View, item: Case, box: Box, colour: string): void {
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

function drawContact(g: Pen, view: View, a: Box, b: Box, colours: Colours): void {
  const { area, middle } = touch(a, b);
  g.fillStyle = g.strokeStyle = colours.contact;
  g.beginPath();
  area.forEach(([x, y]: Point) => g.lineTo(view.px(x), view.py(y)));
  g.fill();
  const width = view.scale > 6 ? 2.5 : 1.5;
  g.beginPath();
  g.arc(view.px(middle[0]), view.py(middle[1]), Math.max(6, 1.7 * view.scale), 0, 2 * Math.PI);
  if (view.scale > 6) {
    g.strokeStyle = colours.paint; // a light rim keeps the ring clear of vehicles of any colour
    g.lineWidth = 2 * width;
    g.stroke();
  }
  g.strokeStyle = colours.contact;
  g.lineWidth = width;
  g.stroke();
}

function colourOf(item: Case, index: number, critical: number, colours: Colours): string {
  if (index === 0) return colours.av;
  if (index === item.partner) return colours.partner;
  if (index === critical) return colours.critical;
  return item.vehicles[index]!.kind === "person" ? colours.person : colours.other;
}

/** Half sizes of the picture of a box, turned as it is [px]. */
function around(view: View, box: Box): Rect {
  const [c, s] = [Math.abs(Math.cos(box.h)), Math.abs(Math.sin(box.h))];
  const w = ((c * box.length + s * box.width) / 2) * view.scale;
  const h = ((s * box.length + c * box.width) / 2) * view.scale;
  return { x: view.px(box.x), y: view.py(box.y), w, h };
}

interface Name {
  readonly text: string;
  readonly box: Box;
  readonly below: boolean;
  readonly strong: boolean;
  /** Of the line under the name; null: none. */
  readonly colour: string | null;
}

/** Write names where they hide no vehicle and no other name; a plate keeps them clear of lane markings. */
function drawNames(g: Pen, view: View, names: readonly Name[], boxes: readonly Box[], colours: Colours): void {
  const font = (strong: boolean) => `${strong ? "600 13px" : "11px"} system-ui, sans-serif`;
  const wishes = names.map(({ text, box, below, strong }) => {
    g.font = font(strong);
    return { box: around(view, box), w: g.measureText(text).width / 2 + 4, h: strong ? 9 : 7, below, must: strong };
  });
  const places = place(wishes, boxes.map((box) => around(view, box)), view);
  g.textAlign = "center";
  g.textBaseline = "middle";
  names.forEach(({ text, strong, colour }, i) => {
    const [at, wish] = [places[i], wishes[i]!];
    if (!at) return;
    const gap = Math.abs(at.y - wish.box.y) - at.h - wish.box.h;
    if (gap > 6 || (Math.abs(at.x - wish.box.x) > 1 && Math.abs(at.y - wish.box.y) > at.h)) {
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

function nameOf(item: Case, index: number, box: Box, isBrief: boolean): string {
  const vehicle = item.vehicles[index]!;
  const isOfPair = index === 0 || index === item.partner;
  const kind = vehicle.kind === "car" ? "" : vehicle.kind;
  const speed = box.v.toFixed(1);
  if (!isOfPair) return kind ? `${kind} ${speed}` : speed;
  const name = index === 0 ? "AV" : vehicle.kind === "person" ? `person ${vehicle.slot}` : `BV ${vehicle.slot}${kind ? `, ${kind},` : ""}`;
  return isBrief ? name.replace(/,$/, "") : `${name} ${speed} m/s`;
}

/** Draw a moment on a canvas, whose size on the page is kept. */
export function drawScene(canvas: HTMLCanvasElement, item: Case, frame: number, look: Look, colours: Colours): void {
  const av = boxAt(item.vehicles[0]!, frame);
  const { g, width, height } = prepare(canvas);
  if (width === 0 || !av) return;
  const aside = look.ahead ?? 0;
  const view = item.site ? makeSiteView(item, av, aside, width, height, look.metres) : makeView(item, av.x + aside, width, height, look.metres);
  const critical = criticalAt(item, frame);
  drawRoad(g, view, item, frame, colours, look.detail);
  const boxes = item.vehicles.map((vehicle) => boxAt(vehicle, frame));
  const partner = item.partner > 0 ? (boxes[item.partner] ?? null) : null;
  const isOfPair = (i: number) => i === 0 || i === item.partner;
  const isSeen = ({ x, y, length }: Box) =>
    x + length / 2 > view.left && x - length / 2 < view.right && view.py(y - length / 2) > 0 && view.py(y + length / 2) < view.height;
  const others = boxes.map((_, i) => i).filter((i) => boxes[i] && !isOfPair(i) && isSeen(boxes[i]));
  // The AV and its partner are drawn last, so that nothing hides them.
  const order = [...others, ...(partner ? [item.partner] : []), 0];
  const colour = (i: number) => colourOf(item, i, critical, colours);
  if (look.trail) for (const i of order) drawTrail(g, view, item.vehicles[i]!, frame, look.trail, item.dt, colour(i));
  for (const i of order) {
    const box = boxes[i]!;
    if (look.detail) drawTarget(g, view, item, box, isOfPair(i) ? colours.paint : colour(i));
    const outline = i === critical ? colours.ink : i === 0 && look.detail ? colours.paint : null;
    const isBraking = look.detail && brakes(item.vehicles[i]!, frame, item.dt);
    const seen = seenAt(item.vehicles[i]!, frame);
    g.globalAlpha = seen === null ? UNSEEN : 1;
    drawVehicle(g, view, box, { fill: colour(i), outline, kind: item.vehicles[i]!.kind, isBraking });
    g.globalAlpha = 1;
    if (look.detail && seen && Math.hypot(seen.x - box.x, seen.y - box.y) > MISPLACED) drawGhost(g, view, seen, colours.av);
  }
  const shades = look.detail ? (look.ghosts ?? []).map((ghost) => ({ ...ghost, box: boxAt(ghost.motion, frame) })) : [];
  for (const { box, colour: shade } of shades) if (box) drawGhost(g, view, box, shade);
  if (item.crash !== null && frame >= item.crash && partner) drawContact(g, view, av, partner, colours);
  if (!look.detail) return;
  const isBrief = view.scale <= 5;
  const saw = (i: number) => (seenAt(item.vehicles[i]!, frame) === null ? (item.lineOfSight ? ", hidden" : ", not seen") : "");
  // The two that meet carry their names on the sides turned away from each other.
  const below = (i: number) => (partner !== null && isOfPair(i) ? (i === 0) === av.y < partner.y : false);
  const named = [0, ...(partner && isSeen(partner) ? [item.partner] : []), ...(isBrief ? [] : others)];
  const names: Name[] = named.map((i) => ({
    text: nameOf(item, i, boxes[i]!, isBrief) + saw(i), box: boxes[i]!, below: below(i), strong: isOfPair(i), colour: isOfPair(i) ? colour(i) : null,
  }));
  for (const { box, colour: shade, name } of shades) {
    if (box) names.push({ text: name, box, below: !below(0), strong: false, colour: shade });
  }
  const solid = [...order.map((i) => boxes[i]!), ...shades.map(({ box }) => box).filter((box) => box !== null)];
  drawNames(g, view, names, solid, colours);
  if (partner && !item.site && !isSeen(partner)) drawPointer(g, view, `BV ${item.vehicles[item.partner]!.slot}`, av, partner, view.py(item.lanes * item.laneWidth + 0.3), colours);
}

/** At the edge of the picture, beside the road, where it hides nobody: where the partner is that the picture does not show. */
function drawPointer(g: Pen, view: View, name: string, av: Box, partner: Box, top: number, colours: Colours): void {
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

/** Height of a picture [px] so that it shows the metres that it promises: the road's width follows from the scale. */
export function heightFor(item: Case, width: number, metres: number): number {
  const scale = width / metres;
  if (item.site) return Math.round(Math.min(720, Math.max(260, 0.6 * width)));
  return Math.round(Math.min(720, Math.max(150, scale * (item.lanes * item.laneWidth + 0.6) + 70)));
}

/** Give a canvas that height. */
export function fitHeight(canvas: HTMLCanvasElement, item: Case, metres: number): void {
  const height = heightFor(item, canvas.clientWidth, metres);
  if (canvas.clientHeight !== height) canvas.style.height = `${height}px`;
}
