/** The live map: what is made of what, and how news from the service gets to where it shows. */

import { announce, byId, element, icon } from "./dom";
import { CityMap } from "./map/city_map";
import { ActivityLog } from "./panels/activity";
import { SpotCard } from "./panels/spot_card";
import { SpotList } from "./panels/spot_list";
import { showSummary } from "./panels/summary";
import { Tabs } from "./panels/tabs";
import { complain, toast } from "./panels/toasts";
import { changeFromRecord, Service, ServiceError } from "./service/client";
import { ServiceClock } from "./service/clock";
import { type Connection, EventStream, type ServerEvent } from "./service/event_stream";
import { STATE_NAME, type Spot } from "./spots/spot";
import { type BookEvent, SpotBook } from "./spots/spot_book";
import { applyTheme, chooseTheme, currentTheme, onSystemTheme } from "./theme";

/** States fade while nobody looks, which is no event: ask for them now and then. */
const REFRESH_MS = 60_000;

export class LiveMap {
  private readonly token = (): string | null => sessionStorage.getItem("autowaze-token");
  private readonly service = new Service(this.token);
  private readonly clock = new ServiceClock();
  private readonly live = new SpotBook();
  private readonly city = new CityMap(byId("map"), currentTheme(), this.clock.now);
  private readonly card = new SpotCard(this.clock.now);
  private readonly list = new SpotList(() => this.live, this.clock.now);
  private readonly log = new ActivityLog();
  private readonly tabs: Tabs;
  private chosen: string | null = null;
  private settled = false;

  constructor() {
    this.tabs = new Tabs(
      [
        { id: "spots", label: "Spots", panel: this.list.element, onShow: () => this.list.show() },
        { id: "activity", label: "Activity", panel: this.log.element },
      ],
      "What to show",
    );
    byId("panel").append(this.card.element, this.tabs.element);
    this.live.onChange((event) => this.showBook(event));
    this.list.onChoose = (id) => this.choose(id, true);
    this.list.view = () => this.view();
    this.city.onSpot = (id) => this.choose(id, false);
    this.card.onClose = () => this.choose(null, false);
    this.setUpTheme();
    this.setUpTools();
  }

  async start(): Promise<void> {
    await this.city.ready;
    void this.loadStreets();
    await this.refresh();
    this.city.map.on("moveend", () => this.list.show());
    new EventStream("/changes", this.token, {
      onEvent: (event) => this.onChange(event),
      onConnection: (connection) => this.showConnection(connection),
    });
    setInterval(() => void this.refresh(), REFRESH_MS);
  }

  private async loadStreets(): Promise<void> {
    try {
      const streets = await this.service.streets();
      this.city.setStreets(streets);
      byId("attribution").hidden = !streets.attribution;
      byId("attribution").textContent = streets.attribution ?? "";
    } catch (error) {
      if (!(error instanceof ServiceError && error.absent)) complain("No streets", error);
    }
  }

  private async refresh(): Promise<void> {
    try {
      const answer = await this.service.spots();
      this.clock.settle(answer.now);
      this.live.replace(answer.spots, answer.version);
    } catch (error) {
      complain("No spots", error);
    }
  }

  private onChange({ id, event, data }: ServerEvent): void {
    if (event === "spots") {
      const { spots } = JSON.parse(data) as { spots: Parameters<typeof changeFromRecord>[0][] };
      const changes = spots.map(changeFromRecord);
      for (const { observedAt } of changes) if (observedAt !== null) this.clock.reach(observedAt);
      this.live.apply(changes, Number(id));
    } else if (event === "reset") {
      void this.refresh();
    }
  }

  private showBook(event: BookEvent): void {
    if (event.kind === "replaced") {
      this.settle();
      this.city.showSpots(this.live);
    } else {
      this.city.updateSpots(this.live, event.spots);
      this.log.spots(event.flipped);
      if (event.flipped.length > 0) announce(flippedText(event.flipped));
    }
    showSummary(byId("summary"), this.live.summary());
    this.list.show();
    this.card.show(this.chosen === null ? null : (this.live.get(this.chosen) ?? null));
  }

  private settle(): void {
    const bounds = this.live.bounds();
    if (bounds && !this.settled) this.city.settle(bounds);
    this.settled ||= bounds !== null;
  }

  private choose(id: string | null, look: boolean): void {
    this.chosen = id;
    const spot = id === null ? undefined : this.live.get(id);
    this.city.select(spot?.id ?? null);
    this.card.show(spot ?? null);
    if (spot && look) this.city.look(spot.centre);
  }

  private view(): [number, number, number, number] {
    const bounds = this.city.map.getBounds();
    return [bounds.getWest(), bounds.getSouth(), bounds.getEast(), bounds.getNorth()];
  }

  private showConnection(connection: Connection): void {
    const place = byId("connection");
    place.dataset["state"] = connection.state;
    if (connection.state === "open") place.textContent = "Live";
    else if (connection.state === "waiting") place.textContent = "Reconnecting";
    else place.textContent = "Not connected";
    if (connection.state === "refused") toast(`The service refuses changes (${connection.status})`, "error");
  }

  private setUpTheme(): void {
    const button = byId("theme");
    const show = (): void => {
      const theme = applyTheme();
      const other = theme === "dark" ? "light" : "dark";
      button.replaceChildren(icon(theme === "dark" ? "sun" : "moon"));
      button.ariaLabel = `Switch to ${other} colours`;
      button.title = button.ariaLabel;
    };
    const change = (): void => {
      show();
      void this.city.ready.then(() => this.city.setTheme(currentTheme()));
    };
    button.addEventListener("click", () => {
      chooseTheme(currentTheme() === "dark" ? "light" : "dark");
      change();
    });
    onSystemTheme(change);
    show();
  }

  private setUpTools(): void {
    const tool = (name: Parameters<typeof icon>[0], label: string, act: () => void): HTMLButtonElement => {
      const button = element("button", { type: "button", className: "icon-button", ariaLabel: label, title: label }, icon(name));
      button.addEventListener("click", act);
      return button;
    };
    const tilt = tool("cube", "Tilted view", () => {
      this.city.tilt(!this.city.tilted);
      tilt.ariaPressed = String(!this.city.tilted);
    });
    tilt.ariaPressed = "true";
    this.city.map.on("pitchend", () => (tilt.ariaPressed = String(this.city.tilted)));
    byId("map-tools").append(
      tool("frame", "Show all spots", () => {
        const bounds = this.live.bounds();
        if (bounds) this.city.fit(bounds);
      }),
      tilt,
    );
  }
}

function flippedText(spots: readonly Spot[]): string {
  if (spots.length > 3) return `${spots.length} spots changed`;
  return spots.map((spot) => `Spot ${spot.id} is now ${STATE_NAME[spot.state].toLowerCase()}`).join(", ");
}
