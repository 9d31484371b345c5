// Where the camera of the 3-D view stands. Pure; metres, from what it looks at: x along the road (at a site to where the AV heads), y to the left, z up.
import type { Case } from "../../shared/case";
import { boxAt, crashFrame } from "../../shared/motion";

export type Eye = readonly [number, number, number];

const [NEAREST, FARTHEST] = [5, 140];

/** The camera nearer (factor below 1) or farther, within what the view allows. */
export function scaled([x, y, z]: Eye, factor: number): Eye {
  const far = Math.hypot(x, y, z);
  const f = Math.max(NEAREST, Math.min(FARTHEST, far * factor)) / far;
  return [x * f, y * f, z * f];
}

/** The eye turned about the vertical by an angle [rad]. */
export const turned = ([x, y, z]: Eye, angle: number): Eye =>
  [x * Math.cos(angle) - y * Math.sin(angle), x * Math.sin(angle) + y * Math.cos(angle), z];

/** Places to look from, each above the AV's roof: behind it, ahead of it and looking back, on its right. */
export const PLACES = { behind: [-19, 0, 7.5], ahead: [19, 0, 7.5], beside: [-4, -22, 8] } as const satisfies Record<string, Eye>;
export type Place = keyof typeof PLACES;

/** Where a case is best seen from: from the side if the crash comes from behind the AV, else from behind it. */
export function bestPlace(item: Case | undefined): Place {
  const frame = item ? Math.max(0, crashFrame(item) - 20) : 0;
  const partner = item && item.partner > 0 ? boxAt(item.vehicles[item.partner]!, frame) : null;
  const av = item ? boxAt(item.vehicles[0]!, frame) : null;
  const ahead = av && partner ? (partner.x - av.x) * Math.cos(av.h) + (partner.y - av.y) * Math.sin(av.h) : 0;
  return ahead < -6 ? "beside" : "behind";
}
