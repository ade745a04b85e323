/** The feature map as points in space, drawn by a layer of our own. */

import { type CustomLayerInterface, type CustomRenderMethodInput, type Map as MapLibre, MercatorCoordinate } from "maplibre-gl";

import type { MapPoints } from "../service/client";

const VERTEX = `#version 300 es
uniform mat4 u_matrix;
uniform float u_size;
in vec3 a_position;
in vec3 a_colour;
out vec3 v_colour;
void main() {
  gl_Position = u_matrix * vec4(a_position, 1.0);
  gl_PointSize = u_size;
  v_colour = a_colour;
}`;
const FRAGMENT = `#version 300 es
precision mediump float;
in vec3 v_colour;
out vec4 colour;
void main() {
  if (length(gl_PointCoord - 0.5) > 0.5) discard;
  colour = vec4(v_colour, 1.0);
}`;

export class PointLayer implements CustomLayerInterface {
  readonly id = "feature-points";
  readonly type = "custom";
  readonly renderingMode = "3d";
  private map: MapLibre | null = null;
  private program: WebGLProgram | null = null;
  private buffer: WebGLBuffer | null = null;
  private arrangement: WebGLVertexArrayObject | null = null;
  private count = 0;
  /** Takes metres about the origin to mercator coordinates, column by column. */
  private toMercator = new Float64Array(16);

  onAdd(map: MapLibre, gl: WebGL2RenderingContext): void {
    this.map = map;
    this.program = linked(gl);
    this.buffer = gl.createBuffer();
    this.arrangement = gl.createVertexArray();
    gl.bindVertexArray(this.arrangement);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    for (const [name, offset] of [["a_position", 0], ["a_colour", 12]] as const) {
      const at = gl.getAttribLocation(this.program, name);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, 3, gl.FLOAT, false, 24, offset);
    }
    gl.bindVertexArray(null);
  }

  onRemove(_map: MapLibre, gl: WebGL2RenderingContext): void {
    gl.deleteProgram(this.program);
    gl.deleteBuffer(this.buffer);
    gl.deleteVertexArray(this.arrangement);
    this.map = null;
  }

  /** Show these points instead; `colours` are CSS hex colours by class label. */
  show(points: MapPoints, colours: readonly string[]): void {
    const gl = this.map?.getCanvas().getContext("webgl2");
    if (!gl) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, interleaved(points, colours), gl.STATIC_DRAW);
    gl.bindBuffer(gl.ARRAY_BUFFER, null);
    this.count = points.x.length;
    const { lon, lat } = points.origin;
    // Heights count from the ground of the map, which is drawn at zero.
    const origin = MercatorCoordinate.fromLngLat([lon, lat], 0);
    const scale = origin.meterInMercatorCoordinateUnits();
    this.toMercator = new Float64Array([
      scale, 0, 0, 0,
      0, -scale, 0, 0,
      0, 0, scale, 0,
      origin.x, origin.y, origin.z, 1,
    ]);
    this.map?.triggerRepaint();
  }

  clear(): void {
    this.count = 0;
    this.map?.triggerRepaint();
  }

  render(gl: WebGL2RenderingContext, { defaultProjectionData }: CustomRenderMethodInput): void {
    if (this.count === 0 || !this.program) return;
    // Multiplied in double precision: mercator coordinates as floats are a metre coarse.
    const matrix = new Float32Array(product(defaultProjectionData.mainMatrix, this.toMercator));
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(gl.getUniformLocation(this.program, "u_matrix"), false, matrix);
    gl.uniform1f(gl.getUniformLocation(this.program, "u_size"), 4 * devicePixelRatio);
    gl.bindVertexArray(this.arrangement);
    gl.drawArrays(gl.POINTS, 0, this.count);
    gl.bindVertexArray(null);
  }
}

/** Position and colour of each point, six floats. */
export function interleaved(points: MapPoints, colours: readonly string[]): Float32Array<ArrayBuffer> {
  const rgb = colours.map((hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255));
  const out = new Float32Array(points.x.length * 6);
  for (let i = 0; i < points.x.length; i++) {
    const colour = rgb[points.label[i] ?? 0] ?? rgb[0] ?? [0, 0, 0];
    out.set([points.x[i] ?? 0, points.y[i] ?? 0, points.z[i] ?? 0, ...colour], i * 6);
  }
  return out;
}

/** a b, both 4 x 4, column by column. */
export function product(a: ArrayLike<number>, b: ArrayLike<number>): Float64Array {
  const out = new Float64Array(16);
  for (let column = 0; column < 4; column++) {
    for (let row = 0; row < 4; row++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += (a[4 * k + row] ?? 0) * (b[4 * column + k] ?? 0);
      out[4 * column + row] = sum;
    }
  }
  return out;
}

function linked(gl: WebGL2RenderingContext): WebGLProgram {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]] as const) {
    const shader = gl.createShader(kind);
    if (!shader) throw new Error("no shader could be made");
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    gl.deleteShader(shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    throw new Error(`the points' shader does not link: ${gl.getProgramInfoLog(program) ?? ""}`);
  }
  return program;
}
