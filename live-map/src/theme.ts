/** Light or dark: as the system says until the reader chooses. */

import type { Theme } from "./map/palette";

const KEY = "autowaze-theme";
const dark = matchMedia("(prefers-color-scheme: dark)");

export function currentTheme(): Theme {
  const chosen = localStorage.getItem(KEY);
  return chosen === "light" || chosen === "dark" ? chosen : dark.matches ? "dark" : "light";
}

export function chooseTheme(theme: Theme): void {
  localStorage.setItem(KEY, theme);
  applyTheme();
}

export function applyTheme(): Theme {
  const theme = currentTheme();
  document.documentElement.dataset["theme"] = theme;
  return theme;
}

/** Calls when the system changes its mind. */
export function onSystemTheme(listener: () => void): void {
  dark.addEventListener("change", listener);
}
