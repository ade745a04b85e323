/** Tabs as in the WAI-ARIA authoring practices: arrows move between them, one panel shows. */

import { element } from "../dom";

export interface Tab {
  id: string;
  label: string;
  panel: HTMLElement;
  onShow?: () => void;
  onHide?: () => void;
}

export class Tabs {
  readonly element: HTMLElement;
  private buttons: HTMLButtonElement[];
  private shown = -1;

  constructor(
    private readonly tabs: readonly Tab[],
    label: string,
  ) {
    this.buttons = tabs.map((tab, index) => {
      const button = element("button", {
        type: "button",
        role: "tab",
        id: `tab-${tab.id}`,
        textContent: tab.label,
        attributes: { "aria-controls": `panel-${tab.id}` },
      });
      button.addEventListener("click", () => this.show(tab.id));
      button.addEventListener("keydown", (event) => this.move(event, index));
      tab.panel.id = `panel-${tab.id}`;
      tab.panel.setAttribute("role", "tabpanel");
      tab.panel.setAttribute("aria-labelledby", button.id);
      tab.panel.classList.add("tab-panel");
      return button;
    });
    const list = element("div", { role: "tablist", className: "tabs", ariaLabel: label }, ...this.buttons);
    this.element = element("div", { className: "tabbed" }, list, ...tabs.map((tab) => tab.panel));
    this.show(tabs[0]?.id ?? "");
  }

  get current(): string {
    return this.tabs[this.shown]?.id ?? "";
  }

  show(id: string): void {
    const chosen = this.tabs.findIndex((tab) => tab.id === id);
    if (chosen === this.shown || chosen < 0) return;
    const before = this.tabs[this.shown];
    this.shown = chosen;
    this.tabs.forEach((tab, index) => {
      const on = index === chosen;
      const button = this.buttons[index];
      tab.panel.hidden = !on;
      button?.setAttribute("aria-selected", String(on));
      if (button) button.tabIndex = on ? 0 : -1;
    });
    before?.onHide?.();
    this.tabs[chosen]?.onShow?.();
  }

  private move(event: KeyboardEvent, from: number): void {
    const last = this.tabs.length - 1;
    const to = {
      ArrowRight: from === last ? 0 : from + 1,
      ArrowLeft: from === 0 ? last : from - 1,
      Home: 0,
      End: last,
    }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    this.show(this.tabs[to]?.id ?? "");
    this.buttons[to]?.focus();
  }
}
