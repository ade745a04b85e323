import { describe, expect, it } from "vitest";

import {
  bearingDeg,
  distanceM,
  isSimple,
  type LonLat,
  moved,
  Plane,
  rectangle,
  shapeOf,
  turned,
} from "../src/geometry/plane";
import { principalAxis } from "../src/geometry/principal_axis";
import { closed } from "../src/panels/editor";

const HERE: LonLat = [-77.67, 43.08];

describe("Plane", () => {
  it("agrees with the geodesic of WGS84", () => {
    // pyproj.Geod(ellps="WGS84").inv(-77.67, 43.08, -77.669, 43.081): 137.744 m
    expect(distanceM(HERE, [-77.669, 43.081])).toBeCloseTo(137.744, 1);
  });

  it("comes back to where it began", () => {
    const plane = new Plane(HERE);
    const [lon, lat] = plane.toLonLat(plane.toMetres([-77.671, 43.0795]));
    expect(lon).toBeCloseTo(-77.671, 10);
    expect(lat).toBeCloseTo(43.0795, 10);
  });
});

describe("rectangles", () => {
  it.each([0, 20, 90, 135, 179])("have the shape that they were made with, heading %d", (heading) => {
    const shape = shapeOf(rectangle(HERE, 5.5, 2.2, heading));
    expect(shape.lengthM).toBeCloseTo(5.5, 4);
    expect(shape.widthM).toBeCloseTo(2.2, 4);
    expect(shape.headingDeg).toBeCloseTo(heading, 2);
  });

  it("turn clockwise about their middle", () => {
    const shape = shapeOf(turned(rectangle(HERE, 5, 2, 10), 30));
    expect(shape.headingDeg).toBeCloseTo(40, 3);
    expect(distanceM(shape.centre, HERE)).toBeLessThan(0.001);
  });

  it("move as a whole", () => {
    const to: LonLat = [-77.6699, 43.0801];
    expect(distanceM(shapeOf(moved(rectangle(HERE, 5, 2, 10), HERE, to)).centre, to)).toBeLessThan(0.001);
  });

  it("are simple unless two corners are swapped or they are slivers", () => {
    const [a, b, c, d] = rectangle(HERE, 5, 2, 10) as [LonLat, LonLat, LonLat, LonLat];
    expect(isSimple([a, b, c, d])).toBe(true);
    expect(isSimple([a, c, b, d])).toBe(false);
    expect(isSimple(rectangle(HERE, 5, 0.1, 10))).toBe(false);
  });

  it("become rings that are counter-clockwise whichever way they were drawn", () => {
    const corners = rectangle(HERE, 5, 2, 10);
    for (const drawn of [corners, [...corners].reverse()]) {
      const ring = closed(drawn);
      expect(ring).toHaveLength(5);
      expect(ring[4]).toEqual(ring[0]);
      const plane = new Plane(HERE);
      const m = ring.map((corner) => plane.toMetres(corner));
      const area = m.slice(0, 4).reduce((sum, [x, y], i) => sum + (x * m[i + 1]![1] - m[i + 1]![0] * y) / 2, 0);
      expect(area).toBeCloseTo(10, 3);
    }
  });
});

it("bearings go clockwise from north", () => {
  expect(bearingDeg(HERE, [-77.67, 43.09])).toBeCloseTo(0, 5);
  expect(bearingDeg(HERE, [-77.66, 43.08])).toBeCloseTo(90, 1);
});

describe("principalAxis", () => {
  it("is the direction of a street", () => {
    const plane = new Plane(HERE);
    const street = Array.from({ length: 20 }, (_, i): LonLat => {
      const along = 6 * Math.floor(i / 2);
      const aside = i % 2 ? 4 : -4;
      const [s, c] = [Math.sin(0.4), Math.cos(0.4)];
      return plane.toLonLat([along * s + aside * c, along * c - aside * s]);
    });
    expect(principalAxis(street)).toBeCloseTo((0.4 * 180) / Math.PI, 3);
  });

  it("is none of a car park", () => {
    const plane = new Plane(HERE);
    const lot = Array.from({ length: 25 }, (_, i) => plane.toLonLat([(i % 5) * 5, Math.floor(i / 5) * 5]));
    expect(principalAxis(lot)).toBeNull();
  });
});
