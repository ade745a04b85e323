/** What happened lately: diffs that arrived, spots that turned. */

import { element } from "../dom";
import { percent, confidence, type Spot, STATE_NAME } from "../spots/spot";

const MOST = 120;

export interface DiffEvent {
  car: string;
  sequence: number;
  bytes: number;
  new: number;
  removed: number;
  received_at: number;
  map_version: number;
}

export class ActivityLog {
  readonly element: HTMLElement;
  private readonly list = element("ol", { className: "log", ariaLabel: "Newest first" });
  private readonly hint = element("p", { className: "hint", textContent: "Nothing yet. What cars report shows here." });

  constructor() {
    this.element = element("section", {}, this.hint, this.list);
  }

  spots(flipped: readonly Spot[]): void {
    for (const spot of flipped) {
      const state = STATE_NAME[spot.state].toLowerCase();
      this.add(Date.now() / 1000, spot.state, `Spot ${spot.id} is ${state}`, `${percent(confidence(spot))} sure`);
    }
  }

  diff(event: DiffEvent): void {
    this.add(event.received_at, "diff", `Car ${event.car.slice(0, 4)} sent ${bytesText(event.bytes)}`, featuresText(event));
  }

  note(text: string): void {
    this.add(Date.now() / 1000, "note", text, "");
  }

  private add(at: number, kind: string, text: string, detail: string): void {
    const time = new Date(at * 1000);
    this.hint.hidden = true;
    this.list.prepend(
      element(
        "li",
        { data: { kind } },
        element("span", { className: "swatch", ariaHidden: "true", data: { state: kind } }),
        element("span", { className: "what", textContent: text }),
        element("time", { dateTime: time.toISOString(), textContent: time.toLocaleTimeString() }),
        element("span", { className: "detail", textContent: detail }),
      ),
    );
    while (this.list.childElementCount > MOST) this.list.lastElementChild?.remove();
  }
}

export function bytesText(bytes: number): string {
  if (bytes < 1000) return `${bytes} B`;
  if (bytes < 1e6) return `${(bytes / 1000).toFixed(1)} kB`;
  if (bytes < 1e9) return `${(bytes / 1e6).toFixed(1)} MB`;
  return `${(bytes / 1e9).toFixed(1)} GB`;
}

function featuresText(event: DiffEvent): string {
  const parts = [event.new > 0 && `${event.new} new`, event.removed > 0 && `${event.removed} gone`].filter(Boolean);
  return parts.length === 0 ? "no feature changed" : `${parts.join(", ")} features`;
}
