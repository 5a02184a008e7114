// What the page brings along: tracks, unpacked, and where the player stands in them.
const source = document.getElementById("motion");
if (!source) return;
const data = JSON.parse(source.textContent);
const rows = data.time.length;
const $ = (id) => document.getElementById(id);
const still = matchMedia("(prefers-reduced-motion: reduce)");
const dark = matchMedia("(prefers-color-scheme: dark)");
const ELEVATION = 12 * Math.PI / 180;
let azimuth = 35 * Math.PI / 180;
let row = Math.max(0, data.phase.indexOf("f"));
let playing = false;
let colour = {};

function unpack(packed) {
  return new Float32Array(Uint8Array.from(atob(packed), (letter) => letter.charCodeAt(0)).buffer);
}

function body(figure) {
  if (!figure) return null;
  return { ...figure, points: unpack(figure.points), marks: unpack(figure.marks), centre: unpack(figure.centre) };
}

const obstacles = data.obstacles && { ...data.obstacles, points: unpack(data.obstacles.points) };
const bodies = { performer: body(data.performer), robot: body(data.robot) };
const ground = data.ground && { ...data.ground, corners: unpack(data.ground.corners), com: unpack(data.ground.com) };

function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["paper", "page", "ink", "soft", "line", "grid", "trunk", "left", "right", "servos", "asked", "fail", "pass", "follow", "approach", "brake", "gated"])
    colour[name] = style.getPropertyValue("--" + name).trim();
}
