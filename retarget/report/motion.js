// What the page brings along: tracks, unpacked, and where the player stands in them.
const data = JSON.parse(document.getElementById("motion").textContent);
const rows = data.time.length;
const $ = (id) => document.getElementById(id);
const still = matchMedia("(prefers-reduced-motion: reduce)");
const dark = matchMedia("(prefers-color-scheme: dark)");
let azimuth = 35 * Math.PI / 180, elevation = 12 * Math.PI / 180;
let row = Math.max(0, data.phase.indexOf("f"));
let playing = false;
let colour = {};

function unpack(packed, Kind = Float32Array) {
  return new Kind(Uint8Array.from(atob(packed), (letter) => letter.charCodeAt(0)).buffer);
}

function figure(name) {
  const packed = data[name], scene = packed && Bodies.on($("view-" + name));
  if (!scene) return [];
  scene.add(name, packed.body);
  const poses = unpack(packed.poses, Int16Array);
  return [{ ...packed, name, scene, poses, marks: unpack(packed.marks), centre: unpack(packed.centre) }];
}

// The poses of a figure's links in this row, see `packed_poses`.
function posed({ poses, step, centre }) {
  const size = poses.length / rows;
  return Float32Array.from(poses.subarray(size * row, size * (row + 1)), (value, i) =>
    i % 7 < 3 ? value * step + (i % 7 < 2 ? centre[2 * row + (i % 7)] : 0) : value / 32767);
}

const obstacles = data.obstacles && { ...data.obstacles, points: unpack(data.obstacles.points) };
const figures = ["performer", "robot"].flatMap(figure);
const ground = data.ground && { ...data.ground, corners: unpack(data.ground.corners), com: unpack(data.ground.com) };

function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["page", "ink", "soft", "line", "grid", "trunk", "right", "servos", "asked", "fail", "pass", "follow", "approach", "brake", "gated"])
    colour[name] = style.getPropertyValue("--" + name).trim();
}

function rgb(name) {
  return [1, 3, 5].map((at) => parseInt(colour[name].slice(at, at + 2), 16) / 255);
}

function niceStep(wanted) {
  const power = 10 ** Math.floor(Math.log10(wanted));
  return [1, 2, 5, 10].map((n) => n * power).find((n) => n >= wanted * 0.7) || wanted;
}

function length(metres) {
  return metres >= 1 ? metres + " m" : Math.round(metres * 1000) / 10 + " cm";
}

// The pen of a canvas that is not of bodies.
function prepare(canvas) {
  const ratio = sharp(canvas), width = canvas.clientWidth, height = canvas.clientHeight, pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.lineCap = pen.lineJoin = "round";
  return { pen, width, height };
}
