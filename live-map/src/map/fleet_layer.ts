/** Cars on the map: they drive along what they reported; a ring where a diff came from. */

import { Marker } from "maplibre-gl";

import { element } from "../dom";
import { CarTrack, type Waypoint } from "./car_track";
import { calm, type CityMap } from "./city_map";

/** Drawing more often costs without looking any smoother. */
const FRAME_MS = 80;
const KEPT_MS = 120_000;
const RING_MS = 1600;
const MOST_RINGS = 12;
const MOST_TRAILS = 60;

interface Car {
  track: CarTrack;
  heardAt: number;
}

export class FleetLayer {
  private cars = new Map<string, Car>();
  private rings = 0;
  private drawnAt = 0;
  private running = false;

  constructor(private readonly city: CityMap) {}

  get count(): number {
    return this.cars.size;
  }

  drive(name: string, path: readonly Waypoint[]): void {
    const car = this.cars.get(name) ?? { track: new CarTrack(), heardAt: 0 };
    car.track.push(path);
    car.heardAt = performance.now();
    this.cars.set(name, car);
    if (calm.matches) {
      car.track.finish();
      this.draw();
    } else if (!this.running) {
      this.running = true;
      this.drawnAt = performance.now();
      requestAnimationFrame(this.step);
    }
  }

  /** A ring around a car that was just heard of. */
  ring(name: string): void {
    const place = this.cars.get(name)?.track.place();
    if (!place || this.rings >= MOST_RINGS) return;
    const marker = new Marker({ element: element("div", { className: "ring", ariaHidden: "true" }) });
    marker.setLngLat(place.at).addTo(this.city.map);
    this.rings += 1;
    setTimeout(() => {
      marker.remove();
      this.rings -= 1;
    }, RING_MS);
  }

  /** The past has no cars. */
  hide(hidden: boolean): void {
    this.city.show(["cars", "trails"], !hidden);
  }

  private step = (time: number): void => {
    const passed = time - this.drawnAt;
    if (passed < FRAME_MS) {
      requestAnimationFrame(this.step);
      return;
    }
    this.drawnAt = time;
    let moving = false;
    for (const [name, car] of this.cars) {
      moving = car.track.advance(Math.min(passed, 1000) / 1000) || moving;
      if (time - car.heardAt > KEPT_MS) this.cars.delete(name);
    }
    this.draw();
    if (moving) requestAnimationFrame(this.step);
    else this.running = false;
  };

  private draw(): void {
    const cars = [...this.cars].flatMap(([name, { track }]) => {
      const place = track.place();
      return place ? [{ name, place, trail: track.trail() }] : [];
    });
    this.city.setData(
      "cars",
      cars.map(({ name, place }) => ({
        type: "Feature",
        geometry: { type: "Point", coordinates: place.at },
        properties: { key: name, heading: place.headingDeg },
      })),
    );
    this.city.setData(
      "trails",
      cars.slice(0, MOST_TRAILS).map(({ name, trail }) => ({
        type: "Feature",
        geometry: { type: "LineString", coordinates: trail.length > 1 ? trail : [...trail, ...trail] },
        properties: { key: name },
      })),
    );
  }
}
