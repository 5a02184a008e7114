// What the page brings along: tracks, unpacked, and where the player stands in them.
import { Figure } from "./figure.js";

const data = JSON.parse(document.getElementById("motion").textContent);
const rows = data.time.length;
const $ = (id) => document.getElementById(id);
const still = matchMedia("(prefers-reduced-motion: reduce)");
const dark = matchMedia("(prefers-color-scheme: dark)");
let row = Math.max(0, data.phase.indexOf("f"));
let playing = false;

function unpack(packed, Kind = Float32Array) {
  if (tracks) return packed && new Kind(tracks, ...packed);
  return packed && new Kind(Uint8Array.from(atob(packed), (letter) => letter.charCodeAt(0)).buffer);
}

function unpacked(about, ...names) {
  return about && { ...about, ...Object.fromEntries(names.map((name) => [name, unpack(about[name])])) };
}

const recorded = unpacked(data.recorded, "points"), ground = unpacked(data.ground, "corners", "com", "margin");
const joints = unpacked(data.joints, "goal", "servo", "temperature", "current");
const figures = ["performer", "robot"].filter((name) => data[name]).map((name) => {
  const about = { ...unpacked(data[name], "marks", "centre", "near"), name, sizes: name === "robot" && ground?.sizes };
  for (const one of ["poses", "goal", "observers", "scene"])
    if (about[one]) about[one] = { ...about[one], numbers: unpack(about[one].numbers, Int16Array) };
  return about;
});

// Of the rows of a track, one; of a track that stands still, the only one.
function part(track, at, count = rows) {
  const size = track.length / count;
  return track.subarray(size * Math.min(at, count - 1), size * (Math.min(at, count - 1) + 1));
}

// The poses of links in a row, see `packed_poses`.
function posed({ numbers, step, rows: count }, at, [x, y]) {
  const middle = [x, y, 0];
  return Float32Array.from(part(numbers, at, count), (value, i) => (i % 7 < 3 ? value * step + middle[i % 7] : value / 32767));
}

// Edges between the points of a row.
function edges({ points, edges }, at) {
  const size = points.length / rows, from = size * at;
  return edges.flatMap((ends) => ends.flatMap((end) => [...points.subarray(from + 3 * end, from + 3 * end + 3)]));
}

// A figure in a row, see `Figure.draw`.
function frame(figure, at) {
  const centre = part(figure.centre, at), found = { at: centre, marks: part(figure.marks, at), near: figure.near && part(figure.near, at), recorded: recorded && edges(recorded, at) };
  for (const name of ["poses", "goal", "observers", "scene"]) if (figure[name]) found[name] = posed(figure[name], at, name === "scene" ? [0, 0] : centre);
  return figure.sizes ? { ...found, ...standing(at) } : found;
}

function standing(at) {
  return { corners: part(ground.corners, at), com: part(ground.com, at), margin: part(ground.margin, at) };
}

function length(metres) {
  return metres >= 1 ? metres + " m" : Math.round(metres * 1000) / 10 + " cm";
}
