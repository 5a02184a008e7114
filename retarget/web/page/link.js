// The WebSocket to the server of the run: says hello, hears, and begins again by itself when it is lost.
// It never repeats an order to move: after a new hello the page starts from what the server says.

const AGAIN_MS = [500, 10000]; // from a loss to the next try: at first, and at most (each time twice as long)
const SILENCE_MS = 3000; // without any message (pings are answered) the socket counts as lost
const PING_MS = 250;
const PINGS = 4; // a second of them
const WAITING_BYTES = 32768; // with so much unsent, poses are left out: late poses are worse than none

export const LINK = Object.freeze({ CLOSED: "closed", OPENING: "opening", OPEN: "open", LOST: "lost", REFUSED: "refused" });

export function median(values) {
  return values.length ? [...values].sort((a, b) => a - b)[values.length >> 1] : null;
}

// A random text that stays with this tab, so that a page that comes back is known as the same performer.
function identity() {
  const make = () => Array.from(crypto.getRandomValues(new Uint8Array(12)), (byte) => byte.toString(16).padStart(2, "0")).join("");
  try {
    const kept = sessionStorage.getItem("id") || make();
    sessionStorage.setItem("id", kept);
    return kept;
  } catch {
    return make(); // storage may be forbidden
  }
}

// A message: JSON, alone or with the numbers of its `tracks` behind it, see `packed_state` of the server.
function read(data) {
  if (typeof data === "string") return JSON.parse(data);
  const size = new DataView(data).getUint32(0, true), message = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, size)));
  let at = 4 + size;
  for (const [name, count] of Object.entries(message.tracks)) {
    message.tracks[name] = new Float32Array(data, at, count);
    at += 4 * count;
  }
  return message;
}

export class Link {
  // hear(message): of the server. changed(state, why): of the link, one of LINK.
  constructor(hear, changed) {
    this.hear = hear;
    this.changed = changed;
    this.state = LINK.CLOSED;
    this.id = identity();
    this.input = "watch";
    this.again = AGAIN_MS[0];
    this.socket = null;
    this.heard = 0;
    this.stopOwed = false;
    this.rounds = []; // ms, there and back, of the newest pings
    setInterval(() => this.#beat(), PING_MS);
  }

  // Join as `input` ("camera", "headset" or "watch"); a former link is closed.
  open(input) {
    this.input = input;
    this.#drop();
    this.#enter(LINK.OPENING);
    const address = new URL("ws", document.baseURI);
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.heard = performance.now();
    socket.onopen = () => this.#opened(socket);
    socket.onmessage = (event) => socket === this.socket && this.#received(event.data);
    socket.onclose = (event) => socket === this.socket && this.#closed(event.reason);
  }

  // Time there and back, ms; null where none is known.
  get round_ms() {
    return median(this.rounds);
  }

  say(message) {
    if (this.state !== LINK.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  // A frame of poses; left out while the network is behind.
  frame(message) {
    return this.state === LINK.OPEN && this.socket.bufferedAmount < WAITING_BYTES && this.say(message);
  }

  // A stop is never lost: without a link it is said first of all when there is one again.
  stop() {
    this.stopOwed = true;
    this.stopAt = performance.now();
    this.#sayStop();
  }

  // Again and again, until the server says that it has heard it.
  #sayStop() {
    if (this.stopOwed && this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ say: "stop" }));
  }

  // The run is over: nobody answers at this address any more.
  end() {
    this.#drop();
    this.#enter(LINK.CLOSED);
  }

  #opened(socket) {
    if (socket !== this.socket) return;
    socket.send(JSON.stringify({ say: "hello", input: this.input, id: this.id }));
    this.#sayStop();
  }

  #received(data) {
    this.heard = performance.now();
    const message = read(data);
    if (message.hear === "pong") {
      this.rounds = [...this.rounds.slice(1 - PINGS), performance.now() - message.t];
    } else if (message.hear === "stop") {
      this.stopOwed = false;
      this.hear(message);
    } else if (message.hear === "refused") {
      this.#drop();
      this.#enter(LINK.REFUSED, message.why);
    } else {
      if (message.hear === "welcome") this.#welcomed();
      this.hear(message);
    }
  }

  #closed(reason) {
    this.#drop();
    this.#enter(LINK.LOST, reason);
    setTimeout(() => this.state === LINK.LOST && this.open(this.input), this.again);
    this.again = Math.min(2 * this.again, AGAIN_MS[1]);
  }

  #welcomed() {
    this.again = AGAIN_MS[0];
    this.#enter(LINK.OPEN);
  }

  #beat() {
    if (this.socket && performance.now() - this.heard > SILENCE_MS) this.#closed("the server is silent");
    else this.say({ say: "ping", t: performance.now() });
    if (performance.now() - this.stopAt > PING_MS) this.#sayStop();
  }

  #drop() {
    const socket = this.socket;
    this.socket = null;
    this.rounds = [];
    if (socket) socket.close();
  }

  #enter(state, why = "") {
    if (state === this.state && !why) return;
    this.state = state;
    this.changed(state, why);
  }
}
