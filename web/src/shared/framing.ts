// What a picture of a case shows of the road.
import type { Case } from "./case";
import { clamp } from "./clock";
import { type Box, type Point, boxAt, crashFrame, touch, valueAt } from "./motion";

/** Width of the picture, at least and at most, and the room beside the two vehicles [m]. */
const [LEAST_M, MOST_M, ROOM_M] = [46, 110, 22];

/** How wide the picture is and how far its middle is ahead of the AV, so that both vehicles are always in it [m]. */
export function frameFor(item: Case, begin: number, end: number): { metres: number; ahead: number } {
  const partner = item.vehicles[item.partner];
  let [low, high] = [0, 0];
  for (let frame = begin; partner && frame <= end; frame++) {
    const [av, other] = [valueAt(item.vehicles[0]!, "x", frame), valueAt(partner, "x", frame)];
    if (av === null || other === null) continue;
    [low, high] = [Math.min(low, other - av), Math.max(high, other - av)];
  }
  if (item.site) return { metres: LEAST_M, ahead: 0 };
  return { metres: clamp(high - low + ROOM_M, LEAST_M, MOST_M), ahead: (low + high) / 2 };
}

/**
 * Middle of a picture of a site: it stands still where the two meet (without contact where the AV is at last), so that the
 * map does not move, and follows the AV only as far as the AV would leave it.
 *
 * @param wide, high how far the picture reaches [m]
 */
export function middleOf(item: Case, av: Box, wide: number, high: number): Point {
  const end = crashFrame(item);
  const [last, partner] = [boxAt(item.vehicles[0]!, end) ?? av, item.partner > 0 ? boxAt(item.vehicles[item.partner]!, end) : null];
  const [x, y] = partner ? touch(last, partner).middle : [last.x, last.y];
  return [clamp(x, av.x - 0.4 * wide, av.x + 0.4 * wide), clamp(y, av.y - 0.4 * high, av.y + 0.4 * high)];
}
