// Finds people in the camera's pictures, in a thread of its own, so that the page stays alive while it works.
//
// In:  {base} once: the address of the page, below which the runtime lies. Then {picture, time}: an ImageBitmap, which is
//      closed here, and its time of capture, s.
// Out: {ready: true}, {failed: "why"}, or for every picture {time, landmarks: [[u, v, x, y, z, visibility] x 33] or [],
//      crowded: true if a second person is there, took_ms}; units as in the protocol.

import { crowded } from "./people.js";

const MODEL = "runtime/pose_landmarker_lite.task";
const LOOK_ROUND_S = 1; // looking for a second person in every picture would take half as long again

let performer = null; // follows one person from picture to picture
let several = null; // finds two in a single picture
let lastStamp = 0;
let lookedAt = -Infinity;
let isCrowded = false;

async function load(base) {
  const vision = await import(new URL("runtime/vision_bundle.mjs", base));
  // `true`: the runtime as a module, since a module worker has no importScripts.
  const files = await vision.FilesetResolver.forVisionTasks(new URL("runtime/wasm", base).href, true);
  const baseOptions = { modelAssetPath: new URL(MODEL, base).href, delegate: "CPU" };
  // The runtime forgets the factory after its first use, and a module is run only once.
  const factory = (await import(files.wasmLoaderPath)).default;
  const make = (options) => {
    self.ModuleFactory = factory;
    return vision.PoseLandmarker.createFromOptions(files, { baseOptions, ...options });
  };
  performer = await make({ runningMode: "VIDEO", numPoses: 1 });
  several = await make({ runningMode: "IMAGE", numPoses: 2 });
}

function round(value) {
  return Math.round(value * 1e4) / 1e4;
}

function people({ landmarks, worldLandmarks }) {
  return landmarks.map((image, person) => image.map((point, i) => {
    const place = worldLandmarks[person][i];
    return [point.x, point.y, place.x, place.y, place.z, place.visibility ?? point.visibility ?? 0].map(round);
  }));
}

function detect({ picture, time }) {
  const began = performance.now();
  // The tracker wants whole, rising milliseconds.
  lastStamp = Math.max(lastStamp + 1, Math.round(time * 1e3));
  try {
    const landmarks = people(performer.detectForVideo(picture, lastStamp))[0] || [];
    if (time - lookedAt > LOOK_ROUND_S) {
      lookedAt = time;
      isCrowded = crowded(people(several.detect(picture)));
    }
    postMessage({ time, landmarks, crowded: isCrowded, took_ms: performance.now() - began });
  } finally {
    picture.close();
  }
}

onmessage = async ({ data }) => {
  try {
    if (data.base) {
      await load(data.base);
      postMessage({ ready: true });
    } else {
      detect(data);
    }
  } catch (error) {
    postMessage({ failed: String(error?.message || error).slice(0, 200) });
  }
};
