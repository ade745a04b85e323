/** How the service does: rates, delays, times of its stages; and the operator's token. */

import { element } from "../dom";
import { type Service, ServiceError, type Stats } from "../service/client";
import { bytesText } from "./activity";
import { facts } from "./spot_card";
import { toast } from "./toasts";

const POLL_MS = 1000;
/** In the order in which a diff goes through them. */
const STAGES = ["decode", "admission", "integration", "grouping", "outliers", "boxes", "occupancy", "broadcast"];
export const TOKEN_KEY = "autowaze-token";

export class ServicePanel {
  readonly element: HTMLElement;
  onToken: () => void = () => {};
  cars: () => number | null = () => null;
  private readonly figures = element("div", { className: "figures" });
  private readonly stages = element("div", { className: "stages" });
  private readonly token = element("input", {
    type: "password",
    id: "token",
    autocomplete: "off",
    spellcheck: false,
    attributes: { "aria-describedby": "token-hint" },
  });
  private timer: ReturnType<typeof setInterval> | undefined;

  constructor(private readonly service: Service) {
    const form = element(
      "form",
      { className: "token" },
      element("label", { htmlFor: "token", className: "label", textContent: "Operator token" }),
      this.token,
      element("p", {
        className: "hint",
        id: "token-hint",
        textContent: "To see cars and correct spots. It is kept in this tab only, until you close it.",
      }),
      element(
        "div",
        { className: "actions" },
        element("button", { type: "submit", className: "button", textContent: "Use token" }),
        this.forgetButton(),
      ),
    );
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const value = this.token.value.trim();
      if (value) sessionStorage.setItem(TOKEN_KEY, value);
      this.token.value = "";
      toast(value ? "The token is used from now on" : "Type a token first");
      if (value) this.onToken();
    });
    this.element = element(
      "section",
      {},
      element("h2", { textContent: "Service" }),
      this.figures,
      element("h3", { textContent: "Time per diff, by stage" }),
      this.stages,
      form,
    );
  }

  start(): void {
    this.stop();
    void this.poll();
    this.timer = setInterval(() => void this.poll(), POLL_MS);
  }

  stop(): void {
    clearInterval(this.timer);
    this.timer = undefined;
  }

  focusToken(): void {
    this.token.focus();
  }

  private async poll(): Promise<void> {
    if (document.hidden) return;
    try {
      this.show(await this.service.stats());
    } catch (error) {
      const absent = error instanceof ServiceError && error.absent;
      this.figures.replaceChildren(
        element("p", {
          className: "hint",
          textContent: absent ? "This service tells no figures." : "The service does not answer; trying again.",
        }),
      );
      if (absent) this.stop();
    }
  }

  private show(stats: Stats): void {
    const cars = this.cars();
    const rows: [string, string][] = [
      ["Diffs taken in", stats.diffs.total.toLocaleString()],
      ["Diffs per second", stats.diffs.per_second.toFixed(1)],
      ["Received", bytesText(stats.diffs.bytes_total)],
      ["To broadcast, median", delayText(stats.delay_ms.p50)],
      ["To broadcast, 99 % within", delayText(stats.delay_ms.p99)],
      ["Map features", stats.map_features.toLocaleString()],
      ["Map version", stats.map_version.toLocaleString()],
      ...(cars === null ? [] : [["Cars on the map", String(cars)] satisfies [string, string]]),
      ["Listeners", stats.listeners.toLocaleString()],
      ["Running for", durationText(stats.uptime_s)],
    ];
    this.figures.replaceChildren(facts(rows));
    const stages = Object.entries(stats.stages_ms).sort(([a], [b]) => STAGES.indexOf(a) - STAGES.indexOf(b));
    const longest = Math.max(...stages.map(([, ms]) => ms), 1e-9);
    this.stages.replaceChildren(
      ...(stages.length > 0
        ? stages.map(([name, ms]) => bar(name, ms, ms / longest))
        : [element("p", { className: "hint", textContent: "No diff was taken in yet." })]),
    );
  }

  private forgetButton(): HTMLButtonElement {
    const forget = element("button", { type: "button", className: "button quiet", textContent: "Forget it" });
    forget.addEventListener("click", () => {
      sessionStorage.removeItem(TOKEN_KEY);
      this.token.value = "";
      toast("The token is forgotten");
      this.onToken();
    });
    return forget;
  }
}

function bar(name: string, ms: number, share: number): HTMLElement {
  const fill = element("span", { className: "fill" });
  fill.style.inlineSize = `${(share * 100).toFixed(1)}%`;
  return element(
    "div",
    { className: "stage-time" },
    element("span", { textContent: name.replaceAll("_", " ") }),
    element("span", { className: "bar-track", ariaHidden: "true" }, fill),
    element("span", { className: "ms", textContent: `${ms.toFixed(ms < 10 ? 1 : 0)} ms` }),
  );
}

function delayText(ms: number | null): string {
  return ms === null ? "–" : `${ms.toFixed(ms < 10 ? 1 : 0)} ms`;
}

export function durationText(seconds: number): string {
  if (seconds < 90) return `${Math.round(seconds)} s`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`;
  if (seconds < 48 * 3600) return `${(seconds / 3600).toFixed(1)} h`;
  return `${Math.round(seconds / 86400)} days`;
}
