/** The map on the page: streets, spots, a route; what was clicked. */

import type { Feature, FeatureCollection, Geometry, LineString } from "geojson";
import {
  GeoJSONSource,
  Map as MapLibre,
  type MapMouseEvent,
  NavigationControl,
  ScaleControl,
  setWorkerUrl,
} from "maplibre-gl";
import workerUrl from "maplibre-gl/dist/maplibre-gl-worker.mjs?worker&url";

import { type LonLat, shrunk } from "../geometry/plane";
import type { Streets } from "../service/client";
import { ageText, confidence, percent, type Spot } from "../spots/spot";
import type { SpotBook } from "../spots/spot_book";
import { PALETTES, type Theme } from "./palette";
import { images } from "./patterns";
import { mapLayers, mapStyle, type SourceName } from "./style";

setWorkerUrl(workerUrl);

/** A state that nobody confirmed for so long is drawn pale, seconds. */
const STALE_S = 3600;
const TILT_DEG = 45;
const CLICK_SLACK_PX = 6;

export const calm = matchMedia("(prefers-reduced-motion: reduce)");

export class CityMap {
  readonly map: MapLibre;
  readonly ready: Promise<void>;
  onSpot: (id: string) => void = () => {};
  /** A click anywhere; true if somebody waited for it, and it chooses no spot. */
  onGround: (at: LonLat) => boolean = () => false;
  /** Has every click first while something is drawn. */
  capture: ((at: LonLat) => boolean) | null = null;
  private latitude = 0;
  private readonly viewGiven = location.hash.includes("map=");
  private palette;

  constructor(
    container: HTMLElement,
    theme: Theme,
    private readonly now: () => number,
  ) {
    this.palette = PALETTES[theme];
    this.map = new MapLibre({
      container,
      style: mapStyle(this.palette, 0),
      center: [0, 20],
      zoom: 1.5,
      maxZoom: 22,
      maxPitch: 70,
      pitch: TILT_DEG,
      hash: "map",
      attributionControl: false,
      pixelRatio: Math.min(devicePixelRatio, 2),
      fadeDuration: calm.matches ? 0 : 150,
      canvasContextAttributes: { antialias: !drawsInSoftware() },
      locale: { "Map.Title": "Map of parking spots; arrow keys move it, Enter chooses the spot in the middle" },
    });
    this.map.addControl(new NavigationControl({ visualizePitch: true }), "top-right");
    this.map.addControl(new ScaleControl({ unit: "metric", maxWidth: 90 }), "bottom-right");
    this.ready = new Promise((resolve) => this.map.once("load", () => resolve()));
    this.map.on("style.load", () => this.drawImages());
    this.map.on("click", (event) => this.clicked(event));
    this.map.on("mousemove", (event) => {
      const pointing = !this.capture && this.spotAt(event.point.x, event.point.y) !== null;
      this.map.getCanvas().style.cursor = this.capture ? "crosshair" : pointing ? "pointer" : "";
    });
    this.map.getCanvas().addEventListener("keydown", (event) => {
      if (event.key === "Enter") this.chooseMiddle();
    });
  }

  /** Spots of the book as they are now; call again when ages have to be drawn anew. */
  showSpots(book: SpotBook): void {
    const spots = [...book.all()];
    this.setData("spots", spots.map((spot) => this.spotFeature(spot)));
    this.setData("dots", spots.map(dotFeature));
    this.setData("parked", spots.filter((spot) => spot.state === "occupied").map(parkedFeature));
    this.stamp(book);
  }

  /** Only these spots of the book changed. */
  updateSpots(book: SpotBook, changed: readonly Spot[]): void {
    this.source("spots").updateData({ add: changed.map((spot) => this.spotFeature(spot)) });
    this.source("dots").updateData({ add: changed.map(dotFeature) });
    this.source("parked").updateData({
      remove: changed.filter((spot) => spot.state !== "occupied").map((spot) => spot.id),
      add: changed.filter((spot) => spot.state === "occupied").map(parkedFeature),
    });
    this.stamp(book);
  }

  setStreets(streets: Streets): void {
    this.setData("streets", streets.features as Feature[]);
  }

  /** Where metres are turned into pixels, and the view that shows all of it unless the address says otherwise. */
  settle(bounds: [number, number, number, number]): void {
    this.latitude = (bounds[1] + bounds[3]) / 2;
    this.restyle();
    if (!this.viewGiven) this.fit(bounds, false);
  }

  /** Turn the map so that this compass direction is up. */
  turn(bearingDeg: number): void {
    if (!this.viewGiven) this.map.setBearing(bearingDeg);
  }

  fit(bounds: [number, number, number, number], moving = true): void {
    const [west, south, east, north] = bounds;
    this.map.fitBounds([west, south, east, north], {
      padding: 48,
      maxZoom: 19.5,
      pitch: this.map.getPitch(),
      bearing: this.map.getBearing(),
      animate: moving && !calm.matches,
    });
  }

  select(id: string | null): void {
    this.map.setFilter("spot-selected", ["==", ["get", "key"], id ?? ""]);
  }

  look(at: LonLat, leastZoom = 18.5): void {
    this.map.easeTo({
      center: at,
      zoom: Math.max(this.map.getZoom(), leastZoom),
      animate: !calm.matches,
      duration: 600,
    });
  }

  showRoute(route: LineString | null): void {
    this.setData("route", route ? [{ type: "Feature", geometry: route, properties: {} }] : []);
  }

  show(layers: readonly string[], on: boolean): void {
    for (const layer of layers) this.map.setLayoutProperty(layer, "visibility", on ? "visible" : "none");
  }

