/** What an outline is changed by: a handle at each corner, one to move all of it, one to turn it. */

import { Marker } from "maplibre-gl";

import { element } from "../dom";
import { bearingDeg, centroid, type LonLat, moved, Plane, turned } from "../geometry/plane";
import type { CityMap } from "./city_map";

const STEP_M = 0.1;
const LONG_STEP_M = 1;
const TURN_DEG = 1;
const LONG_TURN_DEG = 10;
const KNOB_M = 2.5;
const ARROWS: Record<string, [number, number]> = {
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
  ArrowRight: [1, 0],
  ArrowLeft: [-1, 0],
};

export class OutlineHandles {
  onChange: (corners: LonLat[]) => void = () => {};
  private corners: LonLat[] = [];
  private markers: Marker[] = [];
  private middle: Marker | null = null;
  private knob: Marker | null = null;

  constructor(private readonly city: CityMap) {}

  show(corners: LonLat[]): void {
    this.hide();
    this.corners = corners;
    this.markers = corners.map((at, i) => {
      const marker = this.marker("corner", `Corner ${i + 1}`, at);
      this.steer(marker, (to) => this.become(this.corners.map((corner, j) => (i === j ? to : corner))));
      return marker;
    });
    this.middle = this.marker("middle", "Move the spot", centroid(corners));
    this.steer(this.middle, (to) => this.become(moved(this.corners, centroid(this.corners), to)));
    this.knob = this.marker("knob", "Turn the spot", this.knobPlace());
    this.knob.on("drag", () => this.turnTowards());
    this.knob.getElement().addEventListener("keydown", (event) => {
      const way = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key];
      if (way === undefined) return;
      claim(event);
      this.become(turned(this.corners, way * (event.shiftKey ? LONG_TURN_DEG : TURN_DEG)));
    });
  }

  hide(): void {
    for (const marker of [...this.markers, this.middle, this.knob]) marker?.remove();
    this.markers = [];
    this.middle = this.knob = null;
  }

  private become(corners: LonLat[]): void {
    this.corners = corners;
    corners.forEach((at, i) => this.markers[i]?.setLngLat(at));
    this.middle?.setLngLat(centroid(corners));
    this.knob?.setLngLat(this.knobPlace());
    this.onChange(corners);
  }

  private marker(kind: string, label: string, at: LonLat): Marker {
    const handle = element("button", { type: "button", className: `handle ${kind}`, ariaLabel: label, title: label });
    const marker = new Marker({ element: handle, draggable: true }).setLngLat(at).addTo(this.city.map);
    handle.ariaLabel = label; // the marker sets one of its own
    return marker;
  }

  /** Move by dragging, and by arrow keys towards the edges of the screen. */
  private steer(marker: Marker, move: (to: LonLat) => void): void {
    marker.on("drag", () => move(marker.getLngLat().toArray()));
    marker.getElement().addEventListener("keydown", (event) => {
      const arrow = ARROWS[event.key];
      if (!arrow) return;
      claim(event);
      const step = event.shiftKey ? LONG_STEP_M : STEP_M;
      const bearing = (this.city.map.getBearing() * Math.PI) / 180;
      const [right, up] = [arrow[0] * step, arrow[1] * step];
      const east = right * Math.cos(bearing) + up * Math.sin(bearing);
      const north = up * Math.cos(bearing) - right * Math.sin(bearing);
      move(new Plane(marker.getLngLat().toArray()).toLonLat([east, north]));
    });
  }

  private turnTowards(): void {
    if (!this.knob) return;
    const middle = centroid(this.corners);
    const turn = bearingDeg(middle, this.knob.getLngLat().toArray()) - bearingDeg(middle, this.knobPlace());
    this.become(turned(this.corners, turn));
  }

  /** Beyond the middle of the first edge. */
  private knobPlace(): LonLat {
    const middle = centroid(this.corners);
    const [a = middle, b = middle] = this.corners;
    const plane = new Plane(middle);
    const [east, north] = plane.toMetres([(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
    const length = Math.hypot(east, north) || 1;
    const scale = (length + KNOB_M) / length;
    return plane.toLonLat([east * scale, north * scale]);
  }
}

function claim(event: KeyboardEvent): void {
  event.preventDefault();
  event.stopPropagation();
}
