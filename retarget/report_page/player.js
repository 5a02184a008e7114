"use strict";
(() => {
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
    const bytes = Uint8Array.from(atob(packed.data), (letter) => letter.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    const values = new Float32Array(bytes.length / 2);
    for (let i = 0; i < values.length; i++) {
      const whole = view.getInt16(2 * i, true);
      values[i] = whole === -32768 ? NaN : whole * packed.unit;
    }
    return values;
  }

  function body(figure) {
    if (!figure) return null;
    return { ...figure, points: unpack(figure.points), marks: unpack(figure.marks), centre: unpack(figure.centre) };
  }

  const bodies = { performer: body(data.performer), robot: body(data.robot) };
  const ground = data.ground && { ...data.ground, corners: unpack(data.ground.corners), com: unpack(data.ground.com) };

  function readColours() {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["paper", "page", "ink", "soft", "line", "grid", "trunk", "left", "right", "servos", "asked", "fail", "pass", "follow", "approach", "brake", "gated"])
      colour[name] = style.getPropertyValue("--" + name).trim();
  }

  function prepare(canvas) {
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.lineCap = pen.lineJoin = "round";
    return { pen, width, height };
  }

  function side(name) {
    return name.startsWith("l_") ? colour.left : name.startsWith("r_") ? colour.right : colour.ink;
  }

  function camera(figure, width, height) {
    const cx = figure.centre[2 * row], cy = figure.centre[2 * row + 1];
    const room = figure.height * 1.12 * Math.cos(ELEVATION) + 2 * figure.reach * Math.sin(ELEVATION) * 0.6;
    const scale = Math.min((height - 24) / room, (width - 16) / (2 * figure.reach));
    const floor = height - 12 - figure.reach * Math.sin(ELEVATION) * 0.6 * scale;
    const sin = Math.sin(azimuth), cos = Math.cos(azimuth);
    return (x, y, z) => {
      const dx = x - cx, dy = y - cy;
      const before = cos * dx + sin * dy;
      return [
        width / 2 + scale * (-sin * dx + cos * dy),
        floor - scale * (z * Math.cos(ELEVATION) - before * Math.sin(ELEVATION)),
        before * Math.cos(ELEVATION) + z * Math.sin(ELEVATION),
        scale,
      ];
    };
  }

  function drawFloor(pen, figure, project) {
    const step = niceStep(figure.height / 3), reach = figure.reach * 1.05;
    const cx = figure.centre[2 * row], cy = figure.centre[2 * row + 1];
    pen.strokeStyle = colour.grid;
    pen.lineWidth = 1;
    pen.beginPath();
    const count = Math.ceil(reach / step);
    const gx = Math.round(cx / step) * step, gy = Math.round(cy / step) * step;
    for (let i = -count; i <= count; i++) {
      for (const [x0, y0, x1, y1] of [[gx + i * step, gy - count * step, gx + i * step, gy + count * step], [gx - count * step, gy + i * step, gx + count * step, gy + i * step]]) {
        const a = project(x0, y0, 0), b = project(x1, y1, 0);
        pen.moveTo(a[0], a[1]);
        pen.lineTo(b[0], b[1]);
      }
    }
    pen.stroke();
    return step;
  }

  function niceStep(wanted) {
    const power = 10 ** Math.floor(Math.log10(wanted));
    return [1, 2, 5, 10].map((n) => n * power).find((n) => n >= wanted * 0.7) || wanted;
  }

  function length(metres) {
    return metres >= 1 ? metres + " m" : Math.round(metres * 1000) / 10 + " cm";
  }

  function drawBody(canvas, figure, isRobot) {
    const { pen, width, height } = prepare(canvas);
    const project = camera(figure, width, height);
    const step = drawFloor(pen, figure, project);
    if (isRobot && ground) drawSoles(pen, project);
    const count = figure.names.length;
    const at = (i) => {
      const k = 3 * (row * count + i);
      return project(figure.points[k], figure.points[k + 1], figure.points[k + 2]);
    };
    const bones = figure.bones.map(([a, b]) => [at(a), at(b), figure.names[b].match(/^[lr]_/) ? figure.names[b] : figure.names[a]]);
    bones.sort((p, q) => p[0][2] + p[1][2] - q[0][2] - q[1][2]);
    const thick = Math.max(2.5, Math.min(9, 0.022 * figure.height * project(0, 0, 0)[3]));
    for (const [a, b, name] of bones) {
      for (const [shade, wide] of [[colour.page, thick + 3], [side(name), thick]]) {
        pen.strokeStyle = shade;
        pen.lineWidth = wide;
        pen.beginPath();
        pen.moveTo(a[0], a[1]);
        pen.lineTo(b[0], b[1]);
        pen.stroke();
      }
    }
    const head = figure.names.indexOf("head");
    if (head >= 0) {
      const place = at(head);
      dot(pen, place, thick * 1.7, side("head"), true);
    }
    for (let i = 0; i < figure.mark_count; i++) {
      const k = 3 * (row * figure.mark_count + i);
      if (Number.isNaN(figure.marks[k])) continue;
      dot(pen, project(figure.marks[k], figure.marks[k + 1], figure.marks[k + 2]), isRobot ? 6 : 5, isRobot ? colour.asked : colour.servos, !isRobot);
    }
    pen.fillStyle = colour.soft;
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "left";
    pen.fillText("grid " + length(step), 8, 18);
  }

  function dot(pen, place, radius, shade, filled) {
    pen.beginPath();
    pen.arc(place[0], place[1], radius, 0, 2 * Math.PI);
    pen.lineWidth = 2;
    pen.fillStyle = pen.strokeStyle = shade;
    if (filled) { pen.fill(); pen.strokeStyle = colour.page; pen.lineWidth = 1.5; }
    pen.stroke();
  }

  function corners() {
    const total = ground.sizes.reduce((sum, size) => sum + size, 0);
    const feet = [];
    let start = 0;
    for (const size of ground.sizes) {
      const foot = [];
      for (let i = start; i < start + size; i++) {
        const k = 3 * (row * total + i);
        foot.push([ground.corners[k], ground.corners[k + 1], ground.corners[k + 2]]);
      }
      feet.push(foot);
      start += size;
    }
    return feet;
  }

  function shape(pen, points) {
    pen.beginPath();
    points.forEach((point, i) => (i ? pen.lineTo(point[0], point[1]) : pen.moveTo(point[0], point[1])));
    pen.closePath();
  }

  function drawSoles(pen, project) {
    for (const foot of corners()) {
      shape(pen, foot.map((corner) => project(...corner)));
      pen.fillStyle = colour.trunk;
      pen.strokeStyle = colour.line;
      pen.lineWidth = 1;
      pen.fill();
      pen.stroke();
    }
    const k = 3 * row;
    const above = project(ground.com[k], ground.com[k + 1], ground.com[k + 2]);
    const below = project(ground.com[k], ground.com[k + 1], 0);
    pen.strokeStyle = colour.soft;
    pen.setLineDash([3, 4]);
    pen.beginPath();
    pen.moveTo(above[0], above[1]);
    pen.lineTo(below[0], below[1]);
    pen.stroke();
    pen.setLineDash([]);
    dot(pen, below, 4, outside() ? colour.fail : colour.pass, true);
  }

  // Andrew's monotone chain, counter-clockwise.
  function hull(points) {
    const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const cross = (o, a, b) => (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    const chain = (list) => {
      const kept = [];
      for (const point of list) {
        while (kept.length > 1 && cross(kept[kept.length - 2], kept[kept.length - 1], point) <= 0) kept.pop();
        kept.push(point);
      }
      return kept.slice(0, -1);
    };
    return [...chain(sorted), ...chain(sorted.reverse())];
  }

  function support() {
    return hull(corners().flat().filter((corner) => corner[2] <= ground.contact));
  }

  // Distance inside the edges of the support polygon, m; negative outside, NaN in the air.
  function margin() {
    const polygon = support();
    if (polygon.length < 3) return NaN;
    const x = ground.com[3 * row], y = ground.com[3 * row + 1];
    let least = Infinity;
    polygon.forEach((a, i) => {
      const b = polygon[(i + 1) % polygon.length];
      const size = Math.hypot(b[0] - a[0], b[1] - a[1]);
      least = Math.min(least, ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / size);
    });
    return least;
  }

  function outside() {
    return !(margin() >= -1e-4);
  }

  const frame = ground && (() => {
    let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
    const include = (x, y) => {
      left = Math.min(left, x); right = Math.max(right, x); low = Math.min(low, y); high = Math.max(high, y);
    };
    for (let k = 0; k < ground.corners.length; k += 3) include(-ground.corners[k + 1], ground.corners[k]);
    for (let k = 0; k < ground.com.length; k += 3) include(-ground.com[k + 1], ground.com[k]);
    return { x: (left + right) / 2, y: (low + high) / 2, width: right - left, height: high - low };
  })();

  function drawAbove(canvas) {
    const { pen, width, height } = prepare(canvas);
    const scale = Math.min((width - 40) / frame.width, (height - 70) / frame.height);
    const place = (corner) => [width / 2 + scale * (-corner[1] - frame.x), height / 2 + 8 - scale * (corner[0] - frame.y)];
    for (const foot of corners()) {
      shape(pen, foot.map(place));
      const stands = foot.some((corner) => corner[2] <= ground.contact);
      pen.fillStyle = stands ? colour.trunk : "transparent";
      pen.strokeStyle = colour.line;
      pen.lineWidth = 1.5;
      pen.fill();
      pen.stroke();
    }
    const polygon = support();
    if (polygon.length > 2) {
      shape(pen, polygon.map(place));
      pen.setLineDash([6, 4]);
      pen.strokeStyle = colour.ink;
      pen.stroke();
      pen.setLineDash([]);
    }
    pen.strokeStyle = colour.right;
    pen.lineWidth = 1.5;
    pen.beginPath();
    for (let past = row; past >= 0 && data.time[row] - data.time[past] < 1000; past--) {
      const point = place([ground.com[3 * past], ground.com[3 * past + 1]]);
      past === row ? pen.moveTo(...point) : pen.lineTo(...point);
    }
    pen.stroke();
    const bad = outside(), inside = margin();
    dot(pen, place([ground.com[3 * row], ground.com[3 * row + 1]]), 6, bad ? colour.fail : colour.pass, true);
    pen.font = "600 13px system-ui, sans-serif";
    pen.textAlign = "left";
    pen.fillStyle = bad ? colour.fail : colour.pass;
    const mm = Math.abs(1000 * inside).toFixed(1);
    pen.fillText(Number.isNaN(inside) ? "nothing touches the ground" : bad ? mm + " mm outside" : mm + " mm inside", 10, 20);
    const bar = niceStep(frame.width / 5);
    pen.strokeStyle = pen.fillStyle = colour.soft;
    pen.font = "12px system-ui, sans-serif";
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(10, height - 10);
    pen.lineTo(10 + bar * scale, height - 10);
    pen.stroke();
    pen.fillText(length(bar), 16 + bar * scale, height - 6);
  }

  const outsideRows = ground && (() => {
    const kept = row;
    const found = data.time.map((_, at) => { row = at; return outside(); });
    row = kept;
    return found;
  })();

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
      if (outsideRows && outsideRows[i]) { pen.fillStyle = colour.fail; pen.fillRect(x, height - 5, wide, 5); }
    }
    if (data.stop !== null) { pen.fillStyle = colour.fail; pen.fillRect(at(data.stop) - 1.5, 0, 3, height); }
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
})();
