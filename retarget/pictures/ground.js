// The centre of mass over the support polygon, from above.
import { Bodies, grid, orbit } from "./bodies.js";
import { closed, niceStep, rgb, showGround, soles } from "./figure.js";

// Andrew's monotone chain, counter-clockwise.
function hull(points) {
  const sorted = points.toSorted((a, b) => a[0] - b[0] || a[1] - b[1]);
  const isRight = (o, a, b) => (a[0] - o[0]) * (b[1] - o[1]) <= (a[1] - o[1]) * (b[0] - o[0]);
  return [sorted, sorted.toReversed()].flatMap((list) => list.reduce((kept, point) => {
    while (kept.length > 1 && isRight(kept.at(-2), kept.at(-1), point)) kept.pop();
    return [...kept, point];
  }, []).slice(0, -1));
}

const above = ground && Bodies.on($("view-above"));

function drawAbove() {
  const [length, width] = ground.span, canvas = $("view-above"), aspect = canvas.clientWidth / canvas.clientHeight, now = standing(row);
  const cell = niceStep(width / 5), outside = showGround(above, now, ground.sizes, width / 25), track = [];
  const support = hull(soles(now, ground.sizes).flat().filter((corner) => corner[2] <= ground.contact));
  for (let past = row; past > 0 && data.time[row] - data.time[past] < 1000; past--)
    track.push(...part(ground.com, past).slice(0, 2), 0, ...part(ground.com, past - 1).slice(0, 2), 0);
  above.lines("floor", grid(cell, width + length, ...ground.middle), { colour: rgb("grid"), width: 1 });
  above.lines("support", closed(support), { colour: rgb("ink"), width: 2.5, over: true });
  above.lines("track", track, { colour: rgb("right"), over: true });
  const field = 0.01, half = 0.65 * Math.max(length, width / aspect); // seen from so far that heights do not show
  above.clear();
  above.draw(...orbit(Math.PI, Math.PI / 2, half / Math.tan(field / 2), [...ground.middle, 0], aspect, field));
  const margin = ground.margin[row], mm = Math.abs(1000 * margin).toFixed(1);
  $("output-above").textContent = Number.isNaN(margin) ? "nothing touches the ground" : mm + (outside ? " mm outside" : " mm inside");
  $("output-above").className = outside ? "fail" : "pass";
}
