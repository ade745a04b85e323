/** What the page asks of the service. */

import type { Feature, FeatureCollection, LineString, Polygon } from "geojson";

import { type Spot, type SpotChange, type SpotProperties, type State, spotFromFeature } from "../spots/spot";

/** The service refused, or could not be reached (status 0). */
export class ServiceError extends Error {
  constructor(
    readonly status: number,
    message: string,
  ) {
    super(message);
  }

  /** The service does not have this feature, rather than not this once. */
  get absent(): boolean {
    return this.status === 404 || this.status === 405 || this.status === 501;
  }

  get unauthorized(): boolean {
    return this.status === 401 || this.status === 403;
  }
}

export interface SpotsAnswer {
  spots: Spot[];
  version: number;
  /** The service's clock, seconds since the epoch; null if no spot was ever seen. */
  now: number | null;
}

export interface NearSpot {
  spotId: string;
  lonLat: [number, number];
  distanceM: number;
  durationS: number;
  probability: number;
  onArrival: number;
  observedAt: number | null;
  route: LineString;
  routed: boolean;
}

export interface HistoryChange extends SpotChange {
  number: number;
  receivedAt: number;
}

export interface HistoryPage {
  changes: HistoryChange[];
  next: number | null;
}

export interface Stats {
  uptime_s: number;
  map_version: number;
  map_features: number;
  spots: Record<State, number>;
  diffs: { total: number; per_second: number; bytes_total: number };
  delay_ms: { p50: number | null; p99: number | null };
  stages_ms: Record<string, number>;
  listeners: number;
}

export interface MapPoints {
  count: number;
  origin: { lon: number; lat: number; altitude_m: number };
  x: number[];
  y: number[];
  z: number[];
  label: number[];
}

export interface StreetProperties {
  kind: string;
  name?: string;
  width_m?: number;
  height_m?: number;
}
export type Streets = FeatureCollection<LineString | Polygon, StreetProperties> & { attribution?: string };
export type Mode = "walking" | "driving";
type ChangeRecord = { spot_id: string; state: State; probability_vacant: number; observed_at: number | null };

const PATIENCE_MS = 20_000;

export class Service {
  constructor(private readonly token: () => string | null) {}

  async spots(at?: number): Promise<SpotsAnswer> {
    const query = at === undefined ? "" : `?at=${at}`;
    const answer = await this.json<FeatureCollection<Polygon, SpotProperties> & { map_version: number }>(
      `/spots.geojson${query}`,
    );
    let now: number | null = null;
    for (const { properties: spot } of answer.features) {
      if (spot.observed_at !== null && spot.age_s !== null) now = Math.max(now ?? 0, spot.observed_at + spot.age_s);
    }
    return { spots: answer.features.map(spotFromFeature), version: answer.map_version, now };
  }

  streets(): Promise<Streets> {
    return this.json<Streets>("/streets.geojson");
  }

  stats(): Promise<Stats> {
    return this.json<Stats>("/stats");
  }

  async nearest(lon: number, lat: number, mode: Mode, limit = 5): Promise<NearSpot[]> {
    interface Answer {
      spots: (ChangeRecord & {
        lon: number;
        lat: number;
        distance_m: number;
        duration_s: number;
        probability_on_arrival: number;
        route: LineString;
        routed?: boolean;
      })[];
      routed?: boolean;
    }
    const answer = await this.json<Answer>(`/nearest?lon=${lon}&lat=${lat}&limit=${limit}&mode=${mode}`);
    return answer.spots.map((spot) => ({
      spotId: spot.spot_id,
      lonLat: [spot.lon, spot.lat],
      distanceM: spot.distance_m,
      durationS: spot.duration_s,
      probability: spot.probability_vacant,
      onArrival: spot.probability_on_arrival,
      observedAt: spot.observed_at,
      route: spot.route,
      routed: spot.routed ?? answer.routed ?? true,
    }));
  }

  historyExtent(): Promise<{ start: number | null; end: number | null }> {
    return this.json("/history/extent");
  }

  async history(start: number, end: number, after = 0, limit = 1000): Promise<HistoryPage> {
    type Row = ChangeRecord & { number: number; received_at: number };
    const answer = await this.json<{ changes: Row[]; next: number | null }>(
      `/history?start=${start}&end=${end}&limit=${limit}&after=${after}`,
    );
    const changes = answer.changes.map((row) => ({
      ...changeFromRecord(row),
      number: row.number,
      receivedAt: row.received_at,
    }));
    return { changes, next: answer.next };
  }

  mapPoints(west: number, south: number, east: number, north: number, limit = 50_000): Promise<MapPoints> {
    return this.json(`/map/points?bbox=${[west, south, east, north].join(",")}&limit=${limit}`);
  }

  parkingMap(): Promise<FeatureCollection<Polygon>> {
    return this.json("/parking_map.geojson");
  }

  async saveSpot(id: string, feature: Feature<Polygon>): Promise<void> {
    await this.ask(`/spots/${encodeURIComponent(id)}`, {
      method: "PUT",
      headers: { "Content-Type": "application/geo+json" },
      body: JSON.stringify(feature),
    });
  }

  async deleteSpot(id: string): Promise<void> {
    await this.ask(`/spots/${encodeURIComponent(id)}`, { method: "DELETE" });
  }

  private async json<T>(path: string): Promise<T> {
    const response = await this.ask(path, {});
    return (await response.json()) as T;
  }

  private async ask(path: string, init: RequestInit & { headers?: Record<string, string> }): Promise<Response> {
    const token = this.token();
    const headers = { Accept: "application/json", ...init.headers, ...(token && { Authorization: `Bearer ${token}` }) };
    let response: Response;
    try {
      response = await fetch(path, { ...init, headers, signal: AbortSignal.timeout(PATIENCE_MS) });
    } catch {
      throw new ServiceError(0, "The service cannot be reached");
    }
    if (response.ok) return response;
    throw new ServiceError(response.status, await description(response));
  }
}

export function changeFromRecord(record: ChangeRecord): SpotChange {
  return {
    spotId: record.spot_id,
    state: record.state,
    probability: record.probability_vacant,
    observedAt: record.observed_at,
  };
}

/** The service's own words for what is wrong. */
async function description(response: Response): Promise<string> {
  try {
    const problem = (await response.json()) as { error_description?: unknown };
    if (typeof problem.error_description === "string") return problem.error_description;
  } catch {
    // not a problem of ours: a proxy's page
  }
  return `The service answered ${response.status}`;
}
