/** The live map: what is made of what, and how news from the service gets to where it shows. */

import { announce, byId, element, icon } from "./dom";
import { principalAxis } from "./geometry/principal_axis";
import { CityMap } from "./map/city_map";
import type { Waypoint } from "./map/car_track";
import { FleetLayer } from "./map/fleet_layer";
import { PointLayer } from "./map/point_layer";
import { showEmptyState } from "./panels/empty_state";
import { ActivityLog, type DiffEvent } from "./panels/activity";
import { Editor } from "./panels/editor";
import { Finder } from "./panels/finder";
import { ServicePanel, TOKEN_KEY } from "./panels/service_panel";
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
import { Replay } from "./timeline/replay";
import { Timeline } from "./timeline/timeline";
import { applyTheme, chooseTheme, currentTheme, onSystemTheme } from "./theme";

/** States fade while nobody looks, which is no event: ask for them now and then. */
const REFRESH_MS = 60_000;

export class LiveMap {
  private readonly token = (): string | null => sessionStorage.getItem(TOKEN_KEY);
  private readonly service = new Service(this.token);
  private readonly clock = new ServiceClock();
  private readonly live = new SpotBook();
  private readonly replay = new Replay(this.service);
  private readonly timeline = new Timeline(byId("timeline"), this.service, this.replay);
  /** Of what is shown: of the service, or of the past. */
  private readonly now = (): number => (this.timeline.active ? this.replay.now() : this.clock.now());
  private readonly city = new CityMap(byId("map"), currentTheme(), this.now);
  private readonly fleet = new FleetLayer(this.city);
  private readonly points = new PointLayer();
  private readonly card = new SpotCard(this.now);
  private readonly list = new SpotList(() => this.shown, this.now);
  private readonly log = new ActivityLog();
  private readonly finder = new Finder(this.service, this.city, this.live);
  private readonly editor = new Editor(this.service, this.city, this.live);
  private readonly servicePanel = new ServicePanel(this.service);
  private readonly tabs: Tabs;
  private fleetStream: EventStream | null = null;
  private connection: Connection = { state: "waiting", seconds: 0 };
  private chosen: string | null = null;
  private settled = false;

  constructor() {
    this.tabs = new Tabs(
      [
        { id: "find", label: "Find", panel: this.finder.element },
        { id: "spots", label: "Spots", panel: this.list.element, onShow: () => this.list.show() },
        { id: "activity", label: "Activity", panel: this.log.element },
        {
          id: "service",
          label: "Service",
          panel: this.servicePanel.element,
          onShow: () => this.servicePanel.start(),
          onHide: () => this.servicePanel.stop(),
        },
        { id: "draw", label: "Draw", panel: this.editor.element, onHide: () => this.editor.rest() },
      ],
      "What to show",
    );
    byId("panel").append(this.card.element, this.tabs.element);
    this.live.onChange((event) => this.changed(this.live, event));
    this.replay.book.onChange((event) => this.changed(this.replay.book, event));
    this.timeline.onMode = () => this.switchTime();
    this.timeline.onTime = () => this.showConnection();
    this.list.onChoose = (id) => this.choose(id, true);
    this.list.view = () => this.city.view;
    this.city.onSpot = (id) => this.choose(id, false);
    this.city.onGround = (at) => this.finder.takes(at);
    this.finder.onChoose = (id) => this.choose(id, false);
    this.card.onClose = () => this.choose(null, false);
    this.card.onRoute = (spot) => this.routeTo(spot);
    this.card.onEdit = (spot) => this.edit(spot);
    this.editor.onSaved = () => void this.refresh();
    this.editor.onTokenNeeded = () => this.askForToken();
    this.editor.admitted = () => this.admitted;
    this.servicePanel.onToken = () => {
      this.followFleet();
      if (this.editor.drafting) this.tabs.show("draw");
    };
    this.servicePanel.cars = () => (this.fleetStream ? this.fleet.count : null);
    this.setUpTheme();
    this.setUpTools();
  }

  async start(): Promise<void> {
    await this.city.ready;
    this.city.map.addLayer(this.points, "cars");
    if (this.offered("streets")) void this.loadStreets();
    await this.refresh();
    this.city.map.on("moveend", () => this.list.show());
    const listener = {
      onEvent: (event: ServerEvent) => this.onChange(event),
      onConnection: (connection: Connection) => {
        this.connection = connection;
        this.showConnection();
      },
    };
    new EventStream("/changes", this.token, listener, String(this.live.version));
    this.followFleet();
    await this.timeline.start();
    setInterval(() => {
      if (!document.hidden) void this.refresh();
    }, REFRESH_MS);
    document.addEventListener("visibilitychange", () => {
      if (!document.hidden) void this.refresh();
    });
  }

  /** What the service has for everyone; the page was told when it was made. */
  private offered(name: string): boolean {
    return (document.documentElement.dataset["offers"] ?? "streets open").split(" ").includes(name);
  }

  /** Whether it makes sense to ask for what not everyone may have. */
  private get admitted(): boolean {
    return this.token() !== null || this.offered("open");
  }

