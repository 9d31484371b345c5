// Time of a playback, in frames. Pure: who calls says how much time has passed.

/** The stretch that is played, in frames, both ends included; with `loop` it begins anew at its end. */
export interface Stretch {
  readonly from: number;
  readonly to: number;
  readonly loop: boolean;
}

export interface Tick {
  readonly frame: number;
  /** The end was reached, so the clock stops. */
  readonly over: boolean;
}

/** How long the last picture stays before a loop begins anew [s]. */
export const PAUSE_S = 0.8;

/**
 * The frame after some time has passed.
 *
 * @param frame where the clock stands; beyond `to` while a loop pauses at its end
 * @param passed seconds of real time, not negative
 * @param dt seconds between two frames
 * @param rate seconds of the recording a second of real time
 */
export function tick(frame: number, passed: number, dt: number, rate: number, { from, to, loop }: Stretch): Tick {
  const next = frame + (Math.max(0, passed) / dt) * rate;
  if (!loop) return next >= to ? { frame: to, over: true } : { frame: next, over: false };
  const pause = (PAUSE_S / dt) * rate;
  return { frame: next >= to + pause ? from : next, over: false };
}

/** The recorded frame that a paused picture shows. */
export const whole = (frame: number): number => Math.floor(frame + 1e-6);

export const clamp = (value: number, low: number, high: number): number => Math.max(low, Math.min(high, value));
