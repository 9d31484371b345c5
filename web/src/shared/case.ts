// A recorded case, as `cornerforge.report.cases.case_data` writes it. Metres, seconds, radians; y to the left.

export type Kind = "car" | "truck" | "motorcycle" | "person";

/** How a line on the road looks; a hatch fills the rectangle of which it is the diagonal. */
export type Mark = "solid" | "broken" | "wide" | "barrier" | "hatch";

/** The motion of one vehicle, every 0.1 s. Its lists begin at frame `from`; a null is a frame that was not recorded. */
export interface Motion {
  readonly length: number;
  readonly width: number;
  readonly from: number;
  readonly x: readonly (number | null)[];
  readonly y: readonly (number | null)[];
  readonly v: readonly (number | null)[];
  readonly h: readonly (number | null)[];
  /** Lane kept or changed to; -1 where it is not known. */
  readonly lane: readonly number[];
}

export interface Vehicle extends Motion {
  readonly slot: number;
  readonly kind: Kind;
  /** Where the AV saw it; null: it did not, or (`lineOfSight`) a vehicle hid it. Absent where the AV sees all there is. */
  readonly seenX?: readonly (number | null)[];
  readonly seenY?: readonly (number | null)[];
}

/** A line or the outline of a shape: x, y, x, y, ... */
export type Outline = readonly number[];

/** A light shows `letters[i]` (G, g: green; y: amber; r: red; of people G: Walk) from frame `from[i]` on. */
export interface Light {
  readonly at: Outline;
  readonly walks: boolean;
  readonly from: readonly number[];
  readonly letters: string;
}

/** The surface of a junction, x to the east and y to the north. */
export interface Site {
  readonly lanes: readonly Outline[];
  readonly edges: readonly Outline[];
  /** Of crosswalks. */
  readonly bars: readonly Outline[];
  readonly stops: readonly Outline[];
  readonly lights: readonly Light[];
}

/** What happened from frame 0 on, which is `first` frames after the test began. `vehicles[0]` is the AV. */
export interface Case {
  readonly id: string;
  /** Seconds between two frames. */
  readonly dt: number;
  readonly first: number;
  readonly frames: number;
  readonly lanes: number;
  readonly laneWidth: number;
  /** Asphalt and lines of a road whose lanes do not all go on; a null is where one goes on. */
  readonly surface?: {
    readonly areas: readonly (readonly [begin: number | null, end: number | null, right: number, left: number, rightEnd: number, leftEnd: number])[];
    readonly lines: readonly (readonly [begin: number | null, y: number, end: number | null, yEnd: number, mark: Mark])[];
  };
  /** The junction, instead of a road. */
  readonly site?: Site;
  /** The AV is told all; `seenX` and `seenY` say what no vehicle hides from it. */
  readonly lineOfSight?: boolean;
  readonly maxSpeed: number;
  readonly vehicles: readonly Vehicle[];
  /** The AV on its last way out. */
  readonly wayOut: Motion | null;
  /** At each decision (every 10 frames of the test) the critical BV's index into `vehicles`, -1: none. */
  readonly critical: readonly number[];
  readonly action: readonly string[];
  /** Natural probability of the action; null: no critical BV. */
  readonly p_nde: readonly (number | null)[];
  /** Frame of the first contact; null: none. */
  readonly crash: number | null;
  /** Index of the vehicle that the AV touches first; -1: none. */
  readonly partner: number;
  /** Time to collision with the partner at each frame [s], in the lane and in the plane; null: infinite. */
  readonly ttc: readonly (number | null)[];
  readonly ttcPlane: readonly (number | null)[];
}
