import { describe, expect, it } from "vitest";

import type { HistoryChange, HistoryPage, Service, SpotsAnswer } from "../src/service/client";
import type { Spot } from "../src/spots/spot";
import { ChangeBuffer } from "../src/timeline/change_buffer";
import { histogram } from "../src/timeline/histogram";
import { Replay } from "../src/timeline/replay";

function change(number: number, receivedAt: number, vacant: boolean): HistoryChange {
  const probability = vacant ? 0.9 : 0.1;
  return { number, receivedAt, spotId: "A", state: vacant ? "vacant" : "occupied", probability, observedAt: receivedAt };
}

const DAY = Array.from({ length: 50 }, (_, i) => change(i + 1, 1000 + 60 * i, i % 2 === 0));
const EXTENT = { start: 1000, end: 1000 + 60 * 49 };
const SPOT: Spot = {
  id: "A",
  kind: "parallel",
  outline: { type: "Polygon", coordinates: [] },
  centre: [0, 0],
  state: "unknown",
  probability: 0.5,
  observedAt: null,
};

/** A service that remembers the day and answers in pages of three. */
class Remembering {
  asked = 0;

  spots(at: number): Promise<SpotsAnswer> {
    const last = DAY.filter(({ receivedAt }) => receivedAt <= at).at(-1);
    return Promise.resolve({ spots: [{ ...SPOT, ...last }], version: 1, now: at });
  }

  history(start: number, end: number, after: number): Promise<HistoryPage> {
    this.asked += 1;
    const rest = DAY.filter(({ receivedAt, number }) => receivedAt >= start && receivedAt <= end && number > after);
    const changes = rest.slice(0, 3);
    return Promise.resolve({ changes, next: rest.length > 3 ? (changes.at(-1)?.number ?? null) : null });
  }
}

describe("ChangeBuffer", () => {
  it("gives each change once, when it is due", () => {
    const buffer = new ChangeBuffer();
    buffer.reset(990);
    buffer.add(DAY.slice(0, 3), 1130);
    buffer.add(DAY.slice(1, 4), 1180);
    expect(buffer.take(1060).map(({ number }) => number)).toEqual([1, 2]);
    expect(buffer.take(1060)).toEqual([]);
    expect(buffer.take(2000).map(({ number }) => number)).toEqual([3, 4]);
    expect(buffer.until).toBe(1180);
  });
});

describe("Replay", () => {
  it("shows at every moment what was believed then, however it got there", async () => {
    const service = new Remembering();
    const replay = new Replay(service as unknown as Service);
    await replay.seek(EXTENT.start);
    replay.speed = 60;
    while (replay.at < EXTENT.end) {
      await replay.advance(0.7, EXTENT);
      const expected = DAY.filter(({ receivedAt }) => receivedAt <= replay.at).at(-1);
      expect(replay.book.get("A")?.state).toBe(expected?.state);
    }
    await replay.seek(1200);
    expect(replay.book.get("A")?.state).toBe("occupied");
    expect(service.asked).toBeGreaterThan(1);
  });
});

it("a histogram counts every time, the last included", () => {
  expect(histogram([0, 1, 5, 10], 0, 10, 5)).toEqual([2, 0, 1, 0, 1]);
});
