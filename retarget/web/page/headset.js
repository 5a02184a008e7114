// A headset as the performer's sensors, by WebXR: poses go out, the robot's ghost and a sign with its state come back.
//
// The robot moves while a grip is squeezed (with bare hands: while one hand is pinched). STOP in the headset: button B or Y,
// or both hands pinched for a second, or the trigger (a pinch) while pointing at the red field of the sign.

import { Bodies, TO_WEBXR, multiply } from "../bodies.js";
import { Sign } from "./sign.js";

const PER_SECOND = 90; // frames sent at most
const AHEAD = 1.5; // m, from the performer to the ghost
const GHOST_HEIGHT = 1.2; // m; a smaller robot is shown in this size
const STOP_BUTTONS = [4, 5]; // A/X, B/Y of the xr-standard mapping; both stop, since a hurried thumb finds either
const BOTH_PINCHED_MS = 1000;
const PULSE = [0.8, 200]; // strength, ms

// WebXR's joints of a tracked body -> ours. The legs are made up by today's headsets: the run leaves them out.
const BODY = {
  "hips": "pelvis", "spine-upper": "chest", "left-arm-lower": "l_elbow", "right-arm-lower": "r_elbow",
  "left-lower-leg": "l_knee", "right-lower-leg": "r_knee", "left-foot-ankle": "l_ankle", "right-foot-ankle": "r_ankle",
};
const WRIST = { left: "l_wrist", right: "r_wrist" };
// Our hands are unturned where arms hang, as a grip is; WebXR's bare hands where they point ahead, palms down.
const FLAT = { left: [0.5, -0.5, -0.5, 0.5], right: [0.5, 0.5, 0.5, 0.5] };

// The reason, in a sentence, why this browser cannot be a headset; "" if it can.
export async function headsetMissing() {
  if (!self.isSecureContext) return "A browser gives its headset only to https or localhost. Start the run with --listen, which serves https.";
  if (!navigator.xr) return "This browser has no WebXR. Open this page in the browser of the headset.";
  return (await mode()) ? "" : "No headset is connected. Open this page in the browser of the headset.";
}

async function mode() {
  for (const name of ["immersive-ar", "immersive-vr"]) {
    if (await navigator.xr.isSessionSupported(name).catch(() => false)) return name;
  }
  return null;
}

function pose(found) {
  const { position: p, orientation: q } = found.transform;
  return { p: [p.x, p.y, p.z], q: [q.x, q.y, q.z, q.w], tracked: !found.emulatedPosition };
}

function product([a, b, c, d], [x, y, z, w]) {
  return [d * x + a * w + b * z - c * y, d * y - a * z + b * w + c * x, d * z + a * y - b * x + c * w, d * w - a * x - b * y - c * z];
}

// Poses of one frame in `space`, by our names. What is not known is left out.
function posesOf(frame, space, viewer) {
  const poses = {};
  if (viewer) poses.head = pose(viewer);
  for (const source of frame.session.inputSources) {
    const name = WRIST[source.handedness];
    const at = source.hand ? frame.getJointPose(source.hand.get("wrist"), space) : source.gripSpace && frame.getPose(source.gripSpace, space);
    if (name && at) poses[name] = pose(at);
    if (poses[name] && source.hand) poses[name].q = product(poses[name].q, FLAT[source.handedness]);
  }
  for (const [joint, name] of Object.entries(BODY)) {
    const at = frame.body?.get(joint) && frame.getPose(frame.body.get(joint), space);
    if (!at) continue;
    const { p, tracked } = pose(at); // the turns of WebXR's joints are others than ours
    poses[name] = { p, tracked };
  }
  return poses;
}

// The requests of the hands: held (the robot may move), stop, and both (both hands are pinched).
export function pressed(sources, pinching) {
  const both = ["left", "right"].every((side) => pinching.has(side));
  const hold = (source) => (source.hand ? pinching.has(source.handedness) && !both : source.gamepad?.buttons[1]?.pressed);
  const stops = (source) => !source.hand && STOP_BUTTONS.some((i) => source.gamepad?.buttons[i]?.pressed);
  const list = [...sources];
  return { held: list.some(hold), stop: list.some(stops), both };
}

export class Headset {
  // page: {send(frame), deadMan, scene, stop(), ended(), words() -> {state, why, note}}
  constructor(page) {
    this.page = page;
    this.session = null;
    this.trouble = "";
    this.pinching = new Set();
    this.count = 0;
    this.sent = []; // ms, of the last second
  }

  get fps() {
    return this.sent.filter((at) => at > performance.now() - 1000).length;
  }

  // After a loss the grip counts only when it was let go and taken anew.
  letGo() {
    this.anew = true;
    this.page.deadMan.press("grip", false);
  }

