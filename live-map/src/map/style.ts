/** The style of the map: which sources there are, and the layers in order from the ground up. */

import type { ExpressionSpecification, LayerSpecification, StyleSpecification } from "maplibre-gl";

import { STATES } from "../spots/spot";
import type { Palette } from "./palette";

export const SOURCES = ["streets", "spots", "dots", "parked", "route", "trails", "cars", "draft"] as const;
export type SourceName = (typeof SOURCES)[number];

const EARTH_CIRCUMFERENCE_M = 40_075_016.686;
const TILE_PX = 512;
const PARKED_CAR_M = 1.45;
const FONT = ["sans-serif"];

/** An empty style; data comes later. `latitude` is where metres are turned into pixels. */
export function mapStyle(palette: Palette, latitude: number): StyleSpecification {
  return {
    version: 8,
    sources: Object.fromEntries(
      SOURCES.map((name) => [
        name,
        { type: "geojson", data: { type: "FeatureCollection", features: [] }, promoteId: "key", maxzoom: 20, tolerance: 0 },
      ]),
    ),
    light: { anchor: "map", position: [1.4, 200, 35], intensity: 0.18 },
    layers: mapLayers(palette, latitude),
  };
}

export function mapLayers(palette: Palette, latitude: number): LayerSpecification[] {
  const byState = (part: "fill" | "line" | "text" | "halo"): ExpressionSpecification => {
    const cases = STATES.flatMap((state) => [state, palette.spot[state][part]]);
    return ["match", ["get", "state"], ...cases, palette.spot.unknown[part]] as unknown as ExpressionSpecification;
  };
  const width = ["coalesce", ["get", "width_m"], 6] as ExpressionSpecification;
  const kind = (name: string): ExpressionSpecification => ["==", ["get", "kind"], name];
  return [
    { id: "ground", type: "background", paint: { "background-color": palette.ground } },
    {
      id: "street-edges",
      type: "line",
      source: "streets",
      filter: kind("street"),
      layout: { "line-cap": "round", "line-join": "round" },
      paint: { "line-color": palette.streetEdge, "line-width": metres(["+", width, 0.8], latitude, 2) },
    },
    {
      id: "areas",
      type: "fill",
      source: "streets",
      filter: kind("area"),
      paint: {
        "fill-color": ["match", ["get", "surface"], "asphalt", palette.street, "pavement", palette.pavement, palette.area],
      },
    },
    {
      id: "streets",
      type: "line",
      source: "streets",
      filter: kind("street"),
      layout: { "line-cap": "round", "line-join": "round" },
      paint: { "line-color": palette.street, "line-width": metres(width, latitude, 1) },
    },
    {
      id: "trees",
      type: "circle",
      source: "streets",
      filter: ["all", kind("tree"), ["==", ["geometry-type"], "Point"]],
      paint: { "circle-color": palette.tree, "circle-radius": metres(2, latitude, 1), "circle-pitch-alignment": "map" },
    },
    {
      id: "spots",
      type: "fill",
      source: "spots",
      paint: { "fill-color": byState("fill"), "fill-opacity": ["get", "strength"], "fill-antialias": false },
    },
    {
      id: "spots-taken",
      type: "fill",
      source: "spots",
      minzoom: 16,
      filter: ["==", ["get", "state"], "occupied"],
      paint: { "fill-pattern": "hatched", "fill-opacity": ["get", "strength"] },
    },
    {
      id: "spots-unknown",
      type: "fill",
      source: "spots",
      minzoom: 16,
      filter: ["==", ["get", "state"], "unknown"],
      paint: { "fill-pattern": "dotted", "fill-opacity": 0.8 },
    },
    {
      id: "spot-dots", // from afar a spot is smaller than a pixel: solid where free, a ring where taken
      type: "circle",
      source: "dots",
      maxzoom: 16.5,
      layout: { "circle-sort-key": ["match", ["get", "state"], "vacant", 2, "occupied", 1, 0] },
      paint: {
        "circle-color": ["match", ["get", "state"], "vacant", palette.spot.vacant.fill, palette.ground],
        "circle-stroke-color": byState("line"),
        "circle-stroke-width": ["match", ["get", "state"], "unknown", 0.5, 1],
        "circle-radius": [
          "interpolate", ["linear"], ["zoom"],
          12, ["match", ["get", "state"], "vacant", 1.6, "occupied", 1, 0.5],
          16, ["match", ["get", "state"], "vacant", 4, "occupied", 3, 2],
        ],
      },
    },
    {
      id: "spot-outlines",
      type: "line",
      source: "spots",
      minzoom: 16,
      paint: {
        "line-color": byState("line"),
        "line-width": ["interpolate", ["linear"], ["zoom"], 15, 0.5, 18, 1.5, 20, 2.5],
      },
    },
    {
      id: "spot-selected",
      type: "line",
      source: "spots",
      filter: ["==", ["get", "key"], ""],
      layout: { "line-join": "round" },
      paint: { "line-color": palette.accent, "line-width": ["interpolate", ["linear"], ["zoom"], 15, 2, 19, 5] },
    },
    {
      id: "street-names",
      type: "symbol",
      source: "streets",
      minzoom: 15,
      filter: ["all", kind("street"), ["has", "name"]],
      layout: {
        "text-field": ["get", "name"],
        "text-font": FONT,
        "text-size": 12,
        "symbol-placement": "line",
        "symbol-spacing": 500,
        "text-letter-spacing": 0.04,
      },
      paint: { "text-color": palette.streetName, "text-halo-color": palette.street, "text-halo-width": 1.5 },
    },
    {
      id: "trails",
      type: "line",
      source: "trails",
      layout: { "line-cap": "round", "line-join": "round" },
      paint: { "line-color": palette.car, "line-width": 3, "line-opacity": 0.35 },
    },
    {
      id: "route-edge",
      type: "line",
      source: "route",
      layout: { "line-cap": "round", "line-join": "round" },
      paint: { "line-color": palette.halo, "line-width": 9, "line-opacity": 0.9 },
    },
    {
      id: "route",
      type: "line",
      source: "route",
      layout: { "line-cap": "round", "line-join": "round" },
      paint: { "line-color": palette.accent, "line-width": 5 },
    },
    {
      id: "parked",
      type: "fill-extrusion",
      source: "parked",
      minzoom: 16.5,
      paint: {
        "fill-extrusion-color": palette.parked,
        "fill-extrusion-height": PARKED_CAR_M,
        "fill-extrusion-opacity": 0.85,
      },
    },
    {
      id: "buildings",
      type: "fill-extrusion",
      source: "streets",
      filter: kind("building"),
      paint: {
        "fill-extrusion-color": palette.building,
        "fill-extrusion-height": ["coalesce", ["get", "height_m"], 8],
        "fill-extrusion-opacity": 0.55,
      },
    },
    {
      id: "draft",
      type: "fill",
      source: "draft",
      filter: ["==", ["geometry-type"], "Polygon"],
      paint: { "fill-color": palette.accent, "fill-opacity": 0.3 },
    },
    {
      id: "draft-outline",
      type: "line",
      source: "draft",
      paint: { "line-color": palette.accent, "line-width": 2.5, "line-dasharray": [2, 1] },
    },
    {
      id: "cars",
      type: "symbol",
      source: "cars",
      layout: {
        "icon-image": "car",
        "icon-size": metres(4.6 / 92, latitude, 0.22),
        "icon-rotate": ["get", "heading"],
        "icon-rotation-alignment": "map",
        "icon-pitch-alignment": "map",
        "icon-allow-overlap": true,
        "icon-ignore-placement": true,
      },
    },
    {
      id: "spot-labels",
      type: "symbol",
      source: "spots",
      minzoom: 17.5,
      layout: {
        "text-field": ["step", ["zoom"], ["get", "short"], 19.2, ["get", "middle"], 20.2, ["get", "long"]],
        "text-font": FONT,
        "text-size": ["interpolate", ["linear"], ["zoom"], 17.5, 10, 20, 14],
        "text-line-height": 1.25,
        "text-padding": 1,
        "symbol-sort-key": ["match", ["get", "state"], "vacant", 0, "unknown", 1, 2],
      },
      paint: { "text-color": byState("text"), "text-halo-color": byState("halo"), "text-halo-width": 1.2 },
    },
  ];
}

/** A width in metres as pixels of any zoom, at least so many pixels. */
function metres(value: ExpressionSpecification | number, latitude: number, least: number): ExpressionSpecification {
  const perMetre = (zoom: number): number =>
    (TILE_PX * 2 ** zoom) / (EARTH_CIRCUMFERENCE_M * Math.cos((latitude * Math.PI) / 180));
  const stops = Array.from({ length: 13 }, (_, i) => i + 12).flatMap((zoom) => [
    zoom,
    ["max", least, ["*", value, perMetre(zoom)]],
  ]);
  return ["interpolate", ["exponential", 2], ["zoom"], ...stops] as unknown as ExpressionSpecification;
}
