/** Search for the nearest free spot: from where, how, and what was found. */

import { Marker } from "maplibre-gl";

import { announce, element, icon } from "../dom";
import type { LonLat } from "../geometry/plane";
import type { CityMap } from "../map/city_map";
import { type Mode, type NearSpot, type Service, ServiceError } from "../service/client";
import { percent, type Spot } from "../spots/spot";
import type { SpotBook } from "../spots/spot_book";
import { nearestByAir } from "../spots/straight_line";
import { complain, toast } from "./toasts";

export class Finder {
  readonly element: HTMLElement;
  onChoose: (id: string) => void = () => {};
  private mode: Mode = "walking";
  private from: LonLat | null = null;
  private found: NearSpot[] = [];
  private target: string | null = null;
  private searches = 0;
  private readonly results = element("ol", { className: "results", ariaLabel: "Nearest free spots" });
  private readonly hint = element("p", { className: "hint", role: "status" });
  private readonly pick = button("Pick on the map", () => this.aim(this.pick.ariaPressed !== "true"), "quiet");
  private readonly clear = button("Clear", () => this.reset(), "quiet");
  private readonly pin = new Marker({ element: element("div", { className: "pin", ariaHidden: "true" }) });

  constructor(
    private readonly service: Service,
    private readonly city: CityMap,
    private readonly book: SpotBook,
  ) {
    this.pick.ariaPressed = "false";
    this.clear.hidden = true;
    this.element = element(
      "section",
      {},
      element("h2", { textContent: "Nearest free spot" }),
      element(
        "fieldset",
        { className: "choice" },
        element("legend", { className: "visually-hidden", textContent: "How you get there" }),
        this.modeChoice("walking", "Walking", "walk"),
        this.modeChoice("driving", "Driving", "drive"),
      ),
      element(
        "div",
        { className: "actions stacked" },
        button("Search from the middle of the map", () => void this.search(this.city.centre)),
        this.pick,
        button("Use my location", () => this.locate(), "quiet"),
        this.clear,
      ),
      this.hint,
      this.results,
    );
    this.hint.textContent = "Choose where to start from. The route and the chance that the spot is still free show here.";
  }

  /** Look for free spots around a place. */
  async search(from: LonLat): Promise<void> {
    this.aim(false);
    this.from = from;
    this.clear.hidden = false;
    this.pin.setLngLat(from).addTo(this.city.map);
    const search = ++this.searches;
    this.hint.textContent = "Searching";
    try {
      const found = await this.ask(from);
      if (search === this.searches) this.show(found);
    } catch (error) {
      this.hint.textContent = "The search failed.";
      complain("No search", error);
    }
  }

  /** The way to one spot, from where the last search began or else from the middle of the map. */
  async routeTo(spot: Spot): Promise<void> {
    await this.search(this.from ?? this.city.centre);
    const found = this.found.find(({ spotId }) => spotId === spot.id);
    if (found) this.head(found);
    else if (spot.state === "vacant") toast(`Nearer spots are free; ${spot.id} is not among the first ${this.found.length}`);
    else toast(`Spot ${spot.id} is not free: here are the nearest that are`);
  }

  /** A click on the ground; true if it was waited for. */
  takes(at: LonLat): boolean {
    if (this.pick.ariaPressed !== "true") return false;
    void this.search(at);
    return true;
  }

  /** Spots turned: if the one that is headed for is no longer free, look again. */
  spotsChanged(flipped: readonly Spot[]): void {
    const lost = flipped.find((spot) => spot.id === this.target && spot.state !== "vacant");
    if (!lost || !this.from) return;
    toast(`Spot ${lost.id} is no longer free: searching again`);
    void this.search(this.from);
  }

  private async ask(from: LonLat): Promise<NearSpot[]> {
    try {
      return await this.service.nearest(from[0], from[1], this.mode);
    } catch (error) {
      if (error instanceof ServiceError && error.absent) return nearestByAir(this.book.all(), from, this.mode);
      throw error;
    }
  }

