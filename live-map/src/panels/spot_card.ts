/** All that is known of the chosen spot. */

import { announce, element, icon } from "../dom";
import { type LonLat, shapeOf } from "../geometry/plane";
import { ageText, chanceText, percent, type Spot, STATE_NAME } from "../spots/spot";

export class SpotCard {
  readonly element = element("section", { className: "card", hidden: true, ariaLabel: "Chosen spot" });
  onClose: () => void = () => {};
  onEdit: (spot: Spot) => void = () => {};
  onRoute: (spot: Spot) => void = () => {};
  private saidOf = "";

  constructor(private readonly now: () => number) {}

  show(spot: Spot | null): void {
    this.element.hidden = spot === null;
    if (!spot) {
      this.saidOf = "";
      return;
    }
    const age = spot.observedAt === null ? null : this.now() - spot.observedAt;
    const seen = age === null ? "never" : ageText(Math.max(age, 0));
    const corners = (spot.outline.coordinates[0] ?? []).slice(0, -1).map(([lon = 0, lat = 0]): LonLat => [lon, lat]);
    const size = shapeOf(corners);
    const held = this.element.contains(document.activeElement)
      ? (document.activeElement as HTMLElement).dataset["action"]
      : undefined;
    this.element.replaceChildren(
      element(
        "header",
        {},
        element("h2", { textContent: `Spot ${spot.id}` }),
        this.button("close", "icon-button", icon("close"), () => this.onClose(), "Close spot"),
      ),
      element(
        "p",
        { className: "verdict", data: { state: spot.state } },
        element("span", { className: "swatch", ariaHidden: "true", data: { state: spot.state } }),
        element("strong", { textContent: STATE_NAME[spot.state] }),
        element("span", { textContent: chanceText(spot) }),
      ),
      element("meter", {
        min: 0,
        max: 1,
        value: spot.probability,
        ariaLabel: "Probability that the spot is free",
        className: "chance",
      }),
      facts([
        ["Chance that it is free", percent(spot.probability)],
        ["Last seen", seen],
        ["Kind", spot.kind],
        ["Size", `${size.lengthM.toFixed(1)} × ${size.widthM.toFixed(1)} m`],
      ]),
      element(
        "div",
        { className: "actions" },
        this.button("route", "button", "Route to it", () => this.onRoute(spot)),
        this.button("edit", "button quiet", "Correct outline", () => this.onEdit(spot)),
      ),
    );
    if (held) this.element.querySelector<HTMLElement>(`[data-action="${held}"]`)?.focus();
    const words = `Spot ${spot.id}: ${STATE_NAME[spot.state]}, ${chanceText(spot)}`;
    if (this.saidOf !== words) announce(`${words}, last seen ${seen}`);
    this.saidOf = words;
  }

  private button(
    action: string,
    className: string,
    content: Node | string,
    act: () => void,
    label?: string,
  ): HTMLButtonElement {
    const made = element("button", { type: "button", className, data: { action } }, content);
    if (label) made.ariaLabel = label;
    made.addEventListener("click", act);
    return made;
  }
}

export function facts(rows: readonly (readonly [string, string])[]): HTMLDListElement {
  return element(
    "dl",
    { className: "facts" },
    ...rows.flatMap(([name, value]) => [element("dt", { textContent: name }), element("dd", { textContent: value })]),
  );
}
