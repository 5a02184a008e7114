// The virtual human, the robot and its joints on the page, from the scene and the tracks that the server sends.
import { Figure, legend, readColours } from "../figure.js";
import { JointPlot } from "../plot.js";

const SLOWNESS = 0.9; // share of the old place that the view keeps each drawing
const KEPT_S = 20; // of the plot

// How far each link reaches from its origin, m.
function reaches(body) {
  const found = [];
  for (const { link, vertices: v } of body.meshes) {
    found[link] ??= 0;
    for (let i = 0; i < v.length; i += 3) found[link] = Math.max(found[link], Math.hypot(v[i], v[i + 1], v[i + 2]));
  }
  return found;
}

export class Scene {
  // human, robot: canvases; list: of the legend; joint: the place of the plot.
  constructor(human, robot, list, joint) {
    Object.assign(this, { canvases: { human, robot }, list, joint, figures: {}, frames: {}, past: [], side: { azimuth: 0.25, elevation: 0.12 } });
    this.share = 0.2; // of the time, at most, goes into drawing: without a graphics card the tracker needs the rest
    this.robot = null; // its body, for the ghost of a headset
    this.busy = false;
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", readColours);
    readColours();
  }

  // The message "scene".
  meet(message) {
    this.robot = message.robot?.body;
    for (const [name, canvas] of Object.entries(this.canvases)) {
      if (!message[name]) continue;
      const { body } = message[name], about = { ...message[name], height: body.height, reach: 0.35 * body.height, reaches: reaches(body) };
      if (this.figures[name]) this.figures[name].meet(about);
      else (this.figures[name] = new Figure(canvas, about)).turns(this.side, () => this.#later());
    }
    this.past = [];
    this.plot = new JointPlot(this.joint, message.joints, message.measured, () => this.#later());
    legend(this.list, Object.values(this.figures), () => this.#later());
  }

  // The message "state".
  pose({ time, tracks }) {
    if (!tracks) return;
    const parts = { human: {}, robot: {}, joints: { time } };
    for (const [name, track] of Object.entries(tracks)) {
      const [whose, part] = name.split(".");
      parts[whose][part] = track;
    }
    this.past = [...this.past.filter((one) => one.time > time - KEPT_S && one.time < time), parts.joints];
    for (const [name, figure] of Object.entries(this.figures)) {
      if (!parts[name].poses) continue;
      this.frames[name] = { ...parts[name], at: this.#look(figure, parts[name].poses, this.frames[name]?.at) };
      this.canvases[name].closest("figure").hidden = !figure.scene;
    }
    this.#later();
  }

  // Widens the view to what the body does; the middle on the floor, m.
  #look({ about }, poses, old) {
    const links = Array.from({ length: poses.length / 7 }, (_, i) => [...poses.subarray(7 * i, 7 * i + 3), about.reaches[i] || 0]).filter(([x]) => !Number.isNaN(x));
    const middle = [0, 1].map((k) => links.reduce((sum, place) => sum + place[k], 0) / links.length);
    for (const [x, y, z, r] of links) {
      about.reach = Math.max(about.reach, Math.hypot(x - middle[0], y - middle[1]) + r);
      about.height = Math.max(about.height, z + r);
    }
    return old ? old.map((value, k) => SLOWNESS * value + (1 - SLOWNESS) * middle[k]) : middle;
  }

  #later() {
    if (this.busy) return; // a later message is drawn
    this.busy = true;
    requestAnimationFrame(() => this.#draw());
  }

  #draw() {
    const began = performance.now(), { past } = this;
    for (const [name, figure] of Object.entries(this.figures)) if (this.frames[name]) figure.show(this.frames[name], this.side);
    this.plot?.draw(past.map(({ time }) => time), (name, row, joint) => past[row][name][joint], past.at(-1)?.time);
    const fences = Object.values(this.figures).map(fence).filter(Boolean);
    this.#rest(began, fences);
  }

  // Draws no more until the pictures are finished, and then as long as leaves drawing its share.
  #rest(began, fences) {
    if (!fences.every((finished) => finished())) return void setTimeout(() => this.#rest(began, fences), 3);
    const took = performance.now() - began;
    setTimeout(() => { this.busy = false; }, took * (1 / this.share - 1));
  }
}

// Says when what was drawn is finished.
function fence({ scene }) {
  const gl = scene?.gl, sync = gl?.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  if (!sync) return null;
  gl.flush();
  return () => gl.isContextLost() || gl.getSyncParameter(sync, gl.SYNC_STATUS) === gl.SIGNALED;
}
