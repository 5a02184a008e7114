// The virtual human, the robot and its joints on the page, from the scene and the tracks that the server sends.
import { Figure, legend, readColours } from "../figure.js";
import { JointPlot } from "../plot.js";

const SLOWNESS = 0.9; // share of the old place that the view keeps each drawing
const KEPT_S = 20; // of the plot

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
      const about = { ...message[name], goal: name === "robot" && message[name].body, height: 0, reach: 0 };
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
      const { view: [x, y, height, reach] } = parts[name], old = this.frames[name]?.at || [x, y], { about } = figure;
      Object.assign(about, { height: Math.max(about.height, height), reach: Math.max(about.reach, reach) }); // it widens
      this.frames[name] = { ...parts[name], at: [x, y].map((value, k) => SLOWNESS * old[k] + (1 - SLOWNESS) * value) };
      this.canvases[name].closest("figure").hidden = !figure.scene;
    }
    this.#later();
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
