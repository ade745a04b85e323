import { defineConfig } from "vite";

const service = process.env["AUTOWAZE_SERVICE"] ?? "http://127.0.0.1:8080";
const routes = [
  "/spots", "/spots.geojson", "/changes", "/history", "/nearest", "/stats", "/fleet", "/streets.geojson",
  "/map/points", "/parking_map.geojson",
];

export default defineConfig({
  build: {
    outDir: "../src/autowaze/cloud/dashboard",
    emptyOutDir: true,
    target: "es2022",
    assetsInlineLimit: 0,
    chunkSizeWarningLimit: 1500,
  },
  worker: { format: "es" },
  server: { proxy: Object.fromEntries(routes.map((path) => [path, { target: service }])) },
});
