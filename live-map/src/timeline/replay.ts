/** The day again: the spots as they were, moving on at a chosen speed. */

import type { Service } from "../service/client";
import { ServiceClock } from "../service/clock";
import { SpotBook } from "../spots/spot_book";
import { ChangeBuffer } from "./change_buffer";

const PAGE = 1000;
/** Fetch changes this many seconds of watching ahead. */
const AHEAD_S = 8;
const LEAST_SPAN_S = 30;

export interface Extent {
  start: number;
  end: number;
}

export class Replay {
  readonly book = new SpotBook();
  at = 0;
  speed = 60;
  private readonly buffer = new ChangeBuffer();
  private readonly clock = new ServiceClock(() => this.at);
  private seeks = 0;
  private fetching = false;

  constructor(private readonly service: Service) {}

  /** Ages are counted from here. */
  readonly now = (): number => this.clock.now();

  /** Be at a time: fetch what was believed then. */
  async seek(at: number): Promise<void> {
    const seek = ++this.seeks;
    this.at = at;
    const answer = await this.service.spots(at);
    if (seek !== this.seeks) return;
    this.clock.settle(answer.now);
    this.buffer.reset(at);
    this.book.replace(answer.spots, answer.version);
  }

  /** Let so many seconds of watching pass; changes become due as they are known. */
  async advance(watchedS: number, extent: Extent): Promise<void> {
    const wanted = Math.min(this.at + watchedS * this.speed, extent.end);
    // Nothing is skipped: where changes are still on their way, time waits for them.
    this.at = Math.max(this.at, Math.min(wanted, this.buffer.until));
    const due = this.buffer.take(this.at);
    for (const { observedAt } of due) if (observedAt !== null) this.clock.reach(observedAt);
    if (due.length > 0) this.book.apply(due);
    if (this.buffer.until < Math.min(this.at + AHEAD_S * this.speed, extent.end)) await this.fetchAhead(extent);
  }

  private async fetchAhead(extent: Extent): Promise<void> {
    if (this.fetching) return;
    this.fetching = true;
    const seek = this.seeks;
    const start = this.buffer.until;
    const end = Math.min(start + Math.max(2 * AHEAD_S * this.speed, LEAST_SPAN_S), extent.end);
    try {
      let after = 0;
      for (;;) {
        const page = await this.service.history(start, end, after, PAGE);
        if (seek !== this.seeks) return;
        const last = page.changes.at(-1);
        const complete = page.next === null || !last;
        this.buffer.add(page.changes, complete ? end : last.receivedAt);
        if (complete) return;
        after = page.next ?? 0;
      }
    } finally {
      this.fetching = false;
    }
  }
}
