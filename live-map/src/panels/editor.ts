/** Drawing and correcting spots on the map. */

import type { Feature, FeatureCollection, Polygon } from "geojson";

import { announce, element } from "../dom";
import { isSimple, type LonLat, type RectangleShape, rectangle, shapeOf } from "../geometry/plane";
import type { CityMap } from "../map/city_map";
import { OutlineHandles } from "../map/outline_handles";
import { type Service, ServiceError } from "../service/client";
import { KINDS, type Spot } from "../spots/spot";
import type { SpotBook } from "../spots/spot_book";
import { complain, toast } from "./toasts";

/** A car's length kerbside, and the width of a usual bay. */
const NEW_SPOT = { lengthM: 5.5, widthM: 2.2 };
const CORNERS = 4;

interface Draft {
  /** Of the spot that is corrected; null for a new one. */
  id: string | null;
  corners: LonLat[];
}

export class Editor {
  readonly element: HTMLElement;
  onSaved: () => void = () => {};
  onTokenNeeded: () => void = () => {};
  admitted: () => boolean = () => true;
  private draft: Draft | null = null;
  private readonly handles: OutlineHandles;
  private readonly start = element("div", { className: "stack" });
  private readonly form = element("form", { className: "stack", hidden: true });
  private readonly title = element("h3", { id: "draft-title" });
  private readonly hint = element("p", { className: "hint", role: "status" });
  private readonly name = element("input", { type: "text", id: "draft-id", required: true, maxLength: 100, autocomplete: "off" });
  private readonly kind = element(
    "select",
    { id: "draft-kind" },
    ...KINDS.map((kind) => element("option", { value: kind, textContent: kind })),
  );
  private readonly size = {
    lengthM: number("draft-length", 0.1, 1, 60),
    widthM: number("draft-width", 0.1, 1, 60),
    headingDeg: number("draft-heading", 1, -360, 360),
  };
  private readonly save = element("button", { type: "submit", className: "button", textContent: "Save spot" });
  private readonly erase = button("Delete spot", "danger", () => void this.remove());

