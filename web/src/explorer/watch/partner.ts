import type { Case } from "../../shared/case";

/**
 * The same test driven by another AV, with the vehicle that the first AV touched marked as its partner too, so that both
 * pictures and curves tell of the same vehicle. A crash of two other vehicles is none of the AV's.
 */
export function withPartner(item: Case, first: Case): Case {
  const slot = first.partner > 0 ? first.vehicles[first.partner]!.slot : null;
  if (item.partner > 0 || slot === null) return item;
  return { ...item, crash: null, partner: item.vehicles.findIndex((vehicle, index) => index > 0 && vehicle.slot === slot) };
}