  private show(found: NearSpot[]): void {
    this.found = found;
    const first = found[0];
    this.results.replaceChildren(...found.map((spot) => this.row(spot)));
    if (!first) {
      this.target = null;
      this.city.showRoute(null);
      this.hint.textContent = "No free spot is known around here. Spots that nobody looked at lately are not offered.";
      return;
    }
    this.hint.textContent = first.routed ? "" : "As the crow flies: the service knows no way along streets.";
    this.head(first);
    announce(`${found.length} free spots. Nearest: ${first.spotId}, ${wayText(first)}, ${arrivalText(first)}`);
  }

  private row(spot: NearSpot): HTMLElement {
    const made = element(
      "button",
      { type: "button", data: { spot: spot.spotId } },
      element("span", { className: "name", textContent: spot.spotId }),
      element("span", { className: "what", textContent: wayText(spot) }),
      element(
        "span",
        { className: "when" },
        element("strong", { textContent: percent(spot.onArrival) }),
        " free on arrival",
      ),
    );
    made.addEventListener("click", () => {
      this.head(spot);
      this.onChoose(spot.spotId);
    });
    return element("li", {}, made);
  }

  private head(spot: NearSpot): void {
    this.target = spot.spotId;
    this.city.showRoute(spot.route);
    this.city.select(spot.spotId);
    for (const row of this.results.querySelectorAll("button")) {
      row.setAttribute("aria-current", String(row.dataset["spot"] === spot.spotId));
    }
    const lon = [...spot.route.coordinates.map((c) => c[0] ?? 0), spot.lonLat[0]];
    const lat = [...spot.route.coordinates.map((c) => c[1] ?? 0), spot.lonLat[1]];
    this.city.fit([Math.min(...lon), Math.min(...lat), Math.max(...lon), Math.max(...lat)]);
  }

  private reset(): void {
    this.searches += 1;
    this.from = this.target = null;
    this.found = [];
    this.aim(false);
    this.pin.remove();
    this.city.showRoute(null);
    this.city.select(null);
    this.results.replaceChildren();
    this.clear.hidden = true;
    this.hint.textContent = "Choose where to start from.";
  }

  private aim(on: boolean): void {
    this.pick.ariaPressed = String(on);
    this.pick.textContent = on ? "Click on the map, or press Enter in it" : "Pick on the map";
    this.city.aiming(on);
  }

  private locate(): void {
    navigator.geolocation.getCurrentPosition(
      ({ coords }) => {
        this.city.look([coords.longitude, coords.latitude], 17);
        void this.search([coords.longitude, coords.latitude]);
      },
      (error) => complain("Your location is not known", error.message),
      { enableHighAccuracy: true, timeout: 10_000 },
    );
  }

  private modeChoice(mode: Mode, label: string, symbol: "walk" | "drive"): HTMLElement {
    const input = element("input", { type: "radio", name: "mode", value: mode, checked: mode === this.mode });
    input.addEventListener("change", () => {
      this.mode = mode;
      if (this.from && this.found.length > 0) void this.search(this.from);
    });
    return element("label", {}, input, icon(symbol), label);
  }
}

export function wayText({ distanceM, durationS }: NearSpot): string {
  const distance = distanceM < 995 ? `${Math.round(distanceM / 5) * 5} m` : `${(distanceM / 1000).toFixed(1)} km`;
  const time = durationS < 45 ? "under a minute" : `${Math.max(1, Math.round(durationS / 60))} min`;
  return `${distance}, ${time}`;
}

function arrivalText({ onArrival }: NearSpot): string {
  return `${percent(onArrival)} free on arrival`;
}

function button(text: string, act: () => void, kind = ""): HTMLButtonElement {
  const made = element("button", { type: "button", className: `button ${kind}`.trim(), textContent: text });
  made.addEventListener("click", act);
  return made;
}
