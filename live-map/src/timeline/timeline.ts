/** The bar below the map: go back in time, let it run, come back to now. */

import { announce, element, icon } from "../dom";
import { complain } from "../panels/toasts";
import { type Service, ServiceError } from "../service/client";
import { histogram } from "./histogram";
import type { Extent, Replay } from "./replay";

const FRAME_MS = 200;
const SPEEDS = [1, 10, 60, 300, 1800];
const SEEK_WAIT_MS = 120;
const EXTENT_MS = 30_000;
const MOST_FOR_HISTOGRAM = 5000;

export class Timeline {
  /** Whether the past is shown. */
  active = false;
  onMode: () => void = () => {};
  onTime: () => void = () => {};
  private extent: Extent | null = null;
  /** When spots changed, up to the newest change that was asked for. */
  private readonly times: number[] = [];
  private newest = 0;
  private timer: ReturnType<typeof setInterval> | undefined;
  private seeking: ReturnType<typeof setTimeout> | undefined;
  private readonly play = element("button", { type: "button", className: "icon-button", id: "play" });
  private readonly live = element("button", { type: "button", className: "button quiet", id: "back-to-live", textContent: "Live" });
  private readonly slider = element("input", { type: "range", id: "scrub", ariaLabel: "Time shown" });
  private readonly time = element("output", { className: "when", id: "time-shown" });
  private readonly chart = element("canvas", { className: "chart", ariaHidden: "true", width: 600, height: 22 });
  private readonly speed = element(
    "select",
    { id: "speed", ariaLabel: "Speed of the replay" },
    ...SPEEDS.map((speed) => element("option", { value: String(speed), textContent: `${speed}×` })),
  );

  constructor(
    private readonly place: HTMLElement,
    private readonly service: Service,
    private readonly replay: Replay,
  ) {
    this.speed.value = String(replay.speed);
    this.place.append(
      this.play,
      element("div", { className: "scrub" }, this.chart, this.slider),
      this.time,
      this.speed,
      this.live,
    );
    this.play.addEventListener("click", () => (this.timer ? this.pause() : void this.run()));
    this.live.addEventListener("click", () => this.backToLive());
    this.slider.addEventListener("input", () => this.scrub());
    this.speed.addEventListener("change", () => (this.replay.speed = Number(this.speed.value)));
    this.show();
  }

  async start(): Promise<void> {
    await this.lookUpExtent();
    setInterval(() => {
      if (!document.hidden) void this.lookUpExtent();
    }, EXTENT_MS);
  }

  private async lookUpExtent(): Promise<void> {
    try {
      const { start, end } = await this.service.historyExtent();
      this.extent = start === null || end === null ? null : { start, end: Math.max(end, start + 1) };
    } catch (error) {
      if (!(error instanceof ServiceError && (error.absent || error.status === 0))) complain("No history", error);
      if (error instanceof ServiceError && error.absent) this.extent = null;
    }
    this.show();
    if (this.extent) await this.drawChart(this.extent);
  }

  private async run(): Promise<void> {
    const extent = this.extent;
    if (!extent) return;
    if (!this.active || this.replay.at >= extent.end) await this.go(extent.start);
    clearInterval(this.timer);
    this.timer = setInterval(() => void this.tick(), FRAME_MS);
    this.show();
    announce("Replay plays");
  }

  private pause(): void {
    clearInterval(this.timer);
    this.timer = undefined;
    this.show();
  }

  private async tick(): Promise<void> {
    if (!this.extent) return;
    try {
      await this.replay.advance(FRAME_MS / 1000, this.extent);
    } catch (error) {
      this.pause();
      complain("The replay stopped", error);
    }
    if (this.replay.at >= this.extent.end) this.pause();
    this.show();
    this.onTime();
  }

  private scrub(): void {
    clearTimeout(this.seeking);
    const at = Number(this.slider.value);
    this.showTime(at);
    this.seeking = setTimeout(() => void this.go(at), SEEK_WAIT_MS);
  }

  /** Show the past as of a time. */
  private async go(at: number): Promise<void> {
    try {
      await this.replay.seek(at);
    } catch (error) {
      complain("That time cannot be shown", error);
      return;
    }
    const before = this.active;
    this.active = true;
    if (!before) this.onMode();
    this.onTime();
    this.show();
  }

  private backToLive(): void {
    this.pause();
    clearTimeout(this.seeking);
    if (!this.active) return;
    this.active = false;
    this.onMode();
    if (document.activeElement === this.live) this.play.focus(); // the button is about to go
    this.show();
    announce("Live again");
  }

  private show(): void {
    const { extent } = this;
    const playing = this.timer !== undefined;
    this.play.replaceChildren(icon(playing ? "pause" : "play"));
    this.play.ariaLabel = playing ? "Pause the replay" : "Replay the day";
    this.play.title = this.play.ariaLabel;
    this.play.disabled = this.slider.disabled = this.speed.disabled = extent === null;
    this.live.disabled = !this.active;
    this.place.classList.toggle("active", this.active);
    if (!extent) {
      this.time.textContent = "No history yet";
      return;
    }
    this.slider.min = String(Math.floor(extent.start));
    this.slider.max = String(Math.ceil(extent.end));
    this.slider.step = String(Math.max(1, Math.round((extent.end - extent.start) / 500)));
    const at = this.active ? this.replay.at : extent.end;
    if (this.seeking === undefined || this.active) this.slider.value = String(at);
    this.showTime(this.active ? at : null);
  }

  private showTime(at: number | null): void {
    const text = at === null ? "Now" : clockText(at, this.extent);
    this.time.textContent = text;
    this.slider.setAttribute("aria-valuetext", text);
  }

  private async drawChart(extent: Extent): Promise<void> {
    try {
      while (this.times.length < MOST_FOR_HISTOGRAM) {
        const page = await this.service.history(extent.start, extent.end, this.newest, 1000);
        this.times.push(...page.changes.map((change) => change.receivedAt));
        this.newest = page.changes.at(-1)?.number ?? this.newest;
        if (page.next === null) break;
      }
    } catch {
      return; // decoration: the slider works without
    }
    const pen = this.chart.getContext("2d");
    if (!pen) return;
    const { width, height } = this.chart;
    const bars = histogram(this.times, extent.start, extent.end, 120);
    const most = Math.max(...bars, 1);
    pen.clearRect(0, 0, width, height);
    pen.fillStyle = getComputedStyle(this.place).getPropertyValue("--quiet");
    bars.forEach((count, i) => {
      const tall = count === 0 ? 0 : Math.max(2, (count / most) * height);
      pen.fillRect((i * width) / bars.length, height - tall, width / bars.length - 1, tall);
    });
  }
}

/** The time of day, with the date if the history spans more than one. */
export function clockText(at: number, extent: Extent | null): string {
  const day = (seconds: number): string => new Date(seconds * 1000).toDateString();
  const time = new Date(at * 1000).toLocaleTimeString();
  if (extent && day(extent.start) !== day(extent.end)) {
    const date = new Date(at * 1000).toLocaleDateString(undefined, { day: "numeric", month: "short" });
    return `${date} ${time}`;
  }
  return time;
}
