// Bodies as solids and lines in WebGL 2, for reports, the pages of a run and the ghost in a headset.
//
//   const scene = Bodies.on(canvas);               // null where there is no WebGL 2: a sentence stands in its place
//   scene.add("robot", body, { offset, yaw, scale, alpha, rim });  // rim: it fades where it faces the viewer
//   scene.pose("robot", poses);                    // Float32Array, x y z qw qx qy qz for each link; null hides
//   scene.lines("soles", points, { colour, width, over });  // m, x y z x y z for each line; [] hides
//   scene.clear();                                 // of a canvas, whose size it follows; in a headset the caller does it
//   const [view, projection] = orbit(azimuth, elevation, distance, target, aspect);
//   scene.shadow = { at: [x, y], half };           // a square of the floor on which bodies cast a shadow; null: none
//   scene.draw(view, projection);                  // into the viewport that is set, of the canvas or of a headset
//
// body: {"height": m, "meshes": [{"link": i, "vertices": [x, y, z, ...], "faces": [a, b, c, ...], "colour": [r, g, b]}]}
// (colours 0 to 1). The world is REP-103: x forward, y left, z up, m. In a headset: multiply(view, TO_WEBXR) for `view`.
// A headset's canvas: new Bodies(gl) with a WebGL2RenderingContext that is `xrCompatible`.
const SENTENCE = "Bodies are drawn with WebGL 2, which this browser lacks or has switched off.";
const LIGHT = [0.47, -0.1, 0.877];
const HEAD = "#version 300 es\nprecision highp float;\n";

const SOLID = [`
uniform mat4 view, projection;
uniform vec4 at, turn; // turn: x y z w
uniform float flattened; // half the side of the shadow's square, 0: a body
layout(location = 0) in vec3 vertex;
layout(location = 1) in vec3 normal;
out vec3 outward, inView, seen;
out float height;
vec3 turned(vec3 v) { return v + 2.0 * cross(turn.xyz, cross(turn.xyz, v) + turn.w * v); }
void main() {
  vec3 place = at.xyz + turned(vertex);
  height = place.z;
  if (flattened > 0.0) place = vec3(place.xy - place.z * vec2(${LIGHT[0] / LIGHT[2]}, ${LIGHT[1] / LIGHT[2]}), 0.0);
  outward = turned(normal);
  inView = mat3(view) * outward;
  seen = (view * vec4(place, 1.0)).xyz;
  gl_Position = projection * vec4(seen, 1.0);
}`, `
uniform vec4 colour;
uniform float flattened, rim;
in vec3 outward, inView, seen;
in float height;
out vec4 shown;
void main() {
  vec3 normal = normalize(gl_FrontFacing ? outward : -outward), eye = normalize(seen); // from behind, through an opening
  float lit = max(dot(normal, vec3(${LIGHT})), 0.0), facing = abs(dot(normalize(inView), eye));
  vec3 light = mix(vec3(0.66, 0.64, 0.63), vec3(0.80, 0.81, 0.83), 0.5 + 0.5 * normal.z) + 0.27 * lit; // floor, sky, sun
  vec3 gloss = vec3(0.10 * pow(facing, 24.0));
  float alpha = colour.a * mix(1.0, pow(1.0 - facing, 2.0), rim);
  shown = flattened > 0.0 ? vec4(1.0 - 0.8 * clamp(height / flattened, 0.0, 1.0)) // what is high casts a faint shadow
    : vec4(min(colour.rgb * light * (0.80 + 0.24 * facing) + gloss, 1.0) * alpha, alpha);
}`];

