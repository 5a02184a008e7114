// The bodies, and time: the strip of phases, play, pause, scrub.
import { sharp } from "./bodies.js";
import { AHEAD, Figure, colour, legend, readColours } from "./figure.js";
import { JointPlot } from "./plot.js";

const side = { ...AHEAD };
for (const figure of figures) {
  const { body, goal, observers, scene } = figure, about = { ...figure, goal: goal && body, observers: observers?.body, scene: scene?.body };
  for (const where of ["view", "poses"]) {
    const canvas = $(`${where}-${figure.name}`);
    figure[where + "On"] = canvas && new Figure(canvas, about);
  }
}

function drawPoses(figure) {
  const strip = figure.posesOn, { scene, canvas } = strip, count = data.poses.length;
  if (!scene) return;
  scene.clear();
  const wide = canvas.width / count;
  data.poses.forEach((at, i) => {
    scene.gl.viewport(i * wide, 0, wide, canvas.height);
    strip.draw(frame(figure, at), AHEAD, wide / canvas.height, true);
  });
}

const phases = document.createElement("canvas"); // the strip without its cursor
const at = (time) => ($("strip").clientWidth * (time - data.time[0])) / (data.time[rows - 1] - data.time[0] || 1);

function paintStrip() {
  const strip = $("strip"), ratio = sharp(strip), { clientWidth: width, clientHeight: height } = strip;
  Object.assign(phases, { width: strip.width, height: strip.height });
  const pen = phases.getContext("2d");
  pen.scale(ratio, ratio);
  const shades = { a: colour.approach, f: colour.follow, b: colour.brake };
  for (let i = 0; i < rows; i++) {
    const x = at(data.time[i]), wide = Math.max(at(data.time[Math.min(i + 1, rows - 1)]) - x, 1) + 0.5;
    pen.fillStyle = shades[data.phase[i]];
    pen.fillRect(x, 0, wide, height);
    if (data.gated[i] === "1") { pen.fillStyle = colour.gated; pen.fillRect(x, 0, wide, 5); }
    if (ground && ground.outside[i] === "1") { pen.fillStyle = colour.fail; pen.fillRect(x, height - 5, wide, 5); }
  }
  pen.fillStyle = colour.fail;
  for (const moment of data.moments) pen.fillRect(Math.min(at(moment), width - 2) - 1.5, 0, 3, height);
}

function drawStrip() {
  const canvas = $("strip"), pen = canvas.getContext("2d"), ratio = canvas.width / canvas.clientWidth;
  pen.clearRect(0, 0, canvas.width, canvas.height);
  if (phases.width) pen.drawImage(phases, 0, 0);
  pen.fillStyle = colour.ink;
  pen.fillRect(ratio * (at(data.time[row]) - 1), 0, 2 * ratio, canvas.height);
}

// The bodies as they are seen, from where following begins to the end or until it is paused, at the speed of the page.
let film = null;
const KINDS = ["video/mp4;codecs=avc1.42E01F", "video/webm"];

function startFilm() {
  const sheet = document.createElement("canvas"), shown = figures.map(({ viewOn }) => viewOn.canvas), parts = [];
  sheet.width = 2 * Math.ceil(shown.reduce((sum, canvas) => sum + canvas.width, 0) / 2); // H.264 has even sizes
  sheet.height = 2 * Math.ceil(Math.max(...shown.map((canvas) => canvas.height)) / 2);
  const mimeType = KINDS.find((kind) => MediaRecorder.isTypeSupported(kind));
  film = new MediaRecorder(sheet.captureStream(30), { mimeType, videoBitsPerSecond: 8e6 });
  film.paint = () => paintFilm(sheet.getContext("2d"), shown);
  film.ondataavailable = ({ data }) => parts.push(data);
  film.onstop = () => {
    const name = document.title.replace(/\.\w+$/, "").replace(": ", "-") + (mimeType.startsWith("video/mp4") ? ".mp4" : ".webm");
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(new Blob(parts, { type: mimeType })), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
  };
  row = Math.max(0, data.phase.indexOf("f"));
  $("film").setAttribute("aria-pressed", "true");
  film.start();
  play();
}

