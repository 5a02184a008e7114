// A body on a canvas with all that is shown about it: of a report, of `retarget view`, of a run while it goes on.
import { Bodies, crosses, grid, orbit } from "./bodies.js";

// Colours are variables of the page's style; those of bodies come with them.
const NAMES = ["ink", "soft", "line", "grid", "left", "right", "servos", "fail", "pass", "follow", "approach", "brake", "gated", "scene"];
export const colour = {};

export function readColours() {
  const probe = document.body.appendChild(document.createElement("i"));
  for (const name of NAMES) {
    probe.style.color = `var(--${name})`;
    colour[name] = getComputedStyle(probe).color;
  }
  probe.remove();
}

export function rgb(name) {
  return colour[name].match(/[\d.]+/g).slice(0, 3).map((value) => value / 255);
}

// What may be shown: the name of a colour, and what it means; a click in the legend hides it.
const LAYERS = {
  left: "left side",
  right: "right side",
  goal: "pale: the goal, where the robot is not",
  servos: "crosses: sensors of the performer",
  desired: "crosses: desired places of hands, feet and head",
  pass: "centre of mass over the soles; red: outside",
  observers: "rims: observers that act; line: the nearest two",
  scene: "obstacle",
};
const SHADES = { goal: "line", desired: "ink", observers: "gated" }; // of a layer whose name is no colour
const GHOSTS = { goal: 0.35, scene: 0.5, observers: 0.9 }; // bodies that are seen through, of observers only the rim
const FIXED = ["left", "right"];
const hidden = new Set();

// Into a list; changed(): draws again.
export function legend(list, figures, changed) {
  const names = Object.keys(LAYERS).filter((name) => FIXED.includes(name) || figures.some(({ about }) => about.layers.includes(name)));
  list.innerHTML = names.map((name) => `<li><label>${FIXED.includes(name) ? "" : `<input type="checkbox" value="${name}">`}<i></i>${LAYERS[name]}</label></li>`).join("");
  list.querySelectorAll("i").forEach((swatch, i) => { swatch.style.background = `var(--${SHADES[names[i]] || names[i]})`; });
  for (const box of list.querySelectorAll("input")) {
    box.checked = !hidden.has(box.value);
    box.onchange = () => { hidden[box.checked ? "delete" : "add"](box.value); changed(); };
  }
}

export function niceStep(target) {
  const power = 10 ** Math.floor(Math.log10(target));
  return [1, 2, 5, 10].map((n) => n * power).find((n) => n >= target * 0.7) || target;
}

export const AHEAD = { azimuth: 35 * Math.PI / 180, elevation: 12 * Math.PI / 180 }; // as the pictures are seen

export class Figure {
  // about: {label, body, height, reach [m, what the view shows], layers, and of these: goal, observers, obstacles, sizes}
  constructor(canvas, about) {
    this.canvas = canvas;
    this.scene = Bodies.on(canvas);
    this.meet(about);
  }

  meet(about) {
    this.about = about;
    this.scene?.add("body", about.body);
    for (const [name, alpha] of Object.entries(GHOSTS)) if (about[name]) this.scene?.add(name, about[name], { alpha, rim: name === "observers" });
  }

  // frame: {poses, at [x, y: where the view looks], and what is known of: goal, scene, observers (poses), near (two points), marks, corners,
  // com, margin, recorded (ends of lines)}. In the viewport that is set; plain: without floor and marks.
  draw(frame, { azimuth, elevation }, aspect, plain = false) {
    const { scene, about: { height, reach, layers, sizes } } = this, [x, y] = frame.at, size = 0.02 * height;
    const marks = layers.includes("servos") ? "servos" : "desired", seen = (name) => frame[name] && !hidden.has(name);
    scene.shadow = { at: [x, y], half: 1.3 * Math.max(reach, height) };
    scene.pose("body", frame.poses);
    for (const name in GHOSTS) scene.pose(name, seen(name) ? frame[name] : null);
    const near = seen("observers") && Number.isFinite(frame.near?.[0]) ? frame.near : [];
    scene.lines("near", [...near, ...crosses(near, 0.5 * size)], { colour: rgb("gated"), width: 3, over: true });
    scene.lines("recorded", frame.recorded || [], { colour: rgb("ink"), width: 1, over: true });
    scene.lines("floor", plain ? [] : grid(this.cell, reach, x, y), { colour: rgb("line"), width: 1 });
    scene.lines("marks", !plain && frame.marks && !hidden.has(marks) ? crosses(frame.marks, size) : [], { colour: rgb(SHADES[marks] || marks), width: 2, over: true });
    if (!plain && sizes) showGround(scene, hidden.has("pass") ? null : frame, sizes, size);
    const distance = Math.max(0.56 * height, reach / aspect) / Math.tan(0.25) + 0.5 * reach;
    scene.draw(...orbit(azimuth, elevation, distance, [x, y, 0.48 * height], aspect));
  }

  // Alone on its canvas.
  show(frame, side) {
    if (!this.scene || !this.canvas.clientWidth) return;
    this.scene.clear();
    this.draw(frame, side, this.canvas.clientWidth / this.canvas.clientHeight);
  }

  get cell() { return niceStep(this.about.height / 3); } // m, of the grid

  // Dragging turns `side`.
  turns(side, changed) {
    this.canvas.addEventListener("pointermove", (event) => {
      if (!(event.buttons & 1)) return;
      side.azimuth -= event.movementX * 0.01;
      side.elevation = Math.min(1.4, Math.max(0, side.elevation + event.movementY * 0.005));
      changed();
    });
  }
}

// The corners of each sole.
export function soles({ corners }, sizes) {
  let from = 0;
  return sizes.map((size) => {
    from += size;
    return Array.from({ length: size }, (_, i) => [...corners.subarray(3 * (from - size + i), 3 * (from - size + i + 1))]);
  });
}

export function closed(points) {
  return points.flatMap((point, i) => [...point, ...points[(i + 1) % points.length]]);
}

// Soles, the centre of mass, and the point below it; true if that is outside.
export function showGround(scene, frame, sizes, size) {
  const [x, y, z] = frame?.com || [], outside = frame && !(frame.margin[0] >= -1e-4);
  scene.lines("soles", frame ? soles(frame, sizes).flatMap(closed) : [], { colour: rgb("ink"), width: 1, over: true });
  scene.lines("drop", frame ? [x, y, z, x, y, 0] : [], { colour: rgb("soft"), width: 1, over: true });
  scene.lines("com", frame ? crosses([x, y, z, x, y, 0], size) : [], { colour: rgb(outside ? "fail" : "pass"), width: 2, over: true });
  return outside;
}
