// One joint over time: its goal, and the measurements of its servo.
import { colour, niceStep } from "./figure.js";

const QUANTITIES = { // words: unit, and the values at a row
  "angle": ["°", { goal: (at) => at("goal"), servo: (at) => at("servo") }],
  "off its goal": ["°", { servo: (at) => at("goal") - at("servo") }],
  "temperature": ["°C", { servo: (at) => at("temperature") }],
  "current": ["A", { servo: (at) => at("current") }],
};
const MOST = 1500; // points of a line
const LEAST = 0.1; // of the height: what trembles by less is flat

export class JointPlot {
  // place: holds two selections and a canvas. joints: names; measured: whether temperature and current are known.
  constructor(place, joints, measured, changed) {
    [this.joint, this.quantity] = place.querySelectorAll("select");
    this.canvas = place.querySelector("canvas");
    this.count = joints.length;
    this.joint.replaceChildren(...joints.map((name, i) => new Option(name, i)));
    this.quantity.replaceChildren(...Object.keys(QUANTITIES).slice(0, measured ? 4 : 2).map((name) => new Option(name)));
    this.joint.onchange = this.quantity.onchange = changed;
    place.hidden = !joints.length;
  }

  // times: of `rows` rows, s; values(name, row, joint): of "goal", "servo" [degrees], "temperature", "current"; now: s.
  draw(times, values, now) {
    const { canvas, count } = this, pen = canvas.getContext("2d"), ratio = window.devicePixelRatio || 1, [wide, high] = [canvas.clientWidth, canvas.clientHeight];
    if (!count || !wide || times.length < 2) return;
    Object.assign(canvas, { width: wide * ratio, height: high * ratio });
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    const [unit, lines] = QUANTITIES[this.quantity.value], joint = Number(this.joint.value), every = Math.ceil(times.length / MOST);
    const rows = Array.from({ length: Math.ceil(times.length / every) }, (_, i) => i * every);
    const curves = Object.entries(lines).map(([name, value]) => [name, rows.map((row) => value((which) => values(which, row, joint)))]);
    const known = curves.flatMap(([, curve]) => curve.filter(Number.isFinite)), low = Math.min(...known), top = Math.max(...known);
    if (!known.length) return;
    const step = niceStep(Math.max(top - low, LEAST) / 3), from = step * Math.floor(low / step), to = step * Math.max(Math.ceil(top / step), Math.floor(low / step) + 1);
    const x = (time) => 52 + (wide - 60) * (time - times[0]) / (times[times.length - 1] - times[0]), y = (value) => 8 + (high - 16) * (to - value) / (to - from);
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (let value = from; value < to + step / 2; value += step) {
      stroke(pen, colour.grid, 1, [[52, y(value)], [wide - 8, y(value)]]);
      pen.fillStyle = colour.soft;
      pen.fillText(`${Number(value.toPrecision(3))} ${unit}`, 46, y(value));
    }
    for (const [name, curve] of curves) stroke(pen, name === "goal" ? colour.line : colour.ink, name === "goal" ? 5 : 1.5, rows.map((row, i) => [x(times[row]), y(curve[i])]));
    stroke(pen, colour.fail, 1, [[x(now), 4], [x(now), high - 4]]);
  }
}

function stroke(pen, shade, width, points) {
  Object.assign(pen, { strokeStyle: shade, lineWidth: width, lineJoin: "round" });
  pen.beginPath();
  let on = false; // what is not known leaves a gap
  for (const [x, y] of points) {
    const known = Number.isFinite(y);
    if (known) pen[on ? "lineTo" : "moveTo"](x, y);
    on = known;
  }
  pen.stroke();
}
