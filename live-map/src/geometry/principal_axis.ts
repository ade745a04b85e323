import { centroid, type LonLat, Plane } from "./plane";

/** How much longer than wide points must lie to have an axis. */
const ELONGATED = 2.5;

/** The compass direction (-90..90 degrees) along which points lie, or null if they lie all around. */
export function principalAxis(points: readonly LonLat[]): number | null {
  if (points.length < 3) return null;
  const plane = new Plane(centroid(points));
  let [ee, nn, en] = [0, 0, 0];
  for (const point of points) {
    const [east, north] = plane.toMetres(point);
    ee += east * east;
    nn += north * north;
    en += east * north;
  }
  const mean = (ee + nn) / 2;
  const spread = Math.hypot((ee - nn) / 2, en);
  const ratio = Math.sqrt((mean + spread) / Math.max(mean - spread, 1e-9));
  if (ratio < ELONGATED) return null;
  const angle = (Math.atan2(2 * en, nn - ee) / 2) * (180 / Math.PI);
  return angle;
}
