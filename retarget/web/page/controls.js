// The controls of a page: the dead man (a key, a finger, the grip of a headset), the stick, and the keys that stop.

const EVERY_MS = 100; // the server takes 0.3 s of silence for a release

export class DeadMan {
  // send(message): to the server. changed(held): for the page.
  constructor(send, changed) {
    this.send = send;
    this.changed = changed;
    this.used = false;
    this.holders = new Set(); // "key", "finger", "grip"
    this.sentAt = 0;
    setInterval(() => this.tick(), EVERY_MS);
  }

  get held() {
    return this.holders.size > 0;
  }

  // From now on the robot moves only while something holds.
  use() {
    this.used = true;
    this.tick(true);
  }

  press(holder, held) {
    if (held === this.holders.has(holder)) return;
    if (held) this.holders.add(holder);
    else this.holders.delete(holder);
    this.tick(true);
    this.changed(this.held);
  }

  release() {
    for (const holder of [...this.holders]) this.press(holder, false);
  }

  // Sends the state every 0.1 s. The frames of a headset call this too, since its browser may slow the timers of the page.
  tick(changed = false) {
    const now = performance.now();
    if (!this.used || (!changed && now - this.sentAt < EVERY_MS - 10)) return;
    this.sentAt = now;
    this.send({ type: "held", held: this.held });
  }
}

// Wires key H and the pad to a dead man. Whatever takes the key or the finger away from the page lets go.
export function listenForHolding(deadMan, pad) {
  const isKey = (event) => event.code === "KeyH" && !event.ctrlKey && !event.metaKey && !event.altKey;
  addEventListener("keydown", (event) => isKey(event) && !event.repeat && deadMan.used && deadMan.press("key", true));
  addEventListener("keyup", (event) => event.code === "KeyH" && deadMan.press("key", false));
  addEventListener("blur", () => deadMan.release());
  addEventListener("pagehide", () => deadMan.release());
  pad.addEventListener("pointerdown", (event) => {
    pad.setPointerCapture(event.pointerId);
    deadMan.press("finger", true);
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
    pad.addEventListener(end, () => deadMan.press("finger", false));
  }
  pad.addEventListener("contextmenu", (event) => event.preventDefault());
}

const within = (share) => Math.max(-1, Math.min(1, share));

// Pads by which a robot walks: up and down is forward and back, across is `data-across` of the pad. It counts while a finger is
// on one, and whatever takes the finger away from the page lets go.
export class Stick {
  // send(message): to the server.
  constructor(send, pads) {
    this.send = send;
    this.fingers = new Map(); // from pad to where its finger is, -1 to 1
    for (const pad of pads) this.listen(pad);
    for (const event of ["blur", "pagehide"]) addEventListener(event, () => this.letGo());
    setInterval(() => this.fingers.size && this.tick(), EVERY_MS);
  }

  listen(pad) {
    const move = (event) => {
      const box = pad.getBoundingClientRect();
      const across = within(1 - (2 * (event.clientX - box.left)) / box.width), forward = within(1 - (2 * (event.clientY - box.top)) / box.height);
      this.fingers.set(pad, { forward, [pad.dataset.across]: across });
      pad.classList.add("held");
    };
    pad.addEventListener("pointerdown", (event) => {
      pad.setPointerCapture(event.pointerId);
      move(event);
      this.tick();
    });
    pad.addEventListener("pointermove", (event) => this.fingers.has(pad) && move(event));
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) pad.addEventListener(end, () => this.release(pad));
    pad.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  letGo() {
    for (const pad of [...this.fingers.keys()]) this.release(pad);
  }

  release(pad) {
    pad.classList.remove("held");
    if (this.fingers.delete(pad)) this.tick();
  }

  tick() {
    const requested = { forward: 0, left: 0, turn: 0 };
    for (const finger of this.fingers.values()) for (const [name, share] of Object.entries(finger)) requested[name] = within(requested[name] + share);
    this.send({ type: "stick", ...requested });
  }
}

// Space and Escape stop, before any button with the focus gets them.
export function listenForStop(stop) {
  addEventListener("keydown", (event) => {
    if (event.code !== "Space" && event.code !== "Escape") return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) stop();
  }, { capture: true });
  addEventListener("keyup", (event) => event.code === "Space" && event.preventDefault(), { capture: true });
}
