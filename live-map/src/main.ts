import "maplibre-gl/dist/maplibre-gl.css";
import "./styles.css";

import { LiveMap } from "./live_map";
import { applyTheme } from "./theme";
import { element } from "./dom";

applyTheme();
try {
  void new LiveMap().start();
} catch (error) {
  // Almost always a browser without WebGL 2: say so, and where the same data is.
  const reason = error instanceof Error ? error.message : String(error);
  document.body.append(
    element(
      "p",
      { className: "empty", role: "alert" },
      `The map cannot be drawn here (${reason}). It needs WebGL 2; the same spots are at `,
      element("a", { href: "/spots.geojson", textContent: "/spots.geojson" }),
      ".",
    ),
  );
}
