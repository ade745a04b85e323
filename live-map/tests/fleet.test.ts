import { describe, expect, it } from "vitest";

import { CarTrack, type Waypoint } from "../src/map/car_track";
import { interleaved, product } from "../src/map/point_layer";

const PATH: Waypoint[] = [
  [0, 0, 350, 100],
  [0.001, 0, 10, 101],
  [0.002, 0, 10, 102],
];

describe("CarTrack", () => {
  it("drives from the first point to the last and turns the short way", () => {
    const car = new CarTrack();
    car.push(PATH);
    expect(car.place()).toEqual({ at: [0, 0], headingDeg: 350 });
    expect(car.advance(0.5)).toBe(true);
    expect(car.place()!.at[0]).toBeCloseTo(0.0005);
    expect(car.place()!.headingDeg).toBeCloseTo(0);
    for (let i = 0; i < 10; i++) car.advance(0.5);
    expect(car.place()!.at[0]).toBeCloseTo(0.002);
    expect(car.advance(0.5)).toBe(false);
  });

  it("goes on where it is when the next report comes, and leaves out what it knows", () => {
    const car = new CarTrack();
    car.push(PATH);
    car.advance(1);
    car.push([...PATH.slice(1), [0.003, 0, 10, 103]]);
    expect(car.place()!.at[0]).toBeCloseTo(0.001);
    for (let i = 0; i < 10; i++) car.advance(0.5);
    expect(car.place()!.at[0]).toBeCloseTo(0.003);
    expect(car.trail().length).toBeGreaterThan(1);
  });

  it("catches up when it is far behind", () => {
    const car = new CarTrack();
    car.push(Array.from({ length: 60 }, (_, i): Waypoint => [i, 0, 90, i]));
    car.advance(1);
    expect(car.place()!.at[0]).toBeGreaterThan(5);
  });

  it("jumps over a silence", () => {
    const car = new CarTrack();
    car.push(PATH);
    car.push([[1, 1, 0, 500]]);
    expect(car.place()!.at).toEqual([1, 1]);
  });
});

describe("points", () => {
  it("lie as position and colour, and unknown labels are drawn as background", () => {
    const points = {
      count: 2,
      origin: { lon: 0, lat: 0, altitude_m: 0 },
      x: [1, 4],
      y: [2, 5],
      z: [3, 6],
      label: [1, 99],
    };
    expect([...interleaved(points, ["#000000", "#ff0000"])]).toEqual([1, 2, 3, 1, 0, 0, 4, 5, 6, 0, 0, 0]);
  });

  it("are moved by the product of matrices, column by column", () => {
    const scale = [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1];
    const shift = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1];
    expect([...product(scale, shift)]).toEqual([2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 10, 12, 14, 1]);
  });
});