  // Must be called from a click. Raises Error with a sentence.
  async start() {
    const name = await mode();
    if (!name) throw new Error("No headset is connected.");
    const features = { requiredFeatures: ["local-floor"], optionalFeatures: ["hand-tracking", "body-tracking"] };
    const session = await navigator.xr.requestSession(name, features).catch((error) => {
      throw new Error(`The headset refused: ${error.message}`);
    });
    this.session = session;
    session.onend = () => this.#ended();
    session.onvisibilitychange = () => session.visibilityState !== "visible" && this.letGo();
    session.onselectstart = (event) => this.#select(event, true);
    session.onselectend = (event) => this.#select(event, false);
    const gl = document.createElement("canvas").getContext("webgl2", { xrCompatible: true });
    if (!gl) throw new Error("This browser has no WebGL 2, which draws the robot.");
    this.#prepare(gl, await session.requestReferenceSpace("local-floor"), name === "immersive-ar");
    await session.updateRenderState({ baseLayer: new XRWebGLLayer(session, gl) });
    this.page.deadMan.use();
    session.requestAnimationFrame((...next) => this.#frame(...next));
  }

  #prepare(gl, space, seeThrough) {
    Object.assign(this, { gl, space, seeThrough, due: 0, anchor: null, ghost: null, bothSince: null, lastState: "", stopDown: false, anew: true });
    this.space.onreset = () => { this.anchor = null; }; // the performer has set the room anew
    this.sign = new Sign(gl);
    this.pinching.clear();
  }

  #ended() {
    this.session = null;
    this.letGo();
    this.page.ended();
  }

  #select(event, begun) {
    const { handedness, hand, targetRaySpace } = event.inputSource;
    if (hand && begun) this.pinching.add(handedness);
    else this.pinching.delete(handedness);
    const ray = begun && event.frame.getPose(targetRaySpace, this.space);
    if (ray && this.sign.pointedAt(ray.transform.matrix)) this.page.stop();
  }

  #frame(time, frame) {
    const session = frame.session;
    if (session !== this.session) return;
    session.requestAnimationFrame((...next) => this.#frame(...next));
    const viewer = frame.getViewerPose(this.space);
    this.#press(session.inputSources, time);
    if (session.visibilityState === "visible") this.#send(time, frame, viewer);
    this.#pulse(session.inputSources);
    if (viewer) this.#draw(viewer);
  }

  #press(sources, time) {
    const { held, stop, both } = pressed(sources, this.pinching);
    if (!held) this.anew = false;
    this.page.deadMan.press("grip", held && !this.anew);
    this.page.deadMan.tick();
    this.bothSince = both ? this.bothSince ?? time : null;
    const requested = stop || (both && time - this.bothSince >= BOTH_PINCHED_MS);
    if (requested && !this.stopDown) this.page.stop();
    this.stopDown = requested;
  }

  #send(time, frame, viewer) {
    if (time < this.due) return;
    this.due = Math.max(this.due + 1000 / PER_SECOND, time);
    const poses = posesOf(frame, this.space, viewer);
    this.trouble = poses.head ? "" : "The headset does not know where it is. Look around, with more light.";
    if (!Object.keys(poses).length) return;
    this.page.send({ axes: "webxr", quaternion: "xyzw", time: time / 1e3, frame: this.count++, poses });
    this.sent = [...this.sent.filter((at) => at > time - 1000), performance.now()];
  }

  #pulse(sources) {
    const { state } = this.page.words();
    if (state !== this.lastState && /hold|pause|stop|not connected/.test(state)) {
      for (const source of sources) source.gamepad?.hapticActuators?.[0]?.pulse?.(...PULSE);
    }
    this.lastState = state;
  }

  #words() {
    const words = this.page.words(), how = this.bareHands ? "pinch one hand" : "squeeze a grip";
    const hint = this.anew ? `Let go, then ${how}` : this.page.deadMan.held ? "" : `The robot moves while you ${how}`;
    return { ...words, why: words.why || hint };
  }

  get bareHands() {
    return [...this.session.inputSources].some((source) => source.hand);
  }

  // The ghost stands where the performer looked first, and faces the same way: its left is the performer's.
  #place(viewer) {
    const { position: p, orientation: q } = viewer.transform;
    const ahead = [-2 * (q.x * q.z + q.w * q.y), -(1 - 2 * (q.x * q.x + q.y * q.y))]; // x, z of where the head looks
    const yaw = Math.atan2(-ahead[0], -ahead[1]);
    // REP-103: x forward is -z of WebXR, y left is -x.
    this.anchor = { offset: [-p.z + AHEAD * Math.cos(yaw), -p.x + AHEAD * Math.sin(yaw), 0], yaw };
    this.ghost = null;
  }

  #draw(viewer) {
    const { gl, page: { scene } } = this;
    const layer = this.session.renderState.baseLayer;
    if (!this.anchor) this.#place(viewer);
    if (!this.ghost && scene.robot) {
      this.ghost = new Bodies(gl);
      this.ghost.add("robot", scene.robot, { ...this.anchor, scale: Math.max(1, GHOST_HEIGHT / scene.robot.height), alpha: 0.85 });
    }
    if (scene.frames.robot) this.ghost?.pose("robot", scene.frames.robot.poses);
    gl.bindFramebuffer(gl.FRAMEBUFFER, layer.framebuffer);
    gl.clearColor(...(this.seeThrough ? [0, 0, 0, 0] : [0.16, 0.19, 0.23, 1]));
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.sign.follow(viewer.transform);
    this.sign.write(this.#words(), this.bareHands);
    for (const view of viewer.views) {
      const { x, y, width, height } = layer.getViewport(view);
      gl.viewport(x, y, width, height);
      const inverse = view.transform.inverse.matrix;
      if (this.ghost) this.ghost.draw(multiply(inverse, TO_WEBXR), view.projectionMatrix);
      this.sign.draw(inverse, view.projectionMatrix);
    }
  }
}
