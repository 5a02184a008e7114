// The page of a run: what it shows, in which view, in which words. The server pauses the robot when poses stay away.

import { CAMERA, Camera, cameraMissing } from "./camera.js";
import { DeadMan, Stick, listenForHolding, listenForStop } from "./controls.js";
import { Headset, headsetMissing } from "./headset.js";
import { LINK, Link, median } from "./link.js";
import { Scene } from "./scene.js";

const byId = (id) => document.getElementById(id);
const BEFORE = /idle|waiting|countdown|calibrating|sides/; // states without torque
const STOPPING = /stop|fault|off|rest|return|end/;
const TONES = [[/follow/, "good"], [STOPPING, "bad"], [/refused|not connected/, "bad"], [/hold|pause|approach|arming/, "wary"]];
const STANCES = [
  [/countdown|calibrating/, "pose.svg", "Stand like one of these: arms hanging, or straight out to the sides"],
  [/sides/, "pose_left.svg", "Your left arm straight to the front, and only that"],
];
const MOST_AGES = 100;
const NOTE_MS = 20000; // so long a note of the run stays large

const page = {
  input: "watch", // what this page is to the server
  view: "choose", // choose, camera, headset or watch
  welcome: null,
  run: null, // the newest message "state"
  note: { text: "", at: 0 },
  paused: "", // reason of a pause
  refusal: "",
  stopRequested: false,
  ages: [], // ms, from the capture of a picture to its frame on the way, since the last report
  headsetMissing: "",
};

const link = new Link(receive, linked);
const deadMan = new DeadMan((message) => link.send(message), (held) => byId("pad").classList.toggle("held", held));
const stick = new Stick((message) => link.send(message), document.querySelectorAll(".stick"));
const camera = new Camera(byId("video"), byId("overlay"), sendPoses);
const scene = new Scene(byId("human"), byId("robot"), byId("layers"), byId("joint"));
const headset = new Headset({ send: sendPoses, deadMan, scene, stop, ended: () => choose("choose"), words: headline });

// Out.

function sendPoses(frame) {
  if (document.hidden && page.input !== "headset") return;
  if (link.frame(frame)) page.ages = [...page.ages.slice(-MOST_AGES), performance.now() - 1e3 * frame.time];
}

function stop() {
  page.stopRequested = true;
  link.stop();
  show();
}

// Something took the page away: dead man and stick count again when they are taken anew.
function letGo() {
  deadMan.release();
  stick.letGo();
  headset.letGo();
}

// In.

function receive(message) {
  if (message.type === "welcome") {
    welcomed(message);
  } else if (message.type === "note") {
    page.note = { text: message.text, at: performance.now() };
  } else if (message.type === "scene") {
    scene.meet(message);
  } else if (message.type === "paused") {
    page.paused = message.why;
  } else if (message.type === "state") {
    page.run = message;
    scene.pose(message);
    if (message.state === "ended") ended();
  }
  if (message.type !== "state") show();
}

function ended() {
  link.end();
  camera.stop();
}

function welcomed(message) {
  page.welcome = message;
  if (message.dead_man) deadMan.use();
  document.body.dataset.stick = message.stick;
  document.title = message.robot;
  document.body.dataset.performs = message.performs;
  if (!message.performs) byId("taken").lastChild.textContent = "The performer";
  if (!message.performs && page.view === "choose") choose("watch"); // the page of a run with another performer
  for (const place of document.querySelectorAll(".robot")) place.textContent = message.robot;
}

function linked(state, why) {
  if (state === LINK.LOST) letGo();
  if (state === LINK.REFUSED) {
    page.refusal = why;
    if (page.input !== "watch") choose("choose");
  }
  show();
}

// Views.

function join(input) {
  page.input = input;
  page.run = null;
  page.paused = "";
  link.open(input);
}

function choose(view) {
  if (view !== "choose") page.refusal = "";
  page.view = view;
  scene.share = view === "camera" ? 0.2 : 0.6;
  if (view !== "camera") camera.stop();
  const input = view === "choose" ? "watch" : view;
  if (input !== page.input || link.state === LINK.REFUSED) join(input);
  if (view === "camera") startCamera("");
  if (view === "headset") headset.start().catch((error) => {
    page.refusal = error.message;
    choose("choose");
  });
  stayAwake();
  show();
}

