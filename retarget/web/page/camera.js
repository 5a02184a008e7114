// A camera as the performer's sensors: its newest picture goes to the worker, the landmarks found there go on as frames.

import { SEEN, wrongWith } from "./people.js";

const SIDES = [
  [[11, 13, 15, 19], [23, 25, 27, 31], [11, 23]], // the person's left: arm, leg, flank (MediaPipe's numbers)
  [[12, 14, 16, 20], [24, 26, 28, 32], [12, 24]],
  [[11, 12], [23, 24], [7, 0, 8]],
];
const WIDEST = 960; // px; a larger picture is made 640 wide, since the model looks at 256 anyway
const SLOW_FPS = 8, FAST_FPS = 10; // below the first, the page warns until it is above the second
const COUNTED_MS = 3000; // pictures are counted over so long
const DARK = 40; // of 255, mean of the picture
const SENTENCE_AFTER_MS = 500; // a sentence that comes and goes faster is not shown
const STILL_MS = 700; // without a new picture the camera counts as stalled
const STARTING_MS = 20000;

export const CAMERA = Object.freeze({ OFF: "off", STARTING: "starting", RUNNING: "running", FAILED: "failed" });

const SENTENCES = {
  nobody: "Nobody is in the picture.",
  part: "Only a part of you is in the picture. Step back until the camera sees you from head to feet.",
  head: "The camera does not see your head. Step back, or tilt it up.",
  feet: "The camera does not see your feet. Step back, or tilt it down.",
  two: "Two people are in the picture. Only the performer may be, so nothing is sent now.",
  dark: "It is too dark for the camera. Switch on a light.",
  slow: "The camera or this computer is too slow. More light and fewer open programs help.",
  still: "The camera's picture stands still, so nothing is sent now.",
};

const REFUSALS = {
  NotAllowedError: "The browser was not allowed to use the camera. Allow it at the camera sign in the address line, then try again.",
  NotFoundError: "No camera was found. Connect one, then try again.",
  OverconstrainedError: "The chosen camera is gone. Choose another one.",
  NotReadableError: "The camera is in use by another program. Close that, then try again.",
};

// The reason, in a sentence, why this browser cannot be a camera; "" if it can.
export function cameraMissing(runtime) {
  if (!self.isSecureContext) {
    const local = `http://localhost:${location.port}${location.pathname}`;
    return `The browser gives its camera only to https or localhost. Start the run with --listen, which serves https, or connect a phone by cable, run "adb reverse tcp:${location.port} tcp:${location.port}" and open ${local} there.`;
  }
  if (typeof WebAssembly !== "object") return "This browser has no WebAssembly, which finds you in the picture. Use a newer one.";
  if (!HTMLVideoElement.prototype.requestVideoFrameCallback || !self.OffscreenCanvas || !self.createImageBitmap) {
    return "This browser is too old to find you in the picture. Use Chrome, Edge, Safari or Firefox of 2024 or later.";
  }
  if (!navigator.mediaDevices?.getUserMedia) return "This browser gives no access to a camera.";
  if (runtime === false) return "What finds you in the picture is not installed. On the computer of the robot, run: retarget web install";
  return "";
}

export class Camera {
  // video, overlay: where it is shown. send(frame): takes a frame of the protocol.
  constructor(video, overlay, send) {
    this.video = video;
    this.overlay = overlay;
    this.send = send;
    this.state = CAMERA.OFF;
    this.failure = "";
    this.worker = null;
    this.waits = false; // true if the picture on the screen has not been processed
    this.busy = false;
    this.time = 0; // s, of that picture
    this.startedAt = this.pictureAt = 0;
    this.tellsCapture = null;
    this.frames = 0;
    this.done = []; // ms, when the newest results came
    this.isSlow = false;
    this.took_ms = 0;
    this.wrong = { key: "", since: 0 };
    this.probe = new OffscreenCanvas(16, 12).getContext("2d", { willReadFrequently: true });
  }

