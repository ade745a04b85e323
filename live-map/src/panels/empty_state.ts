/** What to do when there is nothing to see yet. */

import { element } from "../dom";
import type { SpotBook } from "../spots/spot_book";

export function showEmptyState(place: HTMLElement, book: SpotBook): void {
  const spots = book.size > 0;
  const seen = Array.from(book.all()).some((spot) => spot.observedAt !== null);
  place.hidden = seen;
  const state = spots ? "unseen" : "empty";
  if (seen || place.dataset["state"] === state) return;
  place.dataset["state"] = state;
  place.classList.toggle("low", spots);
  const [title, text, command] = spots
    ? [
        "No car has looked yet",
        `${book.size.toLocaleString()} spots are known, none has been seen. They turn free or taken as cars hand in what they saw:`,
        `autowaze drive TRACE --cloud ${location.origin}`,
      ]
    : [
        "No parking spots yet",
        "Draw the first one under “Draw”, or start the service with a parking map:",
        "autowaze cloud --spots street.geojson",
      ];
  place.replaceChildren(
    element("h2", { textContent: title }),
    element("p", { textContent: text }),
    element("code", { textContent: command }),
  );
}
