// A body of lines on its ground, seen from the front left and slightly above; a drag turns it.
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
  if (obstacles && (isRobot || !bodies.robot)) drawObstacles(pen, project);
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
    for (const [shade, wide, cap] of [[colour.page, thick + 3, "butt"], [side(name), thick, "round"]]) {
      pen.strokeStyle = shade;
      pen.lineCap = cap;
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

function drawObstacles(pen, project) {
  const count = obstacles.points.length / 3 / obstacles.rows;
  const from = 3 * count * Math.min(row, obstacles.rows - 1);
  const at = (i) => project(...obstacles.points.subarray(from + 3 * i, from + 3 * i + 3));
  pen.strokeStyle = colour.gated;
  pen.lineWidth = 1.2;
  pen.beginPath();
  for (const [a, b] of obstacles.edges) {
    const p = at(a), q = at(b);
    pen.moveTo(p[0], p[1]);
    pen.lineTo(q[0], q[1]);
  }
  pen.stroke();
}

function dot(pen, place, radius, shade, filled) {
  pen.beginPath();
  pen.arc(place[0], place[1], radius, 0, 2 * Math.PI);
  pen.lineWidth = 2;
  pen.fillStyle = pen.strokeStyle = shade;
  if (filled) { pen.fill(); pen.strokeStyle = colour.page; pen.lineWidth = 1.5; }
  pen.stroke();
}
