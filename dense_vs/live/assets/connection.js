// The web socket: images in, messages out, a sign of life several times a second, and a new try when it breaks.

const ALIVE_MS = 150;
const RETRY_MS = 1000;

export class Connection {
  constructor(onState, onImage, onBreak) {
    this.onState = onState;
    this.onImage = onImage;
    this.onBreak = onBreak;
    this.held = false;
    this.stopWaits = null; // a stop that was asked for while no socket was open
    this.drawing = Promise.resolve();
    this.open();
    setInterval(() => this.alive(), ALIVE_MS);
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/socket`);
    this.socket.binaryType = "arraybuffer";
    this.sent = 0;
    this.socket.onopen = () => {
      if (this.stopWaits) this.send(this.stopWaits);
      this.stopWaits = null;
    };
    this.socket.onmessage = (event) => this.take(event.data);
    this.socket.onclose = () => {
      this.onBreak();
      setTimeout(() => this.open(), RETRY_MS);
    };
  }

  // The number of messages sent through this socket; the state's `heard` reaches it once the last one was heard.
  send(message) {
    if (this.socket.readyState === WebSocket.OPEN) {
      this.socket.send(JSON.stringify(message));
      this.sent++;
    } else if (message.do === "stop") {
      this.stopWaits = message; // another page may be moving the robot
    }
    return this.sent;
  }

  // A hidden page says nothing: its timers are slowed down, and nobody looks at the robot through it.
  alive() {
    if (!document.hidden) this.send({ do: "alive", held: this.held });
  }

  hold(held) {
    this.held = held;
    this.alive();
  }

  take(data) {
    const length = new DataView(data).getUint32(0, true);
    const state = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    const image = data.byteLength > 4 + length ? new Uint8Array(data, 4 + length) : null;
    this.onState(state);
    if (image) this.drawing = this.drawing.then(() => this.draw(image, state));
  }

  async draw(image, state) {
    try {
      const bitmap = await createImageBitmap(new Blob([image], { type: "image/jpeg" }));
      this.onImage(bitmap, state);
      bitmap.close();
    } finally {
      this.send({ do: "shown" });
    }
  }
}