// The floor's shadow: a picture of what the bodies cast on a square, drawn out of focus.
const SHADE = [`
uniform mat4 view, projection;
uniform vec3 square;
out vec2 at;
void main() {
  vec2 corner = 2.0 * vec2(gl_VertexID & 1, gl_VertexID >> 1) - 1.0;
  at = 0.5 + 0.5 * corner;
  gl_Position = projection * view * vec4(square.xy + square.z * corner, 0.0, 1.0);
}`, `
uniform sampler2D fallen;
in vec2 at;
out vec4 shown;
void main() {
  float dark = 0.0;
  for (int i = 0; i < 12; i++) { // Vogel's disc
    float angle = 2.4 * float(i), far = 0.018 * sqrt(float(i) + 0.5) / 3.5;
    dark += textureLod(fallen, at + far * vec2(cos(angle), sin(angle)), 1.5).r / 12.0;
  }
  shown = vec4(0.0, 0.0, 0.0, 0.34 * dark * dark * (3.0 - 2.0 * dark));
}`];
const SHADE_PX = 256;

// A line is a strip of two triangles that is `width` pixels wide; what is behind the viewer is cut off.
const LINE = [`
uniform mat4 view, projection;
uniform vec4 viewport;
uniform float width;
layout(location = 0) in vec3 start;
layout(location = 1) in vec3 end;
const float NEAR = 0.01;
void main() {
  vec4 a = projection * view * vec4(start, 1.0), b = projection * view * vec4(end, 1.0);
  if (a.w < NEAR && b.w > NEAR) a = mix(a, b, (NEAR - a.w) / (b.w - a.w));
  else if (b.w < NEAR && a.w > NEAR) b = mix(b, a, (NEAR - b.w) / (a.w - b.w));
  vec2 along = (b.xy / b.w - a.xy / a.w) * viewport.zw + 1e-6;
  vec4 place = gl_VertexID < 2 ? a : b;
  vec2 aside = width / viewport.zw * normalize(vec2(-along.y, along.x)) * (gl_VertexID % 2 == 0 ? 1.0 : -1.0);
  gl_Position = place + vec4(aside * place.w, 0.0, 0.0);
}`, `
uniform vec4 colour;
out vec4 shown;
void main() { shown = colour; }`];

export function program(gl, texts) {
  const made = gl.createProgram();
  texts.forEach((text, i) => {
    const shader = gl.createShader(i ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);
    gl.shaderSource(shader, HEAD + text);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  });
  gl.linkProgram(made);
  const uniforms = {};
  for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
    const { name } = gl.getActiveUniform(made, i);
    uniforms[name] = gl.getUniformLocation(made, name);
  }
  return { made, uniforms };
}

// Of corners: the sum of the normals of the faces that share them, so that what is round looks round.
function normals(vertices, faces) {
  const found = new Float32Array(vertices.length);
  for (let f = 0; f < faces.length; f += 3) {
    const [a, b, c] = [3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]];
    const [ux, uy, uz] = [0, 1, 2].map((k) => vertices[b + k] - vertices[a + k]);
    const [vx, vy, vz] = [0, 1, 2].map((k) => vertices[c + k] - vertices[a + k]);
    const normal = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    for (const corner of [a, b, c]) normal.forEach((value, k) => { found[corner + k] += value; });
  }
  return found;
}

export class Bodies {
  #solid; #line; #shade; #cast; #canvas;
  #bodies = new Map();
  #lines = new Map();

  shadow = null;

  constructor(gl) {
    this.gl = gl;
    this.#canvas = gl.canvas;
    this.#canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    this.#canvas.addEventListener("webglcontextrestored", () => this.#build());
    this.#build();
  }

  static on(canvas) {
    const gl = canvas.getContext("webgl2", { preserveDrawingBuffer: true });  // for print
    if (gl) return new Bodies(gl);
    const sentence = document.createElement("p");
    sentence.textContent = SENTENCE;
    canvas.replaceWith(sentence);
    return null;
  }

  add(name, body, { offset = [0, 0, 0], yaw = 0, scale = 1, alpha = 1, rim = false } = {}) {
    const [c, s] = [scale * Math.cos(yaw), scale * Math.sin(yaw)];
    const place = Float32Array.of(c, s, 0, 0, -s, c, 0, 0, 0, 0, scale, 0, ...offset, 1);
    this.#bodies.set(name, this.#load({ body, place, alpha, rim, poses: null }));
  }