  private get shown(): SpotBook {
    return this.timeline.active ? this.replay.book : this.live;
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

  /** All spots anew: what the map shows first, after a gap, and now and then because states fade. */
  private async refresh(): Promise<void> {
    try {
      let answer = await this.service.spots();
      // A change overtook the answer: ask again rather than go back.
      if (answer.version < this.live.version) answer = await this.service.spots();
      this.clock.settle(answer.now);
      this.live.replace(answer.spots, answer.version);
    } catch (error) {
      complain("The spots could not be fetched", error);
    }
  }

  private onChange({ id, event, data }: ServerEvent): void {
    if (event === "spots") {
      const { spots } = JSON.parse(data) as { spots: Parameters<typeof changeFromRecord>[0][] };
      const changes = spots.map(changeFromRecord);
      for (const { observedAt } of changes) if (observedAt !== null) this.clock.reach(observedAt);
      this.live.apply(changes, Number(id));
    } else if (event === "reset") {
      this.live.version = 0;
      void this.refresh();
    } else if (event === "parking_map") {
      this.log.note("The parking map was changed");
      void this.refresh();
    }
  }

  private followFleet(): void {
    this.fleetStream?.close();
    this.fleetStream = null;
    if (!this.admitted) return;
    this.fleetStream = new EventStream("/fleet/changes", this.token, {
      onEvent: ({ event, data }) => {
        if (event === "car") {
          const { car, path } = JSON.parse(data) as { car: string; path: Waypoint[] };
          if (!this.timeline.active) this.fleet.drive(car, path);
        } else if (event === "diff") {
          const diff = JSON.parse(data) as DiffEvent;
          this.log.diff(diff);
          if (!this.timeline.active) this.fleet.ring(diff.car);
        }
      },
      onConnection: ({ state }) => {
        if (state !== "refused") return;
        this.fleetStream = null;
        if (this.token()) toast("This token does not let you see cars", "error");
      },
    });
  }

  private changed(book: SpotBook, event: BookEvent): void {
    if (book === this.live && event.kind === "changed") {
      this.log.spots(event.flipped);
      this.finder.spotsChanged(event.flipped);
    }
    if (book === this.live && event.kind === "replaced") this.settle();
    if (book !== this.shown) return;
    if (event.kind === "replaced") this.city.showSpots(book);
    else this.city.updateSpots(book, event.spots);
    if (event.kind === "changed" && event.flipped.length > 0) announce(flippedText(event.flipped));
    this.showPanels();
  }

  /** From now to the past or back. */
  private switchTime(): void {
    this.city.showSpots(this.shown);
    this.fleet.hide(this.timeline.active);
    this.showPanels();
    this.showConnection();
  }

  private showPanels(): void {
    showSummary(byId("summary"), this.shown.summary());
    this.list.show();
    this.card.show(this.chosen === null ? null : (this.shown.get(this.chosen) ?? null));
    showEmptyState(byId("empty"), this.shown);
  }

  private settle(): void {
    const bounds = this.live.bounds();
    if (!bounds || this.settled) return;
    this.settled = true;
    const axis = principalAxis(Array.from(this.live.all(), (spot) => spot.centre));
    if (axis !== null) this.city.turn(axis);
    this.city.settle(bounds);
  }

  private choose(id: string | null, look: boolean): void {
    this.chosen = id;
    const spot = id === null ? undefined : this.shown.get(id);
    this.city.select(spot?.id ?? null);
    this.card.show(spot ?? null);
    if (spot) byId("panel").scrollTo({ top: 0 }); // the card is above the list, which may be long
    if (spot && look) this.city.look(spot.centre);
  }

  private routeTo(spot: Spot): void {
    this.tabs.show("find");
    void this.finder.routeTo(spot);
  }

  private edit(spot: Spot): void {
    this.tabs.show("draw");
    this.city.look(spot.centre, 20);
    this.editor.edit(spot);
  }

  private askForToken(): void {
    this.tabs.show("service");
    this.servicePanel.focusToken();
  }

  private showConnection(): void {
    const place = byId("connection");
    const { state } = this.connection;
    place.dataset["state"] = this.timeline.active ? "replay" : state;
    if (this.timeline.active) place.textContent = "Replay";
    else place.textContent = { open: "Live", waiting: "Reconnecting", refused: "Not connected" }[state];
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
      this.pointsTool(tool),
    );
  }

  private pointsTool(tool: (name: "points", label: string, act: () => void) => HTMLButtonElement): HTMLButtonElement {
    const fetchPoints = async (): Promise<void> => {
      try {
        const points = await this.service.mapPoints(...this.city.view);
        if (button.ariaPressed !== "true") return;
        this.points.show(points, this.city.colours.labels);
        this.city.show(["parked"], false); // the points of a parked car are inside of it
        announce(`${points.count.toLocaleString()} features of the map are shown as points`);
      } catch (error) {
        if (button.ariaPressed !== "true") return;
        button.ariaPressed = "false";
        this.explainNoPoints(error);
      }
    };
    const button = tool("points", "Feature map as points", () => {
      const on = button.ariaPressed !== "true";
      if (on && !this.admitted) {
        this.explainNoPoints(new ServiceError(401, ""));
        return;
      }
      button.ariaPressed = String(on);
      if (on) void fetchPoints();
      else {
        this.points.clear();
        this.city.show(["parked"], true);
      }
    });
    button.ariaPressed = "false";
    let waiting: ReturnType<typeof setTimeout> | undefined;
    this.city.map.on("moveend", () => {
      clearTimeout(waiting);
      if (button.ariaPressed === "true") waiting = setTimeout(() => void fetchPoints(), 300);
    });
    return button;
  }

  private explainNoPoints(error: unknown): void {
    if (error instanceof ServiceError && error.unauthorized) {
      toast("The feature map needs a token with the scope map: enter it here", "error");
      this.askForToken();
    } else if (error instanceof ServiceError && error.absent) {
      toast("This service does not show its feature map", "error");
    } else {
      complain("No feature map", error);
    }
  }
}

function flippedText(spots: readonly Spot[]): string {
  if (spots.length > 3) return `${spots.length} spots changed`;
  return spots.map((spot) => `Spot ${spot.id} is now ${STATE_NAME[spot.state].toLowerCase()}`).join(", ");
}
