/** Colours of the map. The page's own are in styles.css; states have the same in both. */

import type { State } from "../spots/spot";

export type Theme = "light" | "dark";

export interface Palette {
  ground: string;
  area: string;
  pavement: string;
  street: string;
  streetEdge: string;
  streetName: string;
  building: string;
  tree: string;
  text: string;
  halo: string;
  accent: string;
  car: string;
  carEdge: string;
  parked: string;
  spot: Record<State, { fill: string; line: string; text: string; halo: string }>;
  /** Colours of feature points by class label, see `world/labels.py`. */
  labels: string[];
}

const LABELS_LIGHT = [
  "#44566b", "#7c2fe0", "#7c2fe0", "#7c2fe0", "#b4459c", "#c2410c", "#c2410c", "#9a6700", "#9a6700", "#6e7781",
];
const LABELS_DARK = [
  "#9fb2c4", "#c9a1ff", "#c9a1ff", "#c9a1ff", "#ff9ee0", "#ffb077", "#ffb077", "#f2cc60", "#f2cc60", "#8b98a5",
];

export const PALETTES: Record<Theme, Palette> = {
  light: {
    ground: "#eceff1",
    area: "#e2eadf",
    pavement: "#dde2e7",
    street: "#ffffff",
    streetEdge: "#d3dae0",
    streetName: "#52616f",
    building: "#d9dfe5",
    tree: "#b9cfb2",
    text: "#14212b",
    halo: "#ffffff",
    accent: "#2b50e0",
    car: "#2b50e0",
    carEdge: "#ffffff",
    parked: "#c9857b",
    spot: {
      vacant: { fill: "#12a36f", line: "#04694a", text: "#ffffff", halo: "#06714f" },
      occupied: { fill: "#e2aaa2", line: "#9f342a", text: "#7a1f17", halo: "#f7e3e0" },
      unknown: { fill: "#d5dbe0", line: "#64727f", text: "#3d4a55", halo: "#f2f4f6" },
    },
    labels: LABELS_LIGHT,
  },
  dark: {
    ground: "#0f151b",
    area: "#14201b",
    pavement: "#182129",
    street: "#202b35",
    streetEdge: "#33424f",
    streetName: "#9db0c0",
    building: "#2b3947",
    tree: "#1f3a2c",
    text: "#e8eef3",
    halo: "#0f151b",
    accent: "#7f9bff",
    car: "#8ea6ff",
    carEdge: "#0f151b",
    parked: "#b5665a",
    spot: {
      vacant: { fill: "#1fbf83", line: "#7df0c3", text: "#03271a", halo: "#4fdca6" },
      occupied: { fill: "#5c2f2b", line: "#ff8d7a", text: "#ffd9d2", halo: "#3a1815" },
      unknown: { fill: "#2b3640", line: "#8fa0ae", text: "#cfd9e1", halo: "#1a232b" },
    },
    labels: LABELS_DARK,
  },
};
