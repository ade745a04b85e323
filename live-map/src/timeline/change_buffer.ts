/** Changes of the past that were fetched and are not due yet. */

import type { HistoryChange } from "../service/client";

export class ChangeBuffer {
  private waiting: HistoryChange[] = [];
  /** All changes up to here are known, seconds since the epoch. */
  until = 0;
  private newest = 0;

  /** Start anew at a time, of which the states are known. */
  reset(at: number): void {
    this.waiting = [];
    this.until = at;
    this.newest = 0;
  }

  /** Take in a page of changes, in the order of their numbers; those that are known already are left out. */
  add(changes: readonly HistoryChange[], until: number): void {
    for (const change of changes) {
      if (change.number <= this.newest) continue;
      this.newest = change.number;
      this.waiting.push(change);
    }
    this.until = Math.max(this.until, until);
  }

  /** Changes that are due at a time; each is given once. */
  take(at: number): HistoryChange[] {
    const due = this.waiting.findIndex((change) => change.receivedAt > at);
    return this.waiting.splice(0, due < 0 ? this.waiting.length : due);
  }
}
