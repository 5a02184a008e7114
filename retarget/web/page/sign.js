// A sign that hangs before a headset: the state of the run in large letters, and a red field that stops it.
import { program } from "../bodies.js";

const AWAY = 1.3, ABOVE = 0.32; // m from the eyes: the ghost stands free below
const HALF = [0.5, 0.28]; // m
const SIZE = [1024, 574]; // px
const STOP_SHARE = 0.3; // of the height, at the bottom
const SLOWNESS = 0.92; // share of the old heading that the sign keeps each frame

const TEXTS = [`
uniform mat4 view, projection, place;
uniform vec2 size;
out vec2 at;
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  at = vec2(corner.x, 1.0 - corner.y);
  gl_Position = projection * view * place * vec4((2.0 * corner - 1.0) * size, 0.0, 1.0);
}`, `
uniform sampler2D picture;
in vec2 at;
out vec4 shown;
void main() { shown = texture(picture, at); }`];

// Breaks a text into at most `most` lines of the pen's font.
function lines(pen, text, width, most) {
  const found = [""];
  for (const word of text.split(" ")) {
    const longer = `${found.at(-1)} ${word}`.trim();
    if (pen.measureText(longer).width <= width || !found.at(-1)) found[found.length - 1] = longer;
    else found.push(word);
  }
  return found.slice(0, most);
}

export class Sign {
  constructor(gl) {
    this.gl = gl;
    this.program = program(gl, TEXTS);
    this.array = gl.createVertexArray();
    this.texture = gl.createTexture();
    this.pen = new OffscreenCanvas(...SIZE).getContext("2d");
    this.written = "";
    this.yaw = null;
    this.place = new Float32Array(16);
  }

  // Hangs before the eyes of a viewer (its XRRigidTransform), upright, and follows the heading slowly.
  follow({ position: p, orientation: q }) {
    const yaw = Math.atan2(2 * (q.x * q.z + q.w * q.y), 1 - 2 * (q.x * q.x + q.y * q.y));
    if (this.yaw === null) this.yaw = yaw;
    const turn = Math.atan2(Math.sin(yaw - this.yaw), Math.cos(yaw - this.yaw));
    this.yaw += (1 - SLOWNESS) * turn;
    const [c, s] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    this.place.set([c, 0, -s, 0, 0, 1, 0, 0, s, 0, c, 0, p.x - AWAY * s, p.y + ABOVE, p.z - AWAY * c, 1]);
  }

  // True if a ray (matrix; along -z) meets the red field.
  pointedAt(ray) {
    const m = this.place, [axis, up, normal] = [0, 4, 8].map((k) => m.subarray(k, k + 3));
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const direction = [-ray[8], -ray[9], -ray[10]];
    const from = [0, 1, 2].map((k) => ray[12 + k] - m[12 + k]);
    const far = -dot(normal, from) / dot(normal, direction);
    if (!(far > 0)) return false;
    const hit = from.map((value, k) => value + far * direction[k]);
    const height = (dot(up, hit) / HALF[1] + 1) / 2;
    return Math.abs(dot(axis, hit)) < HALF[0] && height > 0 && height < STOP_SHARE;
  }

  write({ state, why, note }, bareHands) {
    const key = JSON.stringify([state, why, note, bareHands]);
    if (key === this.written) return;
    this.written = key;
    const { pen } = this, [width, height] = SIZE, red = height * (1 - STOP_SHARE);
    pen.clearRect(0, 0, width, height);
    pen.fillStyle = "rgb(17 21 27 / 0.88)";
    pen.fillRect(0, 0, width, red);
    pen.fillStyle = "#c5221f";
    pen.fillRect(0, red, width, height - red);
    pen.fillStyle = "#ffffff";
    pen.textAlign = "center";
    this.#text(state.charAt(0).toUpperCase() + state.slice(1), 92, 104, 1, true);
    this.#text(note || why || "", 46, 190, 3, false);
    this.#text("STOP", 88, red + 88, 1, true);
    this.#text(bareHands ? "pinch both hands for 1 s, or pinch here" : "A, B, X or Y, or the trigger here", 38, red + 146, 1, false);
    this.#upload();
  }

  #text(text, size, y, most, bold) {
    const { pen } = this;
    pen.font = `${bold ? 700 : 400} ${size}px system-ui, sans-serif`;
    lines(pen, text, SIZE[0] - 60, most).forEach((line, i) => pen.fillText(line, SIZE[0] / 2, y + 1.2 * size * i, SIZE[0] - 40));
  }

  #upload() {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, true);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, this.pen.canvas);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
  }

  draw(view, projection) {
    const { gl, program: { made, uniforms: at } } = this;
    gl.useProgram(made);
    gl.bindVertexArray(this.array);
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.CULL_FACE);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.uniformMatrix4fv(at.view, false, view);
    gl.uniformMatrix4fv(at.projection, false, projection);
    gl.uniformMatrix4fv(at.place, false, this.place);
    gl.uniform2f(at.size, ...HALF);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.bindVertexArray(null);
  }
}
