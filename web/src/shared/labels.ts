// Where the names of vehicles stand in a picture: beside their vehicle, never over a vehicle or another name.

/** Rectangle in pixels by its middle and its half sizes. */
export interface Rect {
  readonly x: number;
  readonly y: number;
  readonly w: number;
  readonly h: number;
}

export interface Wish {
  /** The vehicle, and the half size of its name. */
  readonly box: Rect;
  readonly w: number;
  readonly h: number;
  /** Below rather than above, if there is room on both sides. */
  readonly below: boolean;
  /** A name that must stand somewhere, if need be farther off. */
  readonly must: boolean;
}

const meet = (a: Rect, b: Rect): boolean => Math.abs(a.x - b.x) < a.w + b.w && Math.abs(a.y - b.y) < a.h + b.h;

/**
 * Places of names, in the order of the wishes (the first chooses first); null: no room.
 *
 * @param wishes names to place
 * @param obstacles what no name may cover
 * @param size of the picture [px]
 */
export function place(wishes: readonly Wish[], obstacles: readonly Rect[], size: { width: number; height: number }): (Rect | null)[] {
  const taken = [...obstacles];
  return wishes.map((wish) => {
    const found = candidates(wish).find((rect) => isInside(rect, size) && !taken.some((other) => meet(rect, other)));
    if (found) taken.push(found);
    return found ?? null;
  });
}

const isInside = (rect: Rect, { width, height }: { width: number; height: number }): boolean =>
  rect.x - rect.w >= 0 && rect.x + rect.w <= width && rect.y - rect.h >= 0 && rect.y + rect.h <= height;

/** Places by preference: on the wished side, on the other, in front, behind; for a name that must stand, ever farther off. */
function candidates({ box, w, h, below, must }: Wish): Rect[] {
  const at = (x: number, y: number): Rect => ({ x, y, w, h });
  const up = below ? 1 : -1;
  const off = box.h + h + 2;
  const near = [at(box.x, box.y + up * off), at(box.x, box.y - up * off), at(box.x + box.w + w + 3, box.y), at(box.x - box.w - w - 3, box.y)];
  if (!must) return near;
  const far = [1, 2, 3, 4, 5, 6, 8, 10].flatMap((n) =>
    [up, -up].flatMap((side) => [0, 1, -1].map((aside) => at(box.x + aside * (box.w + w), box.y + side * (off + n * h)))),
  );
  return [...near, ...far];
}
