import type { Feature, Polygon } from "geojson";
import { describe, expect, it } from "vitest";

import { rectangle, type LonLat } from "../src/geometry/plane";
import { MOST_SHOWN, selected } from "../src/panels/spot_list";
import { ServiceClock } from "../src/service/clock";
import { ageText, chanceText, type Spot, spotFromFeature, type SpotProperties, type State, STATES } from "../src/spots/spot";
import { type BookEvent, SpotBook } from "../src/spots/spot_book";
import { nearestByAir } from "../src/spots/straight_line";

const HERE: LonLat = [-77.67, 43.08];
const ALL = new Set(STATES);

function spot(id: string, state: State, centre: LonLat = HERE): Spot {
  const ring = rectangle(centre, 5, 2, 0);
  const feature: Feature<Polygon, SpotProperties> = {
    type: "Feature",
    geometry: { type: "Polygon", coordinates: [[...ring, ring[0]!]] },
    properties: { spot_id: id, kind: "parallel", state, probability: 0.9, observed_at: 100, age_s: 5 },
  };
  return spotFromFeature(feature);
}

describe("SpotBook", () => {
  it("tells what changed and what turned, once per spot", () => {
    const book = new SpotBook();
    book.replace([spot("A", "vacant"), spot("B", "occupied")], 3);
    const heard: BookEvent[] = [];
    book.onChange((event) => heard.push(event));
    const change = { probability: 0.2, observedAt: 110 };
    book.apply(
      [
        { spotId: "A", state: "occupied", ...change },
        { spotId: "B", state: "occupied", ...change },
        { spotId: "gone", state: "vacant", ...change },
      ],
      4,
    );
    expect(heard).toHaveLength(1);
    expect(heard[0]).toMatchObject({ kind: "changed", spots: [{ id: "A" }, { id: "B" }], flipped: [{ id: "A" }] });
    expect(book.summary()).toEqual({ vacant: 0, occupied: 2, unknown: 0 });
    expect(book.version).toBe(4);
  });

  it("spans all outlines", () => {
    const book = new SpotBook();
    expect(book.bounds()).toBeNull();
    book.replace([spot("A", "vacant"), spot("B", "vacant", [-77.66, 43.09])], 1);
    const [west, south, east, north] = book.bounds()!;
    expect(west).toBeLessThan(-77.67);
    expect(south).toBeLessThan(43.08);
    expect(east).toBeGreaterThan(-77.66);
    expect(north).toBeGreaterThan(43.09);
  });
});

describe("the list", () => {
  const spots = [spot("R-10", "vacant"), spot("R-2", "vacant"), spot("L-1", "occupied"), spot("far", "vacant", [0, 0])];
  const view = [-78, 43, -77, 44] as const;

  it("shows free spots of the view first, in the order in which people count", () => {
    expect(selected(spots, { states: ALL, text: "", view }).map(({ id }) => id)).toEqual(["R-2", "R-10", "L-1"]);
  });

  it("finds by name anywhere", () => {
    expect(selected(spots, { states: ALL, text: " FAR", view }).map(({ id }) => id)).toEqual(["far"]);
  });

  it("leaves out states", () => {
    expect(selected(spots, { states: new Set(["occupied"]), text: "", view }).map(({ id }) => id)).toEqual(["L-1"]);
    expect(MOST_SHOWN).toBeGreaterThan(20);
  });
});

it("by air the nearest free spot comes first, and taken ones never", () => {
  const spots = [
    spot("far", "vacant", [-77.668, 43.08]),
    spot("near", "vacant", [-77.6695, 43.08]),
    spot("taken", "occupied"),
  ];
  const found = nearestByAir(spots, HERE, "walking");
  expect(found.map(({ spotId }) => spotId)).toEqual(["near", "far"]);
  expect(found[0]!.durationS).toBeCloseTo(found[0]!.distanceM / 1.35);
});

describe("words", () => {
  it("of ages", () => {
    expect([3, 45, 600, 7200, 200_000].map(ageText)).toEqual([
      "just now",
      "45 s ago",
      "10 min ago",
      "2 h ago",
      "2 days ago",
    ]);
  });

  it("of chances: how sure the service is of what it says", () => {
    expect(chanceText({ state: "vacant", probability: 0.93, observedAt: 1 })).toBe("93 % sure");
    expect(chanceText({ state: "occupied", probability: 0.04, observedAt: 1 })).toBe("96 % sure");
    expect(chanceText({ state: "vacant", probability: 1, observedAt: 1 })).toBe("> 99 % sure");
    expect(chanceText({ state: "unknown", probability: 0.5, observedAt: null })).toBe("Nobody has looked yet");
  });
});

describe("ServiceClock", () => {
  it("runs with the service's clock", () => {
    let wall = 1000;
    const clock = new ServiceClock(() => wall);
    clock.settle(1010);
    wall += 5;
    expect(clock.now()).toBe(1015);
  });

  it("stands where drives of another day are replayed, and moves with what they observe", () => {
    let wall = 1_000_000;
    const clock = new ServiceClock(() => wall);
    clock.settle(2000);
    wall += 60;
    expect(clock.now()).toBe(2000);
    clock.reach(2010);
    clock.reach(1990);
    expect(clock.now()).toBe(2010);
  });
});
