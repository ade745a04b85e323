/** A parking spot and what is believed of it. */

import type { Feature, Polygon } from "geojson";

export type State = "vacant" | "occupied" | "unknown";
export const STATES: readonly State[] = ["vacant", "occupied", "unknown"];
export const KINDS = ["parallel", "perpendicular", "angled", "unknown"] as const;

export interface Spot {
  id: string;
  kind: string;
  outline: Polygon;
  centre: [number, number];
  state: State;
  /** That it is vacant. */
  probability: number;
  /** Seconds since the epoch, null if nobody ever looked. */
  observedAt: number | null;
}

export interface SpotChange {
  spotId: string;
  state: State;
  probability: number;
  observedAt: number | null;
}

/** The name of a state as people say it. */
export const STATE_NAME: Record<State, string> = { vacant: "Free", occupied: "Taken", unknown: "Unknown" };

export interface SpotProperties {
  spot_id: string;
  kind: string;
  state: State;
  probability: number;
  observed_at: number | null;
  age_s: number | null;
}

export function spotFromFeature(feature: Feature<Polygon, SpotProperties>): Spot {
  const { spot_id, kind, state, probability, observed_at } = feature.properties;
  return {
    id: spot_id,
    kind,
    outline: feature.geometry,
    centre: middle(feature.geometry),
    state,
    probability,
    observedAt: observed_at,
  };
}

function middle(polygon: Polygon): [number, number] {
  const corners = polygon.coordinates[0]?.slice(0, -1) ?? [];
  let [lon, lat] = [0, 0];
  for (const [x = 0, y = 0] of corners) {
    lon += x;
    lat += y;
  }
  return [lon / corners.length, lat / corners.length];
}

/** How sure the service is of the state that it tells, 0..1. */
export function confidence(spot: Pick<Spot, "state" | "probability">): number {
  return spot.state === "occupied" ? 1 - spot.probability : spot.probability;
}

/** "93 % sure" of free and taken; of unknown spots how likely they are free. */
export function chanceText(spot: Pick<Spot, "state" | "probability" | "observedAt">): string {
  if (spot.state === "unknown") {
    return spot.observedAt === null ? "Nobody has looked yet" : `${percent(spot.probability)} likely free`;
  }
  return `${percent(confidence(spot))} sure`;
}

/** Nothing that a car saw is certain, so never 0 or 100. */
export function percent(share: number): string {
  if (share >= 0.995) return "> 99 %";
  if (share < 0.005) return "< 1 %";
  return `${Math.round(share * 100)} %`;
}

/** "just now", "4 min ago", "2 h ago", "3 days ago". */
export function ageText(seconds: number): string {
  if (seconds < 10) return "just now";
  if (seconds < 90) return `${Math.round(seconds)} s ago`;
  if (seconds < 90 * 60) return `${Math.round(seconds / 60)} min ago`;
  if (seconds < 36 * 3600) return `${Math.round(seconds / 3600)} h ago`;
  return `${Math.round(seconds / 86400)} days ago`;
}