async function startCamera(device) {
  const missing = cameraMissing(page.welcome?.runtime);
  if (missing) camera.fail(missing);
  else await camera.start(device);
  if (camera.state === CAMERA.RUNNING) await listCameras();
  show();
}

async function listCameras() {
  const devices = await camera.devices();
  byId("camera").replaceChildren(...devices.map((device, i) => new Option(device.label || `Camera ${i + 1}`, device.deviceId, false, device.deviceId === camera.device)));
  byId("which").hidden = devices.length < 2;
}

// A phone that goes dark would end the performance.
async function stayAwake() {
  if (page.view === "choose" || document.hidden) return;
  try {
    await navigator.wakeLock?.request("screen");
  } catch {
    // Without it the page works, as long as the screen is on.
  }
}

// Words.

function headline() {
  if (link.state === LINK.REFUSED) return { state: "refused", why: page.refusal };
  if (link.state !== LINK.OPEN && page.run?.state === "ended") return { state: "ended", why: `${page.run.why ? `${page.run.why}. ` : ""}The run is over. Start the next one, and open its address.` };
  if (link.state === LINK.OPENING && !page.welcome) return { state: "connecting", why: "" };
  if (link.state !== LINK.OPEN) return { state: "not connected", why: lostText() };
  const state = page.run?.state || "waiting";
  const stopping = page.stopRequested && !STOPPING.test(state) ? (link.stopOwed ? "STOP is on its way." : "A stop is asked for.") : "";
  const why = stopping || page.run?.why || (BEFORE.test(state) ? "Nothing moves yet." : "");
  return { state, why, note: noteNow() };
}

function lostText() {
  if (link.stopOwed) return "The STOP did not reach the robot. Use its switch, or Ctrl-C where the run was started.";
  if (page.input === "watch") return "The run goes on without this page, which keeps trying.";
  return "No poses reach the robot, so it holds. This page keeps trying.";
}

function noteNow() {
  return performance.now() - page.note.at < NOTE_MS ? page.note.text : "";
}

function trouble() {
  if (document.hidden && page.view === "camera") return "This page is hidden, so nothing is sent now.";
  const paused = page.paused && `The robot is paused until "Go on" is pressed: ${page.paused}.`;
  return (page.view === "camera" && camera.trouble) || (page.view === "headset" && headset.trouble) || paused || (page.view === "choose" && (page.refusal || (page.headsetMissing && cameraMissing(page.welcome?.runtime)))) || "";
}

// "l_wrist" as people say it.
function sensorWords(text) {
  return text.replace(/\bl_(?=\w)/g, "left ").replace(/\br_(?=\w)/g, "right ");
}

function put(id, words) {
  const place = byId(id), plain = sensorWords(words), text = plain.charAt(0).toUpperCase() + plain.slice(1);
  if (place.textContent !== text) place.textContent = text;
  place.hidden = !text;
}

function list(id, rows) {
  const key = JSON.stringify(rows);
  if (byId(id).dataset.key === key) return;
  byId(id).dataset.key = key;
  byId(id).replaceChildren(...rows.map(([text, kind]) => Object.assign(document.createElement("li"), { textContent: text, className: kind })));
}

function numbers() {
  const parts = Object.entries(page.run?.latency_ms || {}).map(([name, ms]) => `${name} ${ms.toFixed(0)} ms`);
  if (page.run?.imu) parts.push(page.run.imu);
  if (link.round_ms !== null) parts.push(`network ${link.round_ms.toFixed(0)} ms, to the run and back`);
  if (camera.state === CAMERA.RUNNING) parts.push(`${camera.fps.toFixed(0)} pictures a second`, `${camera.took_ms.toFixed(0)} ms to find you`);
  if (page.view === "headset") parts.push(`${headset.fps} poses a second`);
  return parts.join("  ·  ");
}

