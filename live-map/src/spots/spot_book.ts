/** All spots by id; tells listeners what changed. */

import { type Spot, type SpotChange, type State } from "./spot";

export type Summary = Record<State, number>;

/** What happened to the book: everything is new, or these spots have another state. */
export type BookEvent = { kind: "replaced" } | { kind: "changed"; spots: Spot[]; flipped: Spot[] };

export class SpotBook {
  private spots = new Map<string, Spot>();
  private listeners = new Set<(event: BookEvent) => void>();
  version = 0;

  get size(): number {
    return this.spots.size;
  }

  get(id: string): Spot | undefined {
    return this.spots.get(id);
  }

  all(): IterableIterator<Spot> {
    return this.spots.values();
  }

  onChange(listener: (event: BookEvent) => void): void {
    this.listeners.add(listener);
  }

  replace(spots: Iterable<Spot>, version: number): void {
    this.spots = new Map(Array.from(spots, (spot) => [spot.id, spot]));
    this.version = version;
    this.tell({ kind: "replaced" });
  }

  /** Apply changes in order; changes of spots that the book does not know are left out. */
  apply(changes: readonly SpotChange[], version = this.version): void {
    const changed = new Map<string, Spot>();
    const flipped = new Map<string, Spot>();
    for (const change of changes) {
      const before = this.spots.get(change.spotId);
      if (!before) continue;
      const { state, probability, observedAt } = change;
      const after = { ...before, state, probability, observedAt };
      this.spots.set(after.id, after);
      changed.set(after.id, after);
      if (before.state !== after.state) flipped.set(after.id, after);
    }
    this.version = Math.max(version, this.version);
    if (changed.size > 0) {
      this.tell({ kind: "changed", spots: [...changed.values()], flipped: [...flipped.values()] });
    }
  }

  summary(): Summary {
    const counts: Summary = { vacant: 0, occupied: 0, unknown: 0 };
    for (const spot of this.spots.values()) counts[spot.state] += 1;
    return counts;
  }

  /** West, south, east, north of all spots. */
  bounds(): [number, number, number, number] | null {
    if (this.spots.size === 0) return null;
    const box: [number, number, number, number] = [Infinity, Infinity, -Infinity, -Infinity];
    for (const spot of this.spots.values()) {
      for (const [lon = 0, lat = 0] of spot.outline.coordinates[0] ?? []) {
        box[0] = Math.min(box[0], lon);
        box[1] = Math.min(box[1], lat);
        box[2] = Math.max(box[2], lon);
        box[3] = Math.max(box[3], lat);
      }
    }
    return box;
  }

  private tell(event: BookEvent): void {
    for (const listener of this.listeners) listener(event);
  }
}
