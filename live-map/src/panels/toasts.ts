/** Short messages about what happened. */

import { byId, element, icon } from "../dom";

const SHOWN_MS = 8000;
const MOST = 3;

export function toast(text: string, kind: "info" | "error" = "info"): void {
  const region = byId("toasts");
  for (const same of region.querySelectorAll<HTMLElement>(".toast")) {
    if (same.dataset["text"] === text) same.remove();
  }
  const close = element("button", { type: "button", className: "icon-button", ariaLabel: "Dismiss" }, icon("close"));
  const message = element(
    "div",
    { className: `toast ${kind}`, role: kind === "error" ? "alert" : "status", data: { text } },
    element("p", { textContent: text }),
    close,
  );
  close.addEventListener("click", () => message.remove());
  region.append(message);
  while (region.childElementCount > MOST) region.firstElementChild?.remove();
  setTimeout(() => message.remove(), SHOWN_MS);
}

/** What went wrong in the words of the one that refused. */
export function complain(doing: string, error: unknown): void {
  const reason = error instanceof Error ? error.message : String(error);
  toast(`${doing}: ${reason}`, "error");
}