function show() {
  const { state, why, note } = headline();
  byId("stop").disabled = link.state !== LINK.OPEN && page.run?.state === "ended"; // no robot is there to be stopped
  const connected = link.state === LINK.OPEN;
  const run = (connected && page.run) || {}; // what was last known is not known any more
  document.body.dataset.view = page.view;
  document.body.dataset.linked = connected;
  document.body.dataset.tone = TONES.find(([words]) => words.test(state))?.[1] || "calm";
  put("state", state);
  put("why", why);
  put("note", note || "");
  put("trouble", trouble());
  put("numbers", numbers());
  list("sensors", Object.entries(run.sensors || {}).map(([name, good]) => [good ? `✓ ${sensorWords(name)}` : `✕ ${sensorWords(name)} not seen`, good ? "good" : "bad"]));
  list("clipped", (run.clipped || []).map((text) => [text, "wary"]));
  showStance(state);
  byId("pause").textContent = page.paused ? "Go on" : "Pause";
  byId("pause").disabled = byId("hold").disabled = !connected;
  byId("hold").checked = deadMan.used;
  if (deadMan.used) byId("hold").disabled = true; // from its first use on, the robot holds without it
  byId("pad").hidden = !deadMan.used || page.view === "headset";
  byId("own").hidden = camera.state !== CAMERA.RUNNING;
  byId("again").hidden = page.view !== "camera" || camera.state !== CAMERA.FAILED;
  showInputs(connected);
}

function showStance(state) {
  const [, drawing, words] = STANCES.find(([when]) => when.test(state)) || [];
  byId("pose").hidden = !drawing;
  if (!drawing || byId("stance").textContent === words) return;
  byId("drawing").src = `page/${drawing}`;
  byId("drawing").alt = byId("stance").textContent = words;
}

function showInputs(connected) {
  const missing = { camera: cameraMissing(page.welcome?.runtime), headset: page.headsetMissing, watch: "" };
  for (const button of document.querySelectorAll("[data-input]")) {
    const why = missing[button.dataset.input];
    const words = button.querySelector("span");
    words.dataset.words ||= words.textContent;
    button.disabled = !connected || Boolean(why);
    if (words.textContent !== (why || words.dataset.words)) words.textContent = why || words.dataset.words;
  }
}

function health() {
  link.send({
    type: "health",
    fps: page.view === "headset" ? headset.fps : camera.fps,
    infer_ms: Math.round(camera.took_ms),
    camera: camera.words,
    hidden: document.hidden,
    rtt_ms: link.round_ms,
    send_ms: median(page.ages),
    trouble: trouble(),
    secure: self.isSecureContext,
    wasm: typeof WebAssembly === "object",
    permission: page.permission || "unknown",
    agent: (navigator.userAgent.match(/(Edg|OPR|OculusBrowser|SamsungBrowser|Firefox|Chrome|Version)\/[\d]+/) || [navigator.userAgent.slice(0, 60)])[0].replace("/", " ").replace("Version", "Safari"),
  });
  page.ages = [];
}

async function queryPermission() {
  try {
    const status = await navigator.permissions.query({ name: "camera" });
    const keep = () => { page.permission = status.state; };
    status.onchange = keep;
    keep();
  } catch {
    page.permission = "unknown"; // not every browser has the query
  }
}

function wire() {
  byId("stop").onclick = stop;
  byId("pause").onclick = () => link.send({ type: page.paused ? "go on" : "pause" });
  byId("hold").onchange = () => { deadMan.use(); show(); };
  byId("again").onclick = () => startCamera(byId("camera").value);
  byId("camera").onchange = () => startCamera(byId("camera").value);
  byId("leave").onclick = () => choose("choose");
  for (const button of document.querySelectorAll("[data-input]")) button.onclick = () => choose(button.dataset.input);
  listenForStop(stop);
  listenForHolding(deadMan, byId("pad"));
  document.addEventListener("visibilitychange", () => {
    if (document.hidden) letGo();
    else stayAwake();
    health();
  });
  setInterval(show, 100);
  setInterval(health, 1000);
}

wire();
queryPermission();
headsetMissing().then((why) => { page.headsetMissing = why; });
join("watch");
show();
