// What the recent motion of a vehicle tells: where it was, and whether it brakes. Pure functions of a recording.
import type { Motion } from "./case";
import { boxAt, valueAt } from "./motion";

/** Where a vehicle was, `age` seconds ago. */
export interface Past {
  readonly x: number;
  readonly y: number;
  readonly age: number;
}

/** Where a vehicle was in the last `seconds`, newest first, every 0.1 s; it ends where nothing was recorded. */
export function trail(motion: Motion, frame: number, seconds: number, dt: number): Past[] {
  const points: Past[] = [];
  for (let back = 0; back <= Math.round(seconds / dt); back++) {
    const box = boxAt(motion, frame - back);
    if (!box) break;
    points.push({ x: box.x, y: box.y, age: back * dt });
  }
  return points;
}

/**
 * Acceleration along the road [m/s2] over the 0.2 s around a frame, at an end of the recording over 0.1 s; null where
 * nothing, or only this frame, was recorded.
 */
export function accelerationAt(motion: Motion, frame: number, dt: number): number | null {
  const now = valueAt(motion, "v", frame);
  if (now === null) return null;
  const [before, after] = [valueAt(motion, "v", frame - 1), valueAt(motion, "v", frame + 1)];
  if (before === null && after === null) return null;
  const span = (before === null ? 0 : 1) + (after === null ? 0 : 1);
  return ((after ?? now) - (before ?? now)) / (span * dt);
}

/** Weakest braking that a picture shows [m/s2]. */
export const BRAKES_FROM = 1;

/** Whether a vehicle brakes with more than `BRAKES_FROM`, by its speed now and 0.1 s before. */
export function brakes(motion: Motion, frame: number, dt: number): boolean {
  const [now, before] = [valueAt(motion, "v", frame), valueAt(motion, "v", frame - 1)];
  return now !== null && before !== null && (before - now) / dt > BRAKES_FROM;
}