  // Opens a camera (`device`: its id, or "" for the one that faces the performer). See the state for the outcome.
  async start(device) {
    this.stop();
    this.state = CAMERA.STARTING;
    try {
      await Promise.all([this.#openCamera(device), this.#openWorker()]);
      if (this.state !== CAMERA.STARTING) return;
      this.state = CAMERA.RUNNING;
      this.done = [];
      this.isSlow = false;
      this.tellsCapture = null;
      this.startedAt = this.pictureAt = performance.now();
      this.video.requestVideoFrameCallback((now, about) => this.#picture(now, about));
    } catch (error) {
      this.fail(REFUSALS[error.name] || String(error.message || error));
    }
  }

  stop() {
    this.state = CAMERA.OFF;
    this.failure = "";
    this.worker?.terminate();
    this.worker = null;
    this.waits = this.busy = false;
    this.video.srcObject?.getTracks().forEach((track) => track.stop());
    this.video.srcObject = null;
    this.overlay.width = 0;
  }

  fail(sentence) {
    this.stop();
    this.state = CAMERA.FAILED;
    this.failure = sentence;
  }

  // The cameras of this computer, once one was allowed.
  async devices() {
    const all = await navigator.mediaDevices.enumerateDevices();
    return all.filter((device) => device.kind === "videoinput");
  }

  get device() {
    return this.video.srcObject?.getVideoTracks()[0]?.getSettings().deviceId || "";
  }

  async #openCamera(device) {
    const which = device ? { deviceId: { exact: device } } : { facingMode: "user" };
    const video = { ...which, width: { ideal: 640 }, height: { ideal: 480 }, frameRate: { ideal: 30 } };
    const stream = await navigator.mediaDevices.getUserMedia({ video, audio: false });
    if (this.state !== CAMERA.STARTING) return stream.getTracks().forEach((track) => track.stop());
    this.video.srcObject = stream;
    stream.getVideoTracks()[0].onended = () => this.fail("The camera was taken away, so nothing is sent now. Connect it, then try again.");
    await this.video.play();
  }

  #openWorker() {
    return new Promise((resolve, reject) => {
      const late = setTimeout(() => reject(new Error("What finds you in the picture did not start. Reload the page.")), STARTING_MS);
      this.worker = new Worker(new URL("pose_worker.js", import.meta.url), { type: "module" });
      this.worker.onerror = () => reject(new Error("This browser is too old to find you in the picture. Use a newer one."));
      this.worker.onmessage = ({ data }) => {
        clearTimeout(late);
        if (data.ready) resolve();
        else if (data.landmarks) this.#found(data);
        else if (this.state === CAMERA.RUNNING) this.fail(`What finds you in the picture failed: ${data.failed}`);
        else reject(new Error(`What finds you in the picture did not start: ${data.failed}`));
      };
      this.worker.postMessage({ base: document.baseURI });
    });
  }

  // A new picture is on the screen.
  #picture(now, about) {
    if (this.state !== CAMERA.RUNNING) return;
    this.video.requestVideoFrameCallback((...next) => this.#picture(...next));
    this.pictureAt = performance.now();
    const time = this.#timeOf(now, about);
    if (!(time > this.time)) return;
    this.time = time;
    this.waits = true;
    this.#feed();
  }

  // Time of capture, s; where the browser does not know it, of its showing, and never both from one camera.
  #timeOf(now, { captureTime }) {
    this.tellsCapture ??= captureTime <= this.pictureAt && captureTime > now - 1000;
    return (this.tellsCapture ? captureTime : now) / 1e3;
  }