function paintFilm(pen, shown) {
  const style = getComputedStyle(shown[0]), ratio = shown[0].width / shown[0].clientWidth;
  pen.fillStyle = style.backgroundColor;
  pen.fillRect(0, 0, pen.canvas.width, pen.canvas.height);
  pen.fillStyle = colour.soft;
  pen.textAlign = "center";
  pen.font = `${16 * ratio}px ${style.fontFamily}`;
  let from = 0;
  shown.forEach((canvas, i) => {
    pen.drawImage(canvas, from, 0);
    pen.fillText(figures[i].label, from + canvas.width / 2, 24 * ratio);
    from += canvas.width;
  });
}

function endFilm() {
  const ended = film;
  setTimeout(() => ended?.stop(), 300); // with the last picture, however short it is
  film = null;
  $("film").setAttribute("aria-pressed", "false");
}

function draw() {
  for (const figure of figures) {
    figure.viewOn.show(frame(figure, row), side);
    if (figure.viewOn.scene) $("output-" + figure.name).textContent = "grid " + length(figure.viewOn.cell);
  }
  if (above) drawAbove();
  film?.paint();
  drawStrip();
  plot?.draw(data.time, (name, at, joint) => joints[name][joints.names.length * at + joint], data.time[row]);
  $("scrub").value = row;
  $("clock").textContent = (data.time[row] / 1000).toFixed(2) + " s";
  const words = { a: "approaching", f: "following", b: "braking" };
  $("scrub").setAttribute("aria-valuetext", $("clock").textContent + ", " + words[data.phase[row]]);
  if (data.doing) {
    const [, doing, reason] = data.doing.findLast(([from]) => from <= row);
    Object.assign($("doing"), { textContent: doing, className: /follow/.test(doing) ? "pass" : /stop|end/.test(doing) ? "fail" : "part" });
    $("reason").textContent = reason;
  }
}

function nearest(time) {
  const found = data.time.findIndex((one) => one >= time);
  return found < 0 ? rows - 1 : found;
}

let before = 0, shown = 0;
function tick(now) {
  if (!playing) return;
  shown += (now - before) * Number($("speed").value);
  before = now;
  row = nearest(shown);
  draw();
  if (row >= rows - 1 && (film || !data.repeats)) return pause();
  if (row >= rows - 1) shown = data.time[0];
  requestAnimationFrame(tick);
}

function play() {
  if (row >= rows - 1) row = 0;
  playing = true;
  $("play").textContent = "❚❚ Pause";
  shown = data.time[row];
  before = performance.now();
  requestAnimationFrame(tick);
}

function pause() {
  playing = false;
  endFilm();
  $("play").textContent = "▶ Play";
}

function show(next) {
  pause();
  row = Math.max(0, Math.min(rows - 1, next));
  draw();
}

$("scrub").max = rows - 1;
$("play").addEventListener("click", () => (playing ? pause() : play()));
$("film").addEventListener("click", () => (film ? pause() : (pause(), startFilm())));
$("film").hidden = typeof MediaRecorder === "undefined" || figures.some(({ viewOn }) => !viewOn.scene) || !KINDS.some((kind) => MediaRecorder.isTypeSupported(kind));
for (const button of document.querySelectorAll(".step")) button.addEventListener("click", () => show(row + Number(button.value)));
$("scrub").addEventListener("input", (event) => show(Number(event.target.value)));
const strip = $("strip");
strip.addEventListener("pointerdown", (event) => {
  const share = event.offsetX / strip.clientWidth;
  show(nearest(data.time[0] + share * (data.time[rows - 1] - data.time[0])));
});
for (const button of document.querySelectorAll(".goto"))
  button.addEventListener("click", () => {
    show(nearest(Number(button.dataset.time)));
    $("player").scrollIntoView({ behavior: still.matches ? "auto" : "smooth" });
  });
for (const { viewOn } of figures) if (viewOn.scene) viewOn.turns(side, draw);
legend($("layers"), figures.map(({ viewOn }) => viewOn), draw);
const plot = joints && new JointPlot($("joint"), joints.names, joints.measured, draw);
const refresh = () => {
  readColours();
  paintStrip();
  draw();
  for (const figure of figures) if (figure.posesOn) drawPoses(figure);
};
dark.addEventListener("change", refresh);
window.addEventListener("resize", refresh);
window.addEventListener("beforeprint", refresh);
window.addEventListener("afterprint", refresh);
refresh();
if (data.repeats && !still.matches) play();