  constructor(
    private readonly service: Service,
    private readonly city: CityMap,
    private readonly book: SpotBook,
  ) {
    this.handles = new OutlineHandles(city);
    this.handles.onChange = (corners) => this.reshaped(corners);
    this.start.append(
      element("p", {
        className: "hint",
        textContent:
          "Draw a spot corner by corner, or put one in the middle of the map and move it into place. " +
          "To correct a spot, choose it and press “Correct outline”.",
      }),
      element(
        "div",
        { className: "actions stacked" },
        button("Draw four corners", "", () => this.draw()),
        button("Put one in the middle", "quiet", () => this.place()),
        button("Export parking map", "quiet", () => void this.exportMap()),
      ),
    );
    this.form.append(
      this.title,
      this.hint,
      field("Name", this.name),
      field("Kind", this.kind),
      element(
        "div",
        { className: "triple" },
        field("Length, m", this.size.lengthM),
        field("Width, m", this.size.widthM),
        field("Heading, °", this.size.headingDeg),
      ),
      element("div", { className: "actions" }, this.save, this.erase, button("Cancel", "quiet", () => this.stop())),
    );
    this.form.setAttribute("aria-labelledby", "draft-title");
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      void this.store();
    });
    for (const input of Object.values(this.size)) input.addEventListener("change", () => this.resized());
    this.element = element("section", {}, element("h2", { textContent: "Parking map" }), this.start, this.form);
    this.element.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.stop();
    });
  }

  /** Correct the outline of a spot. */
  edit(spot: Spot): void {
    const ring = spot.outline.coordinates[0] ?? [];
    this.open({ id: spot.id, corners: ring.slice(0, -1).map(([lon = 0, lat = 0]): LonLat => [lon, lat]) });
    this.kind.value = (KINDS as readonly string[]).includes(spot.kind) ? spot.kind : "unknown";
    this.handles.show(this.draft?.corners ?? []);
    this.title.textContent = `Spot ${spot.id}`;
    this.hint.textContent = "Drag a corner, the middle to move it, the knob to turn it; or focus one of them and use the arrow keys.";
  }

  private draw(): void {
    this.open({ id: null, corners: [] });
    this.title.textContent = "New spot";
    this.hint.textContent = cornerText(0);
    this.city.aiming(true);
    this.city.capture = (at) => this.corner(at);
    this.city.focus();
  }

  private place(): void {
    const heading = this.city.map.getBearing();
    this.open({ id: null, corners: rectangle(this.city.centre, NEW_SPOT.lengthM, NEW_SPOT.widthM, heading) });
    this.title.textContent = "New spot";
    this.hint.textContent = "Move it into place: drag it, or focus a handle and use the arrow keys.";
    this.handles.show(this.draft?.corners ?? []);
    this.name.focus();
  }

  private open(draft: Draft): void {
    this.stop();
    this.draft = draft;
    this.start.hidden = true;
    this.form.hidden = false;
    this.name.value = draft.id ?? this.freeName();
    this.name.readOnly = draft.id !== null;
    this.erase.hidden = draft.id === null;
    this.kind.value = "parallel";
    this.reshaped(draft.corners);
  }

  /** Leave the draft, unsaved. */
  stop(): void {
    this.draft = null;
    this.city.capture = null;
    this.city.aiming(false);
    this.handles.hide();
    this.city.setData("draft", []);
    this.start.hidden = false;
    this.form.hidden = true;
  }

  /** Another panel shows: an outline that is complete waits, one that is not is dropped. */
  rest(): void {
    if (!this.drafting) this.stop();
  }

  get drafting(): boolean {
    return this.draft?.corners.length === CORNERS;
  }

  private corner(at: LonLat): boolean {
    if (!this.draft) return false;
    const corners = [...this.draft.corners, at];
    this.reshaped(corners);
    if (corners.length < CORNERS) {
      this.hint.textContent = cornerText(corners.length);
      announce(this.hint.textContent);
      return true;
    }
    this.city.capture = null;
    this.city.aiming(false);
    if (!isSimple(corners)) {
      toast("These corners cross or enclose nothing: go around the spot, one corner after the other", "error");
      this.draw();
      return true;
    }
    this.hint.textContent = "Drag the corners into place, name the spot and save it.";
    this.handles.show(corners);
    announce("Four corners set");
    this.name.focus();
    return true;
  }

  private reshaped(corners: LonLat[]): void {
    if (!this.draft) return;
    this.draft.corners = corners;
    this.city.setData("draft", draftFeatures(corners));
    const whole = corners.length === CORNERS;
    this.save.disabled = corners.length < CORNERS;
    for (const input of Object.values(this.size)) input.disabled = !whole;
    const shape = whole ? shapeOf(corners) : null;
    this.size.lengthM.value = shape?.lengthM.toFixed(1) ?? "";
    this.size.widthM.value = shape?.widthM.toFixed(1) ?? "";
    this.size.headingDeg.value = shape?.headingDeg.toFixed(0) ?? "";
  }

  private resized(): void {
    if (this.draft?.corners.length !== CORNERS) return;
    const before = shapeOf(this.draft.corners);
    const value = (name: keyof typeof this.size): number => this.size[name].valueAsNumber;
    const after: RectangleShape = {
      centre: before.centre,
      lengthM: value("lengthM") || before.lengthM,
      widthM: value("widthM") || before.widthM,
      headingDeg: Number.isFinite(value("headingDeg")) ? value("headingDeg") : before.headingDeg,
    };
    const corners = rectangle(after.centre, after.lengthM, after.widthM, after.headingDeg);
    this.reshaped(corners);
    this.handles.show(corners);
  }

  private async store(): Promise<void> {
    const draft = this.draft;
    const id = this.name.value.trim();
    if (!draft || draft.corners.length < CORNERS || id === "") return;
    if (!isSimple(draft.corners)) {
      toast("The outline crosses itself or encloses nothing", "error");
      return;
    }
    if (draft.id === null && this.book.get(id)) {
      toast(`There is a spot ${id} already: give this one another name`, "error");
      this.name.focus();
      return;
    }
    const feature: Feature<Polygon> = {
      type: "Feature",
      id,
      geometry: { type: "Polygon", coordinates: [closed(draft.corners)] },
      properties: { spot_id: id, kind: this.kind.value },
    };
    await this.change(`Spot ${id} is not saved`, `Spot ${id} is saved`, () => this.service.saveSpot(id, feature));
  }

  private async remove(): Promise<void> {
    const id = this.draft?.id;
    if (!id || !confirm(`Delete spot ${id}?`)) return;
    await this.change(`Spot ${id} is not deleted`, `Spot ${id} is deleted`, () => this.service.deleteSpot(id));
  }

  private async change(failed: string, done: string, act: () => Promise<void>): Promise<void> {
    this.save.disabled = true;
    try {
      if (!this.admitted()) throw new ServiceError(401, "");
      await act();
      this.stop();
      toast(done);
      this.onSaved();
    } catch (error) {
      this.save.disabled = false;
      if (error instanceof ServiceError && error.unauthorized) {
        toast("Correcting the parking map needs an operator token: enter it here", "error");
        this.onTokenNeeded();
      } else if (error instanceof ServiceError && error.absent) {
        toast(`${failed}: this service cannot change its parking map`, "error");
      } else {
        complain(failed, error);
      }
    }
  }

  private async exportMap(): Promise<void> {
    try {
      download("parking_map.geojson", JSON.stringify(await this.wholeMap(), null, 1));
    } catch (error) {
      complain("No export", error);
    }
  }

  private async wholeMap(): Promise<FeatureCollection<Polygon>> {
    try {
      return await this.service.parkingMap();
    } catch (error) {
      if (!(error instanceof ServiceError && error.absent)) throw error;
      const features = Array.from(this.book.all(), ({ id, kind, outline }): Feature<Polygon> => {
        return { type: "Feature", id, geometry: outline, properties: { spot_id: id, kind } };
      });
      return { type: "FeatureCollection", features };
    }
  }

  private freeName(): string {
    let number = this.book.size + 1;
    while (this.book.get(`N-${number}`)) number += 1;
    return `N-${number}`;
  }
}

