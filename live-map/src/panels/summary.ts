/** How many spots are free, taken, unknown; the legend of the map at the same time. */

import { element } from "../dom";
import { STATE_NAME, STATES } from "../spots/spot";
import type { Summary } from "../spots/spot_book";

export function showSummary(list: HTMLElement, counts: Summary): void {
  list.replaceChildren(
    ...STATES.map((state) =>
      element(
        "li",
        { data: { state } },
        element("span", { className: "swatch", ariaHidden: "true", data: { state } }),
        element("strong", { textContent: counts[state].toLocaleString() }),
        element("span", { className: "word", textContent: ` ${STATE_NAME[state].toLowerCase()}` }),
      ),
    ),
  );
}
