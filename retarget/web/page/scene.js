// The virtual human and the robot on the page, from the bodies and poses that the server sends.

const ROOM = 1.1; // what the view shows, by what the body needs
const SHARE = 0.2; // of the time, at most, goes into drawing: without a graphics card the tracker needs the rest
const FIELD = 0.5; // rad, of view, up and down
const AZIMUTH = 0.25, ELEVATION = 0.12; // rad, from the front left, slightly above
const SLOWNESS = 0.9; // share of the old place that the view keeps each drawing

const drawing = import(new URL("bodies.js", document.baseURI)).catch(() => null);

// How far each link reaches from its origin, m.
function reaches(body) {
  const found = [];
  for (const { link, vertices: v } of body.meshes) {
    found[link] ??= 0;
    for (let i = 0; i < v.length; i += 3) found[link] = Math.max(found[link], Math.hypot(v[i], v[i + 1], v[i + 2]));
  }
  return found;
}

// Of all links: the middle on the floor, how far they reach from it, and how high; m.
function extent(poses, reach) {
  const each = Array.from({ length: poses.length / 7 }, (_, i) => [...poses.subarray(7 * i, 7 * i + 3), reach[i] || 0]);
  const known = each.filter(([x]) => !Number.isNaN(x));
  const middle = [0, 1].map((k) => known.reduce((sum, place) => sum + place[k], 0) / known.length);
  return {
    middle,
    far: Math.max(...known.map(([x, y, , r]) => Math.hypot(x - middle[0], y - middle[1]) + r)),
    high: Math.max(...known.map(([, , z, r]) => z + r)),
  };
}

class View {
  constructor(canvas, body, tools) {
    this.canvas = canvas;
    this.tools = tools;
    this.bodies = tools.Bodies.on(canvas, { shadow: [0.35, 0.4, 0.45] });
    this.show(body);
  }

  show(body) {
    this.height = this.top = body.height;
    this.half = 0.35 * body.height; // of what is seen across; both grow with what the body does
    this.reach = reaches(body);
    this.at = null;
    this.bodies?.add("body", body);
  }

  draw(poses) {
    if (!this.bodies || !this.canvas.clientWidth) return;
    const { middle, far, high } = extent(poses, this.reach);
    this.half = Math.max(this.half, far);
    this.top = Math.max(this.top, high);
    this.at = this.at ? this.at.map((old, i) => SLOWNESS * old + (1 - SLOWNESS) * middle[i]) : middle;
    const aspect = this.canvas.clientWidth / this.canvas.clientHeight;
    const distance = ROOM * Math.max(this.top, 2 * this.half / aspect) / (2 * Math.tan(FIELD / 2));
    const [view, projection] = this.tools.orbit(AZIMUTH, ELEVATION, distance, [...this.at, this.top / 2], aspect, FIELD);
    this.bodies.lines("floor", this.tools.grid(this.height / 4, this.height, ...this.at), { colour: [0.55, 0.6, 0.65], width: 1 });
    this.bodies.pose("body", poses);
    this.bodies.clear();
    this.bodies.draw(view, projection);
  }

  // Tells when what was drawn is finished.
  fence() {
    const gl = this.bodies && this.canvas.getContext("webgl2");
    const sync = gl?.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    if (!sync) return null;
    gl.flush();
    return { finished: () => gl.isContextLost() || gl.getSyncParameter(sync, gl.SYNC_STATUS) === gl.SIGNALED };
  }
}

export class Scene {
  // human, robot: canvases.
  constructor(human, robot) {
    this.canvases = { human, robot };
    this.views = {};
    this.poses = {};
    this.robot = null; // its body, for the ghost of a headset
    this.busy = false;
  }

  // The message "bodies".
  async meet(message) {
    const tools = await drawing;
    this.tools = tools;
    this.robot = message.robot;
    if (!tools) return;
    for (const [name, canvas] of Object.entries(this.canvases)) {
      if (!message[name]) continue;
      if (this.views[name]) this.views[name].show(message[name]);
      else this.views[name] = new View(canvas, message[name], tools);
    }
  }

  // The message "state".
  pose(message) {
    for (const name of ["human", "robot"]) if (message[name]?.length) this.#know(name, message[name]);
    if (this.busy) return; // a later message is drawn
    this.busy = true;
    requestAnimationFrame(() => this.#draw());
  }

  #know(name, poses) {
    this.poses[name] = Float32Array.from(poses);
    this.canvases[name].closest("figure").hidden = !this.views[name];
  }

  #draw() {
    const began = performance.now();
    for (const [name, view] of Object.entries(this.views)) if (this.poses[name]) view.draw(this.poses[name]);
    const fences = Object.values(this.views).map((view) => view.fence()).filter(Boolean);
    this.#rest(began, fences);
  }

  // Draws no more until the pictures are finished, and then as long as leaves drawing its share.
  #rest(began, fences) {
    if (!fences.every((fence) => fence.finished())) return void setTimeout(() => this.#rest(began, fences), 3);
    const took = performance.now() - began;
    setTimeout(() => { this.busy = false; }, took * (1 / SHARE - 1));
  }
}