function draftFeatures(corners: LonLat[]): Feature[] {
  if (corners.length === 0) return [];
  if (corners.length < 3) {
    const line = corners.length === 1 ? [...corners, ...corners] : corners;
    return [{ type: "Feature", geometry: { type: "LineString", coordinates: line }, properties: {} }];
  }
  return [{ type: "Feature", geometry: { type: "Polygon", coordinates: [closed(corners)] }, properties: {} }];
}

/** As a ring of RFC 7946: counter-clockwise, the first corner again at the end. */
export function closed(corners: readonly LonLat[]): LonLat[] {
  const area = corners.reduce((sum, [x, y], i) => {
    const [u, v] = corners[(i + 1) % corners.length] ?? [x, y];
    return sum + (u - x) * (v + y);
  }, 0);
  const ring = area > 0 ? [...corners].reverse() : [...corners];
  const first = ring[0];
  return first ? [...ring, first] : [];
}

function cornerText(set: number): string {
  return `Corner ${set + 1} of ${CORNERS}: click on the map, or move it with the arrow keys and press Enter.`;
}

function field(label: string, input: HTMLElement): HTMLElement {
  return element("div", {}, element("label", { className: "label", htmlFor: input.id, textContent: label }), input);
}

function number(id: string, step: number, min: number, max: number): HTMLInputElement {
  return element("input", { type: "number", id, step: String(step), min: String(min), max: String(max) });
}

function button(text: string, kind: string, act: () => void): HTMLButtonElement {
  const made = element("button", { type: "button", className: `button ${kind}`.trim(), textContent: text });
  made.addEventListener("click", act);
  return made;
}

function download(name: string, text: string): void {
  const url = URL.createObjectURL(new Blob([text], { type: "application/geo+json" }));
  element("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 1000);
}
