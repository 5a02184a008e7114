// What the page brings along: tracks, unpacked, and where the player stands in them.
const data = JSON.parse(document.getElementById("motion").textContent);
const rows = data.time.length;
const $ = (id) => document.getElementById(id);
const still = matchMedia("(prefers-reduced-motion: reduce)");
const dark = matchMedia("(prefers-color-scheme: dark)");
let row = Math.max(0, data.phase.indexOf("f"));
let playing = false;
let colour = {};

function unpack(packed, Kind = Float32Array) {
  return new Kind(Uint8Array.from(atob(packed), (letter) => letter.charCodeAt(0)).buffer);
}

function unpacked(tracks, ...names) {
  return tracks && { ...tracks, ...Object.fromEntries(names.map((name) => [name, unpack(tracks[name])])) };
}

const obstacles = unpacked(data.obstacles, "points"), recorded = unpacked(data.recorded, "points");
const ground = unpacked(data.ground, "corners", "com", "margin");
const figures = ["performer", "robot"].filter((name) => data[name]).map((name) => ({
  ...unpacked(data[name], "marks", "centre"), name, poses: unpack(data[name].poses, Int16Array),
}));

// Of the rows of a track, one.
function part(track, at) {
  const size = track.length / rows;
  return track.subarray(size * at, size * (at + 1));
}

// The poses of a figure's links in a row, see `packed_poses`.
function posed({ poses, step, centre }, at) {
  const middle = [...part(centre, at), 0];
  return Float32Array.from(part(poses, at), (value, i) => (i % 7 < 3 ? value * step + middle[i % 7] : value / 32767));
}

// Edges between the points of a row, or of the only one.
function edges({ points, rows, edges }, at) {
  const size = points.length / rows, from = size * Math.min(at, rows - 1);
  return edges.flatMap((ends) => ends.flatMap((end) => [...points.subarray(from + 3 * end, from + 3 * end + 3)]));
}

function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["ink", "soft", "line", "grid", "right", "servos", "fail", "pass", "follow", "approach", "brake", "gated"])
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