  setData(name: SourceName, features: Feature[]): void {
    const data: FeatureCollection<Geometry> = { type: "FeatureCollection", features };
    this.source(name).setData(data);
  }

  get centre(): LonLat {
    const { lng, lat } = this.map.getCenter();
    return [lng, lat];
  }

  /** West, south, east, north of what is in view. */
  get view(): [number, number, number, number] {
    const bounds = this.map.getBounds();
    return [bounds.getWest(), bounds.getSouth(), bounds.getEast(), bounds.getNorth()];
  }

  /** Show that the next click chooses a place. */
  aiming(on: boolean): void {
    this.map.getContainer().parentElement?.classList.toggle("aiming", on);
  }

  focus(): void {
    this.map.getCanvas().focus();
  }

  get tilted(): boolean {
    return this.map.getPitch() > 5;
  }

  tilt(on: boolean): void {
    this.map.easeTo({ pitch: on ? TILT_DEG : 0, animate: !calm.matches, duration: 400 });
  }

  setTheme(theme: Theme): void {
    this.palette = PALETTES[theme];
    this.drawImages();
    this.restyle();
  }

  get colours(): (typeof PALETTES)[Theme] {
    return this.palette;
  }

  /** For those who wait for the map to have caught up: the version of the map that it shows. */
  private stamp(book: SpotBook): void {
    const version = String(book.version);
    const drawn = (): void => {
      if (!this.map.isSourceLoaded("spots")) return;
      this.map.off("render", drawn);
      this.map.getContainer().dataset["version"] = version;
    };
    this.map.on("render", drawn);
    this.map.triggerRepaint();
  }

  private restyle(): void {
    for (const layer of mapLayers(this.palette, this.latitude)) {
      for (const [name, value] of Object.entries(layer.paint ?? {})) {
        this.map.setPaintProperty(layer.id, name as never, value as never);
      }
      if (layer.id === "cars") {
        for (const [name, value] of Object.entries(layer.layout ?? {})) {
          this.map.setLayoutProperty(layer.id, name as never, value as never);
        }
      }
    }
  }

  private drawImages(): void {
    for (const [name, image] of Object.entries(images(this.palette))) {
      if (this.map.hasImage(name)) this.map.updateImage(name, image);
      else this.map.addImage(name, image, { pixelRatio: name === "car" ? 1 : 2 });
    }
  }

  private clicked(event: MapMouseEvent): void {
    const at: LonLat = [event.lngLat.lng, event.lngLat.lat];
    if (this.capture?.(at) || this.onGround(at)) return;
    const id = this.spotAt(event.point.x, event.point.y);
    if (id !== null) this.onSpot(id);
  }

  private chooseMiddle(): void {
    const { clientWidth, clientHeight } = this.map.getCanvas();
    if (this.capture?.(this.centre)) return;
    if (this.onGround(this.centre)) return;
    const id = this.spotAt(clientWidth / 2, clientHeight / 2);
    if (id !== null) this.onSpot(id);
  }

  private spotAt(x: number, y: number): string | null {
    if (!this.map.getLayer("spots")) return null;
    const box: [[number, number], [number, number]] = [
      [x - CLICK_SLACK_PX, y - CLICK_SLACK_PX],
      [x + CLICK_SLACK_PX, y + CLICK_SLACK_PX],
    ];
    const options = { layers: ["spots", "parked", "spot-dots"] };
    const hits = [...this.map.queryRenderedFeatures([x, y], options), ...this.map.queryRenderedFeatures(box, options)];
    const id: unknown = hits[0]?.properties["key"];
    return typeof id === "string" ? id : null;
  }

  private source(name: SourceName): GeoJSONSource {
    const source = this.map.getSource(name);
    if (!(source instanceof GeoJSONSource)) throw new Error(`the map has no source ${name}`);
    return source;
  }

  private spotFeature(spot: Spot): Feature {
    const age = spot.observedAt === null ? null : Math.max(this.now() - spot.observedAt, 0);
    const freshness = age === null ? 0 : 1 - Math.min(age / STALE_S, 1);
    const chance = spot.state === "unknown" ? "?" : percent(confidence(spot));
    return {
      type: "Feature",
      id: spot.id,
      geometry: spot.outline,
      properties: {
        key: spot.id,
        state: spot.state,
        strength: 0.55 + 0.4 * freshness,
        middle: spot.state === "occupied" ? "" : chance,
        short: spot.state === "vacant" ? "P" : spot.state === "unknown" ? "?" : "",
        long: `${spot.id}\n${chance}${age === null ? "" : ` · ${ageText(age).replace(" ago", "")}`}`,
      },
    };
  }
}

/** Whether there is no graphics hardware: then smooth edges of buildings cost more than they are worth. */
function drawsInSoftware(): boolean {
  const gl = document.createElement("canvas").getContext("webgl2");
  const details = gl?.getExtension("WEBGL_debug_renderer_info");
  const renderer: unknown = gl && details ? gl.getParameter(details.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software/i.test(String(renderer));
}

function dotFeature(spot: Spot): Feature {
  return {
    type: "Feature",
    id: spot.id,
    geometry: { type: "Point", coordinates: spot.centre },
    properties: { key: spot.id, state: spot.state },
  };
}

function parkedFeature(spot: Spot): Feature {
  const corners = (spot.outline.coordinates[0] ?? []).slice(0, -1).map(([lon = 0, lat = 0]): LonLat => [lon, lat]);
  const ring = shrunk(corners, 0.78);
  return {
    type: "Feature",
    id: spot.id,
    geometry: { type: "Polygon", coordinates: [[...ring, ring[0] ?? [0, 0]]] },
    properties: { key: spot.id },
  };
}
