/** The way of one car as it was reported, driven along in real time. */

import type { LonLat } from "../geometry/plane";

/** Longitude, latitude, compass heading in degrees, seconds since the epoch. */
export type Waypoint = [number, number, number, number];

/** Further behind the newest report than this, the car is driven faster to catch up, seconds. */
const COMFORTABLE_LAG_S = 6;
/** A silence longer than this is jumped over, seconds. */
const LONGEST_GAP_S = 15;
const TRAIL_S = 20;

export class CarTrack {
  private points: Waypoint[] = [];
  private at = 0;

  /** Take in a path; points that are not newer than what is known are left out. */
  push(path: readonly Waypoint[]): void {
    const first = path[0];
    if (!first) return;
    const newest = this.points.at(-1)?.[3] ?? -Infinity;
    if (first[3] - newest > LONGEST_GAP_S) {
      this.points = [];
      this.at = first[3];
    }
    this.points.push(...path.filter((point) => point[3] > newest));
  }

  /** Move on by so many seconds; false when the car stands at the end of what is known. */
  advance(seconds: number): boolean {
    const end = this.points.at(-1)?.[3] ?? this.at;
    const lag = end - this.at;
    if (lag <= 0) return false;
    this.at = Math.min(this.at + seconds * Math.max(lag / COMFORTABLE_LAG_S, 1), end);
    this.forget();
    return true;
  }

  /** Stand at the end of what is known. */
  finish(): void {
    this.at = this.points.at(-1)?.[3] ?? this.at;
    this.forget();
  }

  /** Where the car is and which way it looks. */
  place(): { at: LonLat; headingDeg: number } | null {
    const after = this.points.findIndex((point) => point[3] >= this.at);
    const b = this.points[after];
    if (!b) return null;
    const a = this.points[after - 1] ?? b;
    const share = b[3] === a[3] ? 1 : (this.at - a[3]) / (b[3] - a[3]);
    const turn = ((b[2] - a[2] + 540) % 360) - 180;
    return {
      at: [a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share],
      headingDeg: (a[2] + turn * share + 360) % 360,
    };
  }

  /** Where it drove lately, up to where it is. */
  trail(): LonLat[] {
    const here = this.place();
    const behind = this.points.filter((point) => point[3] < this.at).map(([lon, lat]): LonLat => [lon, lat]);
    return here ? [...behind, here.at] : behind;
  }

  private forget(): void {
    const old = this.points.findIndex((point) => point[3] > this.at - TRAIL_S);
    if (old > 1) this.points.splice(0, old - 1);
  }
}