  pose(name, poses) { if (this.#bodies.has(name)) this.#bodies.get(name).poses = poses; }

  lines(name, points, { colour = [0, 0, 0], width = 1.5, over = false } = {}) {
    const gl = this.gl, known = this.#lines.get(name) || this.#loadLines({});
    this.#lines.set(name, Object.assign(known, { points: Float32Array.from(points), colour, width, over }));
    gl.bindBuffer(gl.ARRAY_BUFFER, known.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, known.points, gl.DYNAMIC_DRAW);
  }

  clear() {
    const gl = this.gl;
    sharp(this.#canvas);
    gl.viewport(0, 0, this.#canvas.width, this.#canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  draw(view, projection) {
    const gl = this.gl;
    const bodies = [...this.#bodies.values()].filter(({ poses }) => poses).sort((a, b) => b.alpha - a.alpha);
    const lines = [...this.#lines.values()].filter(({ points }) => points.length);
    gl.disable(gl.CULL_FACE);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    if (this.shadow) this.#drawShadow(bodies, view, projection, [...this.shadow.at, this.shadow.half]);
    for (const line of lines) if (!line.over) this.#drawLines(line, view, projection);
    for (const body of bodies) {
      if (body.alpha < 1) {  // only its nearest surface is seen
        gl.colorMask(false, false, false, false);
        this.#drawBody(body, view, projection);
        gl.colorMask(true, true, true, true);
      }
      this.#drawBody(body, view, projection);
    }
    gl.disable(gl.DEPTH_TEST);
    for (const line of lines) if (line.over) this.#drawLines(line, view, projection);
    gl.bindVertexArray(null);
  }

  #build() {
    this.#solid = program(this.gl, SOLID);
    this.#line = program(this.gl, LINE);
    this.#shade = program(this.gl, SHADE);
    this.#cast = null;
    for (const body of this.#bodies.values()) this.#load(body);
    for (const [name, line] of this.#lines) { this.#loadLines(line); this.lines(name, line.points, line); }
  }

  #load(known) {
    const gl = this.gl, { meshes } = known.body, vertices = [], outward = [], faces = [];
    known.parts = meshes.map((mesh) => {
      const first = vertices.length / 3, from = faces.length;
      for (const value of mesh.vertices) vertices.push(value);
      for (const value of normals(mesh.vertices, mesh.faces)) outward.push(value);
      for (const corner of mesh.faces) faces.push(first + corner);
      return { link: mesh.link, colour: mesh.colour, from, count: mesh.faces.length };
    });
    known.array = gl.createVertexArray();
    gl.bindVertexArray(known.array);
    [vertices, outward].forEach((values, location) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, Float32Array.from(values), gl.STATIC_DRAW);
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, 3, gl.FLOAT, false, 0, 0);
    });
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, Uint32Array.from(faces), gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    return known;
  }

  #loadLines(known) {
    const gl = this.gl;
    known.array = gl.createVertexArray();
    known.buffer = gl.createBuffer();
    gl.bindVertexArray(known.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, known.buffer);
    for (const location of [0, 1]) {
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, 3, gl.FLOAT, false, 24, 12 * location);
      gl.vertexAttribDivisor(location, 1);
    }
    gl.bindVertexArray(null);
    return known;
  }

  #use({ made, uniforms }, array, view, projection) {
    const gl = this.gl;
    gl.useProgram(made);
    gl.bindVertexArray(array);
    gl.uniformMatrix4fv(uniforms.view, false, view);
    gl.uniformMatrix4fv(uniforms.projection, false, projection);
    return uniforms;
  }

  #drawShadow(bodies, view, projection, [x, y, half]) {
    const gl = this.gl, before = gl.getParameter(gl.VIEWPORT);
    this.#cast ??= this.#makeCast();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.#cast.frame);
    gl.viewport(0, 0, SHADE_PX, SHADE_PX);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.disable(gl.DEPTH_TEST);
    gl.blendEquation(gl.MAX);
    const onto = Float32Array.of(1 / half, 0, 0, 0, 0, 1 / half, 0, 0, 0, 0, 1, 0, -x / half, -y / half, 0, 1);
    for (const body of bodies) if (body.alpha === 1) this.#drawBody(body, IDENTITY, onto, half);
    gl.blendEquation(gl.FUNC_ADD);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(...before);
    gl.bindTexture(gl.TEXTURE_2D, this.#cast.texture);
    gl.generateMipmap(gl.TEXTURE_2D);
    const u = this.#use(this.#shade, null, view, projection);
    gl.uniform3f(u.square, x, y, half);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.enable(gl.DEPTH_TEST);
  }

