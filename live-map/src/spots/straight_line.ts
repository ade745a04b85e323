/** The nearest free spots as the crow flies, for services that know no streets. */

import { distanceM, type LonLat } from "../geometry/plane";
import type { Mode, NearSpot } from "../service/client";
import type { Spot } from "./spot";

const SPEED_MPS: Record<Mode, number> = { walking: 1.35, driving: 5.5 };

export function nearestByAir(spots: Iterable<Spot>, from: LonLat, mode: Mode, limit = 5): NearSpot[] {
  return Array.from(spots)
    .filter((spot) => spot.state === "vacant")
    .map((spot) => ({ spot, distance: distanceM(from, spot.centre) }))
    .sort((a, b) => a.distance - b.distance)
    .slice(0, limit)
    .map(({ spot, distance }) => ({
      spotId: spot.id,
      lonLat: spot.centre,
      distanceM: distance,
      durationS: distance / SPEED_MPS[mode],
      probability: spot.probability,
      onArrival: spot.probability,
      observedAt: spot.observedAt,
      route: { type: "LineString", coordinates: [from, spot.centre] },
      routed: false,
    }));
}
