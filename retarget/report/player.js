// The bodies, and time: the strip of phases, play, pause, scrub.
const AHEAD = [35 * Math.PI / 180, 12 * Math.PI / 180]; // azimuth and elevation of the pictures, too
let azimuth = AHEAD[0], elevation = AHEAD[1];
for (const figure of figures) {
  figure.scenes = ["view", "poses"].map((where) => Bodies.on($(where + "-" + figure.name)));
  for (const scene of figure.scenes) scene?.add("body", figure.body);
}

// A row of a figure as seen from a side, in the viewport that is set.
function drawFigure(figure, scene, at, aspect, ...side) {
  const { name, height, reach, centre } = figure, [x, y] = part(centre, at);
  scene.shadow = rgb("grid");
  scene.pose("body", posed(figure, at));
  if (obstacles && name === figures.at(-1).name) scene.lines("obstacles", edges(obstacles, at), { colour: rgb("gated") });
  if (recorded) scene.lines("recorded", edges(recorded, at), { colour: rgb("ink"), width: 1, over: true });
  const distance = Math.max(0.56 * height, reach / aspect) / Math.tan(0.25) + 0.5 * reach;
  scene.draw(...orbit(...side, distance, [x, y, 0.48 * height], aspect));
}

function drawPoses(figure) {
  const scene = figure.scenes[1], canvas = $("poses-" + figure.name), count = data.poses.length;
  scene.clear();
  const wide = canvas.width / count;
  data.poses.forEach((at, i) => {
    scene.gl.viewport(i * wide, 0, wide, canvas.height);
    drawFigure(figure, scene, at, wide / canvas.height, ...AHEAD);
  });
}

function drawView(figure) {
  const { name, height, marks } = figure, scene = figure.scenes[0], canvas = $("view-" + name);
  const cell = niceStep(height / 3), size = 0.02 * height, isRobot = name === "robot";
  scene.lines("marks", crosses(part(marks, row), size), { colour: rgb(isRobot ? "ink" : "servos"), width: 2, over: true });
  if (ground && isRobot) showGround(scene, size, row);
  scene.lines("floor", grid(cell, figure.reach, ...part(figure.centre, row)), { colour: rgb("line"), width: 1 });
  scene.clear();
  drawFigure(figure, scene, row, canvas.clientWidth / canvas.clientHeight, azimuth, elevation);
  $("say-" + name).textContent = "grid " + length(cell);
}

function drawStrip() {
  const canvas = $("strip"), ratio = sharp(canvas), width = canvas.clientWidth, height = canvas.clientHeight;
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  const first = data.time[0], span = data.time[rows - 1] - first || 1;
  const at = (time) => ((time - first) / span) * width;
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
  pen.fillStyle = colour.ink;
  pen.fillRect(at(data.time[row]) - 1, 0, 2, height);
}

function draw() {
  for (const figure of figures) if (figure.scenes[0]) drawView(figure);
  if (above) drawAbove();
  drawStrip();
  $("scrub").value = row;
  $("clock").textContent = (data.time[row] / 1000).toFixed(2) + " s";
  const words = { a: "approaching", f: "following", b: "braking" };
  $("scrub").setAttribute("aria-valuetext", $("clock").textContent + ", " + words[data.phase[row]]);
}

function nearest(time) {
  let low = 0, high = rows - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (data.time[middle] < time) low = middle + 1; else high = middle;
  }
  return low;
}

let before = 0, shown = 0;
function tick(now) {
  if (!playing) return;
  shown += (now - before) * Number($("speed").value);
  before = now;
  row = nearest(shown);
  draw();
  if (row >= rows - 1) return pause();
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
  $("play").textContent = "▶ Play";
}

function show(next) {
  pause();
  row = Math.max(0, Math.min(rows - 1, next));
  draw();
}

$("scrub").max = rows - 1;
$("play").addEventListener("click", () => (playing ? pause() : play()));
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
for (const { name, scenes } of figures)
  if (scenes[0]) $("view-" + name).addEventListener("pointermove", (event) => {
    if (!(event.buttons & 1)) return;
    azimuth -= event.movementX * 0.01;
    elevation = Math.min(1.4, Math.max(0, elevation + event.movementY * 0.005));
    draw();
  });
const refresh = () => {
  readColours();
  draw();
  for (const figure of figures) if (figure.scenes[1]) drawPoses(figure);
};
dark.addEventListener("change", refresh);
window.addEventListener("resize", refresh);
window.addEventListener("beforeprint", refresh);
window.addEventListener("afterprint", refresh);
refresh();
