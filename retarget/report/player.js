// The bodies, and time: the strip of phases, play, pause, scrub.
const GRID = 3; // cells of the floor to a body's height, about

function drawBody({ name, scene, height, reach, marks, centre, ...poses }) {
  const isRobot = name === "robot", [x, y] = centre.subarray(2 * row, 2 * row + 2), canvas = $("view-" + name);
  const count = marks.length / rows, size = 0.02 * height;
  scene.shadow = rgb("grid");
  scene.pose(name, posed({ centre, ...poses }));
  scene.lines("floor", grid(niceStep(height / GRID), 1.1 * reach, x, y), { colour: rgb("line"), width: 1 });
  scene.lines("marks", crosses(marks.subarray(count * row, count * (row + 1)), size), { colour: rgb(isRobot ? "ink" : "servos"), width: 2, over: true });
  if (obstacles && (isRobot || !data.robot)) {
    const from = Math.min(row, obstacles.rows - 1) * obstacles.points.length / obstacles.rows;
    const at = (i) => obstacles.points.subarray(from + 3 * i, from + 3 * i + 3);
    scene.lines("obstacles", obstacles.edges.flatMap(([a, b]) => [...at(a), ...at(b)]), { colour: rgb("gated") });
  }
  if (isRobot && ground) showGround(scene, size);
  const aspect = canvas.clientWidth / canvas.clientHeight, field = 0.5;
  const distance = Math.max(0.58 * height, reach / aspect) / Math.tan(field / 2) + 0.5 * reach;
  const { view, projection } = orbit(azimuth, elevation, distance, [x, y, 0.48 * height], aspect, field);
  scene.clear();
  scene.draw(view, projection);
}

function drawStrip() {
  const { pen, width, height } = prepare($("strip"));
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
  figures.forEach(drawBody);
  if (ground) drawAbove($("view-above"));
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
for (const { name } of figures)
  $("view-" + name).addEventListener("pointermove", (event) => {
    if (!(event.buttons & 1)) return;
    azimuth -= event.movementX * 0.01;
    elevation = Math.min(1.4, Math.max(0, elevation + event.movementY * 0.005));
    draw();
  });
const refresh = () => { readColours(); draw(); };
dark.addEventListener("change", refresh);
window.addEventListener("resize", draw);
window.addEventListener("beforeprint", refresh);
window.addEventListener("afterprint", refresh);
refresh();
