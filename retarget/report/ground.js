// The centre of mass over the support polygon: under the robot, and from above.
function soles(at) {
  const corners = part(ground.corners, at);
  let from = 0;
  return ground.sizes.map((size) => {
    from += size;
    return Array.from({ length: size }, (_, i) => [...corners.subarray(3 * (from - size + i), 3 * (from - size + i + 1))]);
  });
}

function closed(points) {
  return points.flatMap((point, i) => [...point, ...points[(i + 1) % points.length]]);
}

// Soles, the centre of mass, and the point below it.
function showGround(scene, size, at) {
  const [x, y, z] = part(ground.com, at), outside = !(ground.margin[at] >= -1e-4);
  scene.lines("soles", soles(at).flatMap(closed), { colour: rgb("ink"), width: 1, over: true });
  scene.lines("drop", [x, y, z, x, y, 0], { colour: rgb("soft"), width: 1, over: true });
  scene.lines("com", crosses([x, y, z, x, y, 0], size), { colour: rgb(outside ? "fail" : "pass"), width: 2, over: true });
  return outside;
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

const above = ground && Bodies.on($("view-above"));

function drawAbove() {
  const [length, width] = ground.span, canvas = $("view-above"), aspect = canvas.clientWidth / canvas.clientHeight;
  const cell = niceStep(width / 5), outside = showGround(above, width / 25, row), track = [];
  const support = hull(soles(row).flat().filter((corner) => corner[2] <= ground.contact));
  for (let past = row; past > 0 && data.time[row] - data.time[past] < 1000; past--)
    track.push(...part(ground.com, past).slice(0, 2), 0, ...part(ground.com, past - 1).slice(0, 2), 0);
  above.lines("floor", grid(cell, width + length, ...ground.middle), { colour: rgb("grid"), width: 1 });
  above.lines("support", closed(support), { colour: rgb("ink"), width: 2.5, over: true });
  above.lines("track", track, { colour: rgb("right"), over: true });
  const field = 0.01, half = 0.65 * Math.max(length, width / aspect); // seen from so far that heights do not show
  above.clear();
  above.draw(...orbit(Math.PI, Math.PI / 2, half / Math.tan(field / 2), [...ground.middle, 0], aspect, field));
  const margin = ground.margin[row], mm = Math.abs(1000 * margin).toFixed(1);
  $("say-above").textContent = Number.isNaN(margin) ? "nothing touches the ground" : mm + (outside ? " mm outside" : " mm inside");
  $("say-above").className = outside ? "fail" : "pass";
}
