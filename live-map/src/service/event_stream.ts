/** Server-sent events over fetch: unlike EventSource it can send a token and says why it was refused. */

export interface ServerEvent {
  id: string;
  event: string;
  data: string;
}

/** Cuts text/event-stream into events; feed it what arrives, in whatever pieces. */
export class EventParser {
  private rest = "";
  private data: string[] = [];
  private event = "";
  lastId = "";

  push(text: string): ServerEvent[] {
    const lines = (this.rest + text).split(/\r\n|\n|\r(?!$)/);
    this.rest = lines.pop() ?? "";
    const events: ServerEvent[] = [];
    for (const line of lines) {
      if (line !== "") {
        this.field(line);
        continue;
      }
      if (this.data.length > 0) {
        events.push({ id: this.lastId, event: this.event || "message", data: this.data.join("\n") });
      }
      this.data = [];
      this.event = "";
    }
    return events;
  }

  private field(line: string): void {
    const colon = line.indexOf(":");
    const name = colon < 0 ? line : line.slice(0, colon);
    const value = colon < 0 ? "" : line.slice(colon + 1).replace(/^ /, "");
    if (name === "data") this.data.push(value);
    else if (name === "event") this.event = value;
    else if (name === "id" && !value.includes("\0")) this.lastId = value;
  }
}

export type Connection = { state: "open" } | { state: "waiting"; seconds: number } | { state: "refused"; status: number };

interface Listener {
  onEvent(event: ServerEvent): void;
  onConnection(connection: Connection): void;
}

const FIRST_WAIT_S = 1;
const LONGEST_WAIT_S = 15;
/** The service sends a sign of life every 15 s; a stream that is silent for longer is dead. */
const SILENCE_MS = 40_000;
/** The service means what it says with these: only another token or another service will help. */
const FINAL = new Set([400, 401, 403, 404, 405, 501]);

/** How long to wait before the next attempt, seconds. */
export function waitBeforeAttempt(failures: number): number {
  return Math.min(FIRST_WAIT_S * 2 ** Math.max(failures - 1, 0), LONGEST_WAIT_S);
}

/** Follows a stream until closed; comes back with Last-Event-ID after the service restarted or the network was gone. */
export class EventStream {
  private closed = new AbortController();

  constructor(
    private readonly url: string,
    private readonly token: () => string | null,
    private readonly listener: Listener,
    /** Of the last event that is known already. */
    private lastId = "",
  ) {
    void this.follow();
  }

  close(): void {
    this.closed.abort();
  }

  private async follow(): Promise<void> {
    let failures = 0;
    while (!this.closed.signal.aborted) {
      const outcome = await this.attempt();
      if (this.closed.signal.aborted) return;
      if (typeof outcome === "number" && FINAL.has(outcome)) {
        this.listener.onConnection({ state: "refused", status: outcome });
        return;
      }
      failures = outcome === "heard" ? 1 : failures + 1;
      const seconds = waitBeforeAttempt(failures);
      this.listener.onConnection({ state: "waiting", seconds });
      await this.pause(seconds * 1000);
    }
  }

  /** One connection; the status if it was refused, else whether anything was heard before it broke. */
  private async attempt(): Promise<number | "heard" | "nothing"> {
    const broken = new AbortController();
    const signal = AbortSignal.any([this.closed.signal, broken.signal]);
    const headers: Record<string, string> = { Accept: "text/event-stream" };
    const token = this.token();
    if (token) headers["Authorization"] = `Bearer ${token}`;
    if (this.lastId) headers["Last-Event-ID"] = this.lastId;
    let silence = setTimeout(() => broken.abort(), SILENCE_MS);
    let heard = false;
    try {
      const response = await fetch(this.url, { headers, signal, cache: "no-store" });
      if (!response.ok || !response.body) return response.status;
      this.listener.onConnection({ state: "open" });
      const parser = new EventParser();
      parser.lastId = this.lastId;
      const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
      for (;;) {
        const { done, value } = await reader.read();
        if (done) return heard ? "heard" : "nothing";
        heard = true;
        clearTimeout(silence);
        silence = setTimeout(() => broken.abort(), SILENCE_MS);
        for (const event of parser.push(value)) {
          this.lastId = event.id;
          this.listener.onEvent(event);
        }
      }
    } catch {
      return heard ? "heard" : "nothing";
    } finally {
      clearTimeout(silence);
    }
  }

  /** Wait, but not when the browser says that the network is back or the page is looked at again. */
  private pause(ms: number): Promise<void> {
    return new Promise((resolve) => {
      const done = (): void => {
        clearTimeout(timer);
        removeEventListener("online", done);
        this.closed.signal.removeEventListener("abort", done);
        resolve();
      };
      const timer = setTimeout(done, ms);
      addEventListener("online", done);
      this.closed.signal.addEventListener("abort", done);
    });
  }
}
