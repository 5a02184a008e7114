// The WebSocket to the server of the run. It reconnects by itself when it is lost.
// It never repeats a command to move: after a new hello the page starts from the messages of the server.

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
  // receive(message): of the server. changed(state, why): of the link, one of LINK.
  constructor(receive, changed) {
    this.receive = receive;
    this.changed = changed;
    this.state = LINK.CLOSED;
    this.id = identity();
    this.input = "watch";
    this.again = AGAIN_MS[0];
    this.socket = null;
    this.receivedAt = 0;
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
    this.receivedAt = performance.now();
    socket.onopen = () => this.#opened(socket);
    socket.onmessage = (event) => socket === this.socket && this.#received(event.data);
    socket.onclose = (event) => socket === this.socket && this.#closed(event.reason);
  }

  // Time there and back, ms; null where none is known.
  get round_ms() {
    return median(this.rounds);
  }

  send(message) {
    if (this.state !== LINK.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  // A frame of poses; left out while the network is behind.
  frame(message) {
    return this.state === LINK.OPEN && this.socket.bufferedAmount < WAITING_BYTES && this.send(message);
  }

  // A stop is never lost: without a link it is the first message of the next one.
  stop() {
    this.stopOwed = true;
    this.stopAt = performance.now();
    this.#sendStop();
  }

  // Repeated until the server confirms it.
  #sendStop() {
    if (this.stopOwed && this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ type: "stop" }));
  }

  // The run is over: no server answers at this address any more.
  end() {
    this.#drop();
    this.#enter(LINK.CLOSED);
  }

  #opened(socket) {
    if (socket !== this.socket) return;
    socket.send(JSON.stringify({ type: "hello", input: this.input, id: this.id }));
    this.#sendStop();
  }

  #received(data) {
    this.receivedAt = performance.now();
    const message = read(data);
    if (message.type === "pong") {
      this.rounds = [...this.rounds.slice(1 - PINGS), performance.now() - message.t];
    } else if (message.type === "stop") {
      this.stopOwed = false;
      this.receive(message);
    } else if (message.type === "refused") {
      this.#drop();
      this.#enter(LINK.REFUSED, message.why);
    } else {
      if (message.type === "welcome") this.#welcomed();
      this.receive(message);
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
    if (this.socket && performance.now() - this.receivedAt > SILENCE_MS) this.#closed("the server is silent");
    else this.send({ type: "ping", t: performance.now() });
    if (performance.now() - this.stopAt > PING_MS) this.#sendStop();
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