  // The worker gets one picture at a time, and the newest there is.
  async #feed() {
    if (this.busy || !this.waits) return;
    const { time, worker } = this, large = this.video.videoWidth > WIDEST;
    this.busy = true;
    this.waits = false;
    const picture = await createImageBitmap(this.video, large ? { resizeWidth: 640 } : {});
    worker.postMessage({ picture, time }, [picture]);
  }

  #found({ time, landmarks, crowded, took_ms }) {
    this.busy = false;
    if (this.state !== CAMERA.RUNNING) return;
    this.#feed();
    const wrong = crowded ? "two" : wrongWith(landmarks);
    const size = [this.video.videoWidth, this.video.videoHeight];
    this.send({ axes: "camera", time, frame: this.frames++, size, landmarks: crowded ? [] : landmarks });
    this.done.push(performance.now());
    this.took_ms += 0.1 * (took_ms - this.took_ms);
    if (wrong !== this.wrong.key) this.wrong = { key: wrong, since: performance.now() };
    this.#draw(landmarks);
  }

  #draw(landmarks) {
    const { overlay, video } = this;
    if (overlay.width !== video.videoWidth || overlay.height !== video.videoHeight) {
      overlay.width = video.videoWidth;
      overlay.height = video.videoHeight;
    }
    const pen = overlay.getContext("2d");
    pen.clearRect(0, 0, overlay.width, overlay.height);
    pen.lineCap = pen.lineJoin = "round";
    if (!landmarks.length) return;
    SIDES.forEach((lines, side) => {
      for (const [colour, width] of [["rgb(0 0 0 / 0.5)", 9], [["#ff8a3c", "#4db8ff", "#ffffff"][side], 5]]) {
        pen.strokeStyle = colour;
        pen.lineWidth = width * overlay.width / 640;
        for (const line of lines) this.#stroke(pen, line, landmarks);
      }
    });
  }

  #stroke(pen, line, landmarks) {
    for (let i = 1; i < line.length; i++) {
      const a = landmarks[line[i - 1]], b = landmarks[line[i]];
      pen.globalAlpha = Math.min(a[5], b[5]) > SEEN ? 1 : 0.2; // what is hidden is only guessed
      pen.beginPath();
      pen.moveTo(a[0] * this.overlay.width, a[1] * this.overlay.height);
      pen.lineTo(b[0] * this.overlay.width, b[1] * this.overlay.height);
      pen.stroke();
    }
    pen.globalAlpha = 1;
  }

  get fps() {
    const now = performance.now();
    this.done = this.done.filter((at) => at > now - COUNTED_MS);
    return Math.round(1e4 * this.done.length / Math.min(COUNTED_MS, now - this.startedAt)) / 10;
  }

  // The present fault, in a sentence; "" if there is none.
  get trouble() {
    if (this.state === CAMERA.FAILED) return this.failure;
    if (this.state !== CAMERA.RUNNING) return "";
    const now = performance.now();
    if (now - this.pictureAt > STILL_MS || this.video.srcObject.getVideoTracks()[0].muted) return SENTENCES.still;
    if (now - this.startedAt > COUNTED_MS) this.isSlow = this.fps < (this.isSlow ? FAST_FPS : SLOW_FPS);
    if ((this.isSlow || this.wrong.key) && this.#brightness() < DARK) return SENTENCES.dark;
    if (this.isSlow) return SENTENCES.slow;
    return this.wrong.key && now - this.wrong.since > SENTENCE_AFTER_MS ? SENTENCES[this.wrong.key] : "";
  }

  get words() {
    const track = this.video.srcObject?.getVideoTracks()[0].getSettings();
    return track ? `${this.video.videoWidth}x${this.video.videoHeight} ${Math.round(track.frameRate || 0)}` : "";
  }

  // Mean of the picture, 0 to 255.
  #brightness() {
    this.probe.drawImage(this.video, 0, 0, 16, 12);
    const data = this.probe.getImageData(0, 0, 16, 12).data;
    let sum = 0;
    for (let i = 0; i < data.length; i++) if (i % 4 !== 3) sum += data[i];
    return sum / (0.75 * data.length);
  }
}
