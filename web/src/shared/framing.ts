// What a picture of a case shows of the road.
import type { Case } from "./case";
import { clamp } from "./clock";
import { valueAt } from "./motion";

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
  return { metres: clamp(high - low + ROOM_M, LEAST_M, MOST_M), ahead: (low + high) / 2 };
}
