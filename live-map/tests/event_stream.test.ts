import { describe, expect, it } from "vitest";

import { EventParser, waitBeforeAttempt } from "../src/service/event_stream";

describe("EventParser", () => {
  it("cuts events wherever the network cut the text", () => {
    const text = 'id: 7\nevent: spots\ndata: {"spots":[]}\n\n: quiet\n\nevent: reset\ndata: {}\n\n';
    for (let cut = 0; cut <= text.length; cut++) {
      const parser = new EventParser();
      const events = [...parser.push(text.slice(0, cut)), ...parser.push(text.slice(cut))];
      expect(events).toEqual([
        { id: "7", event: "spots", data: '{"spots":[]}' },
        { id: "7", event: "reset", data: "{}" },
      ]);
    }
  });

  it("joins lines of data and takes CRLF", () => {
    expect(new EventParser().push("data: a\r\ndata: b\r\n\r\n")).toEqual([{ id: "", event: "message", data: "a\nb" }]);
  });

  it("gives nothing for an event without data", () => {
    expect(new EventParser().push("event: spots\n\n")).toEqual([]);
  });
});

it("waits longer after each failure, but never long", () => {
  expect([1, 2, 3, 4, 5, 9].map(waitBeforeAttempt)).toEqual([1, 2, 4, 8, 15, 15]);
});
