// The centre of mass over the support polygon: under the robot, and from above.
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

function pairs(points) {
  return points.flatMap((point, i) => [...point, ...points[(i + 1) % points.length]]);
}

// Soles, the centre of mass, and where it is above.
function showGround(scene, size) {
  const [x, y, z] = ground.com.subarray(3 * row, 3 * row + 3);
  scene.lines("soles", corners().flatMap(pairs), { colour: rgb("ink"), width: 1, over: true });
  scene.lines("drop", [x, y, z, x, y, 0], { colour: rgb("soft"), width: 1, over: true });
  scene.lines("com", crosses([x, y, z, x, y, 0], size), { colour: rgb(outside() ? "fail" : "pass"), width: 2, over: true });
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
  pen.beginPath();
  pen.arc(...place([ground.com[3 * row], ground.com[3 * row + 1]]), 6, 0, 2 * Math.PI);
  pen.fillStyle = bad ? colour.fail : colour.pass;
  pen.fill();
  pen.font = "600 13px system-ui, sans-serif";
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