  #makeCast() {
    const gl = this.gl, texture = gl.createTexture(), frame = gl.createFramebuffer();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1 + Math.log2(SHADE_PX), gl.RGBA8, SHADE_PX, SHADE_PX);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    return { texture, frame };
  }

  #drawBody({ array, parts, place, alpha, rim, poses }, view, projection, flattened = 0) {
    const gl = this.gl, u = this.#use(this.#solid, array, multiply(view, place), projection);
    gl.uniform1f(u.flattened, flattened);
    gl.uniform1f(u.rim, Number(rim));
    for (const { link, colour, from, count } of parts) {
      const [x, y, z, qw, qx, qy, qz] = poses.subarray(7 * link, 7 * link + 7);
      if (!(Math.hypot(qw, qx, qy, qz) > 0.5 && Number.isFinite(x))) continue; // not known
      gl.uniform4f(u.at, x, y, z, 1);
      gl.uniform4f(u.turn, qx, qy, qz, qw);
      gl.uniform4f(u.colour, ...colour, alpha);
      gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 4 * from);
    }
  }

  #drawLines({ array, points, colour, width }, view, projection) {
    const gl = this.gl, u = this.#use(this.#line, array, view, projection);
    gl.uniform4fv(u.viewport, gl.getParameter(gl.VIEWPORT));
    gl.uniform1f(u.width, width * (window.devicePixelRatio || 1));
    gl.uniform4f(u.colour, ...colour, 1);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, points.length / 6);
  }
}

// As many pixels as the screen has where the canvas is shown; returns how many to one of CSS.
export function sharp(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
  return ratio;
}

// Matrices as WebGL has them: sixteen numbers, column by column.
export function multiply(a, b) {
  return Float32Array.from({ length: 16 }, (_, i) => [0, 1, 2, 3].reduce((sum, k) => sum + a[4 * k + (i % 4)] * b[4 * (i >> 2) + k], 0));
}

const IDENTITY = Float32Array.of(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1);
export const TO_WEBXR = Float32Array.of(0, 0, -1, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1);

// Looking at `target` (m) from an azimuth (0: from ahead of who faces x, positive: from their left) and an elevation above
// the horizon, rad. field: of view, up and down, rad.
export function orbit(azimuth, elevation, distance, target, aspect, field = 0.5) {
  const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
  const axes = [[-sa, ca, 0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]];  // right, up, back
  const away = axes.map((axis) => -axis.reduce((sum, value, k) => sum + value * target[k], 0));
  away[2] -= distance;
  const near = distance / 50, far = 20 * distance, f = 1 / Math.tan(field / 2);
  return [
    Float32Array.of(...[0, 1, 2].flatMap((k) => [...axes.map((axis) => axis[k]), 0]), ...away, 1),
    Float32Array.of(f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0),
  ];
}

// Lines for `lines`: a grid on the floor about a point, and crosses at points (m), where they are known.
export function grid(step, half, x, y) {
  const n = Math.ceil(half / step), [cx, cy] = [x, y].map((value) => step * Math.round(value / step)), found = [];
  for (let i = -n; i <= n; i++)
    found.push(cx + i * step, cy - n * step, 0, cx + i * step, cy + n * step, 0, cx - n * step, cy + i * step, 0, cx + n * step, cy + i * step, 0);
  return found;
}

export function crosses(points, size) {
  const found = [];
  for (let i = 0; i < points.length; i += 3)
    for (const k of Number.isNaN(points[i]) ? [] : [0, 1, 2])
      for (const way of [-size, size]) for (let axis = 0; axis < 3; axis++) found.push(points[i + axis] + (axis === k ? way : 0));
  return found;
}
