// Time: the strip of phases, play, pause, scrub.
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
  for (const name of ["performer", "robot"]) {
    const canvas = $("view-" + name);
    if (canvas && bodies[name]) drawBody(canvas, bodies[name], name === "robot");
  }
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
for (const name of ["performer", "robot"]) {
  const canvas = $("view-" + name);
  if (!canvas) continue;
  canvas.addEventListener("pointermove", (event) => {
    if (!(event.buttons & 1)) return;
    azimuth -= event.movementX * 0.01;
    draw();
  });
}
const refresh = () => { readColours(); draw(); };
dark.addEventListener("change", refresh);
window.addEventListener("resize", draw);
window.addEventListener("beforeprint", refresh);
window.addEventListener("afterprint", refresh);
refresh();
