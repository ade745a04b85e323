/** Images that the map draws with: hatching of taken spots, dots of unknown ones, a car seen from above. */

import type { Palette } from "./palette";

const SIZE = 16;

export function images(palette: Palette): Record<string, ImageData> {
  return {
    hatched: drawn(SIZE, SIZE, (pen) => {
      pen.strokeStyle = palette.spot.occupied.line;
      pen.lineWidth = 2.4;
      for (const shift of [-SIZE, 0, SIZE]) {
        pen.moveTo(shift - 2, SIZE + 2);
        pen.lineTo(shift + SIZE + 2, -2);
      }
      pen.stroke();
    }),
    dotted: drawn(SIZE, SIZE, (pen) => {
      pen.fillStyle = palette.spot.unknown.line;
      for (const [x, y] of [[4, 4], [12, 12]] as const) {
        pen.beginPath();
        pen.arc(x, y, 1.4, 0, 2 * Math.PI);
        pen.fill();
      }
    }),
    car: drawn(48, 96, (pen) => carFromAbove(pen, palette)),
  };
}

/** 44 pixels wide and 92 long, nose up. */
function carFromAbove(pen: CanvasRenderingContext2D, palette: Palette): void {
  pen.lineWidth = 4;
  pen.strokeStyle = palette.carEdge;
  pen.fillStyle = palette.car;
  pen.beginPath();
  pen.roundRect(4, 3, 40, 90, [16, 16, 10, 10]);
  pen.stroke();
  pen.fill();
  pen.fillStyle = palette.carEdge;
  pen.globalAlpha = 0.75;
  pen.beginPath();
  pen.roundRect(9, 28, 30, 14, [8, 8, 3, 3]);
  pen.roundRect(10, 74, 28, 9, [3, 3, 6, 6]);
  pen.fill();
  pen.globalAlpha = 1;
}

function drawn(width: number, height: number, draw: (pen: CanvasRenderingContext2D) => void): ImageData {
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  const pen = canvas.getContext("2d", { willReadFrequently: true });
  if (!pen) throw new Error("this browser cannot draw on a canvas");
  draw(pen);
  return pen.getImageData(0, 0, width, height);
}
