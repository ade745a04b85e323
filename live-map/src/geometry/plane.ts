/** Small-area geometry: metres east and north of a point, and rectangles in them. */

export type LonLat = [number, number];
export type Metres = [number, number];

const EARTH_RADIUS_M = 6_378_137;
const RADIANS = Math.PI / 180;

/** The plane that touches the Earth at a point; good to a centimetre over some hundred metres. */
export class Plane {
  private readonly perLon: number;
  private readonly perLat: number;

  constructor(readonly origin: LonLat) {
    // Radii of curvature of the WGS84 ellipsoid, along the parallel and along the meridian.
    const e2 = 0.00669437999014;
    const sine = Math.sin(origin[1] * RADIANS);
    const w2 = 1 - e2 * sine * sine;
    this.perLon = RADIANS * Math.cos(origin[1] * RADIANS) * (EARTH_RADIUS_M / Math.sqrt(w2));
    this.perLat = RADIANS * ((EARTH_RADIUS_M * (1 - e2)) / w2 ** 1.5);
  }

  toMetres([lon, lat]: LonLat): Metres {
    return [(lon - this.origin[0]) * this.perLon, (lat - this.origin[1]) * this.perLat];
  }

  toLonLat([east, north]: Metres): LonLat {
    return [this.origin[0] + east / this.perLon, this.origin[1] + north / this.perLat];
  }
}

/** Distance in metres of two points that are near each other. */
export function distanceM(from: LonLat, to: LonLat): number {
  return Math.hypot(...new Plane(from).toMetres(to));
}

/** Corners of a rectangle; the heading is that of its length, degrees clockwise from north. */
export function rectangle(centre: LonLat, lengthM: number, widthM: number, headingDeg: number): LonLat[] {
  const plane = new Plane(centre);
  const [sine, cosine] = [Math.sin(headingDeg * RADIANS), Math.cos(headingDeg * RADIANS)];
  const corners: Metres[] = [
    [1, 1],
    [1, -1],
    [-1, -1],
    [-1, 1],
  ];
  return corners.map(([forward, aside]) => {
    const [along, across] = [(forward * lengthM) / 2, (aside * widthM) / 2];
    return plane.toLonLat([along * sine + across * cosine, along * cosine - across * sine]);
  });
}

export interface RectangleShape {
  centre: LonLat;
  lengthM: number;
  widthM: number;
  /** 0..180: a spot has no front. */
  headingDeg: number;
}

/** Length, width and heading of four corners that are nearly a rectangle. */
export function shapeOf(corners: readonly LonLat[]): RectangleShape {
  const centre = centroid(corners);
  const plane = new Plane(centre);
  const m = corners.map((corner) => plane.toMetres(corner));
  const edges = m.map((a, i) => {
    const b = m[(i + 1) % m.length] ?? a;
    return [b[0] - a[0], b[1] - a[1]] as Metres;
  });
  const mean = (i: number): Metres => {
    const a: Metres = edges[i] ?? [0, 0];
    const b: Metres = edges[i + 2] ?? [0, 0];
    return [(a[0] - b[0]) / 2, (a[1] - b[1]) / 2];
  };
  const [first, second] = [mean(0), mean(1)];
  const [long, short] = Math.hypot(...first) >= Math.hypot(...second) ? [first, second] : [second, first];
  const heading = Math.atan2(long[0], long[1]) / RADIANS;
  return { centre, lengthM: Math.hypot(...long), widthM: Math.hypot(...short), headingDeg: (heading + 360) % 180 };
}

export function centroid(corners: readonly LonLat[]): LonLat {
  const sum = corners.reduce(([x, y], [lon, lat]) => [x + lon, y + lat] as LonLat, [0, 0]);
  return [sum[0] / corners.length, sum[1] / corners.length];
}

/** The same corners, moved by the way from one point to another. */
export function moved(corners: readonly LonLat[], from: LonLat, to: LonLat): LonLat[] {
  return corners.map(([lon, lat]) => [lon + to[0] - from[0], lat + to[1] - from[1]]);
}

/** The same corners, turned clockwise about their middle. */
export function turned(corners: readonly LonLat[], degrees: number): LonLat[] {
  const plane = new Plane(centroid(corners));
  const [sine, cosine] = [Math.sin(degrees * RADIANS), Math.cos(degrees * RADIANS)];
  return corners.map((corner) => {
    const [east, north] = plane.toMetres(corner);
    return plane.toLonLat([east * cosine + north * sine, north * cosine - east * sine]);
  });
}

/** Bearing from one point to another, degrees clockwise from north. */
export function bearingDeg(from: LonLat, to: LonLat): number {
  const [east, north] = new Plane(from).toMetres(to);
  return (Math.atan2(east, north) / RADIANS + 360) % 360;
}

/** Whether a ring (not closed) does not cross itself and has an area worth parking on, m². */
export function isSimple(corners: readonly LonLat[], leastAreaM2 = 1): boolean {
  if (corners.length < 3) return false;
  const plane = new Plane(centroid(corners));
  const m = corners.map((corner) => plane.toMetres(corner));
  let area = 0;
  for (let i = 0; i < m.length; i++) {
    const [a, b] = [m[i]!, m[(i + 1) % m.length]!];
    area += (a[0] * b[1] - b[0] * a[1]) / 2;
    for (let j = i + 2; j < m.length; j++) {
      if (i === 0 && j === m.length - 1) continue;
      if (cross(a, b, m[j]!, m[(j + 1) % m.length]!)) return false;
    }
  }
  return Math.abs(area) >= leastAreaM2;
}

function cross(a: Metres, b: Metres, c: Metres, d: Metres): boolean {
  const side = (p: Metres, q: Metres, r: Metres): number => (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
  return side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0;
}

/** Corners drawn towards their middle. */
export function shrunk(corners: readonly LonLat[], share: number): LonLat[] {
  const middle = centroid(corners);
  return corners.map(([lon, lat]) => [middle[0] + (lon - middle[0]) * share, middle[1] + (lat - middle[1]) * share]);
}
