/** The spots in view as a list: what the canvas shows, for keyboards and screen readers, and for finding one by name. */

import { element } from "../dom";
import { ageText, chanceText, type Spot, type State, STATE_NAME, STATES } from "../spots/spot";
import type { SpotBook } from "../spots/spot_book";

/** More would neither be read nor be quick; the map zooms in, the filter narrows. */
export const MOST_SHOWN = 100;

const byName = new Intl.Collator(undefined, { numeric: true });

export interface Selection {
  states: ReadonlySet<State>;
  text: string;
  /** West, south, east, north; null takes all. */
  view: readonly [number, number, number, number] | null;
}

/** Spots that a selection lets through, free ones first, then by name. */
export function selected(spots: Iterable<Spot>, { states, text, view }: Selection): Spot[] {
  const wanted = text.trim().toLowerCase();
  const found = Array.from(spots).filter(({ id, state, centre: [lon, lat] }) => {
    if (!states.has(state) || !id.toLowerCase().includes(wanted)) return false;
    return wanted !== "" || !view || (lon >= view[0] && lat >= view[1] && lon <= view[2] && lat <= view[3]);
  });
  const rank = (spot: Spot): number => STATES.indexOf(spot.state);
  return found.sort((a, b) => rank(a) - rank(b) || byName.compare(a.id, b.id));
}

export class SpotList {
  readonly element: HTMLElement;
  onChoose: (id: string) => void = () => {};
  view: () => Selection["view"] = () => null;
  private readonly list = element("ul", { className: "rows", ariaLabel: "Spots" });
  private readonly count = element("p", { className: "hint", id: "spot-count" });
  private readonly search = element("input", {
    type: "search",
    id: "spot-search",
    placeholder: "Name of a spot",
    autocomplete: "off",
  });
  private readonly states = new Set<State>(STATES);
  private rows = new Map<string, HTMLElement>();

  constructor(
    private readonly book: () => SpotBook,
    private readonly now: () => number,
  ) {
    this.search.addEventListener("input", () => this.show());
    const filters = STATES.map((state) => this.filter(state));
    this.element = element(
      "section",
      {},
      element("label", { htmlFor: "spot-search", textContent: "Find by name", className: "label" }),
      this.search,
      element("div", { className: "filters", role: "group", ariaLabel: "States shown" }, ...filters),
      this.count,
      this.list,
    );
  }

  show(): void {
    if (this.element.hidden) return;
    const spots = selected(this.book().all(), { states: this.states, text: this.search.value, view: this.view() });
    const shown = spots.slice(0, MOST_SHOWN);
    const before = this.rows;
    this.rows = new Map(shown.map((spot) => [spot.id, this.row(spot, before.get(spot.id))]));
    const rows = [...this.rows.values()];
    const same = rows.length === this.list.childElementCount && rows.every((row, i) => this.list.children[i] === row);
    if (!same) this.replaceRows(rows);
    const total = this.book().size;
    this.count.textContent =
      spots.length > MOST_SHOWN
        ? `The first ${MOST_SHOWN} of ${spots.length.toLocaleString()}: zoom in or search by name.`
        : `${spots.length} of ${total} ${total === 1 ? "spot" : "spots"}${this.search.value ? "" : " in view"}`;
  }

  private replaceRows(rows: HTMLElement[]): void {
    const held = this.list.contains(document.activeElement) ? (document.activeElement as HTMLElement) : null;
    this.list.replaceChildren(...rows);
    if (held?.isConnected) held.focus({ preventScroll: true });
  }

  private row(spot: Spot, before: HTMLElement | undefined): HTMLElement {
    const age = spot.observedAt === null ? "never seen" : ageText(Math.max(this.now() - spot.observedAt, 0));
    const chance = spot.observedAt === null ? "" : `, ${chanceText(spot).toLowerCase()}`;
    const words = STATE_NAME[spot.state] + chance;
    const row = before ?? this.newRow(spot.id);
    const [swatch, , state, when] = row.querySelectorAll<HTMLElement>("span");
    row.dataset["state"] = spot.state;
    if (swatch) swatch.dataset["state"] = spot.state;
    if (state && state.textContent !== words) state.textContent = words;
    if (when && when.textContent !== age) when.textContent = age;
    return row;
  }

  private newRow(id: string): HTMLElement {
    const button = element(
      "button",
      { type: "button" },
      element("span", { className: "swatch", ariaHidden: "true" }),
      element("span", { className: "name", textContent: id }),
      element("span", { className: "what" }),
      element("span", { className: "when" }),
    );
    button.addEventListener("click", () => this.onChoose(id));
    return element("li", { data: { spot: id } }, button);
  }

  private filter(state: State): HTMLElement {
    const box = element("input", { type: "checkbox", checked: true, id: `filter-${state}` });
    box.addEventListener("change", () => {
      if (box.checked) this.states.add(state);
      else this.states.delete(state);
      this.show();
    });
    return element(
      "label",
      { className: "chip", htmlFor: box.id },
      box,
      element("span", { className: "swatch", ariaHidden: "true", data: { state } }),
      STATE_NAME[state],
    );
  }
}
