// Draws the surface of a junction, and says what its lights show.
import type { Light, Outline, Site } from "./case";
import type { Colours } from "./colours";

/** The letter of a light at a frame. */
export function letterAt({ from, letters }: Light, frame: number): string {
  let shown = 0;
  while (shown + 1 < from.length && from[shown + 1]! <= frame + 1e-6) shown += 1;
  return letters[shown] ?? "r";
}

export const lightColour = (letter: string, colours: Colours): string =>
  letter === "r" ? colours["signal-red"] : letter === "y" ? colours["signal-amber"] : colours["signal-green"];

interface View {
  readonly scale: number;
  px(x: number): number;
  py(y: number): number;
}

/** Widths of what is painted [m]. */
export const WIDE = { edge: 0.12, stop: 0.4, light: 0.7 } as const;

function follow(g: CanvasRenderingContext2D, view: View, line: Outline): void {
  for (let i = 0; i < line.length; i += 2) {
    const [x, y] = [view.px(line[i]!), view.py(line[i + 1]!)];
    i === 0 ? g.moveTo(x, y) : g.lineTo(x, y);
  }
}

function strokeAll(g: CanvasRenderingContext2D, view: View, lines: readonly Outline[], colour: string, wide: number): void {
  g.strokeStyle = colour;
  g.lineWidth = Math.max(1, wide * view.scale);
  g.beginPath();
  for (const line of lines) follow(g, view, line);
  g.stroke();
}

/** Draw lanes with their edges, crosswalks, stop lines, and what the lights show at a frame. */
export function drawSite(g: CanvasRenderingContext2D, view: View, site: Site, frame: number, colours: Colours): void {
  g.fillStyle = g.strokeStyle = colours.road;
  g.lineWidth = 1.2 * view.scale; // shoulders
  g.beginPath(); // one path, so that no seams show
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
