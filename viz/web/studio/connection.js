// The line to the studio's server. A JSON text that names arrays is followed by one frame that holds them.
export class Wire {
  // ``hear`` gets every message; ``lost`` is told when the server has gone.
  constructor(address, hear, lost) {
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.onmessage = ({ data }) => {
      const message = typeof data === "string" ? JSON.parse(data) : this.filled(data);
      if (typeof data === "string" && message.binary) this.waiting = message; else hear(message);
    };
    this.socket.onclose = () => lost();
  }

  send(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  // Arrays, one after the other, at the places that the text before them names ("run.quantities.3.signals.0.values").
  filled(frame) {
    const { waiting } = this;
    let begin = 0;
    for (const { name, shape } of waiting.binary) {
      const places = name.split("."), last = places.pop(), count = shape.reduce((product, n) => product * n, 1);
      let at = waiting;
      for (const place of places) at = at[place] ??= {};
      at[last] = new Float32Array(frame, begin, count);
      begin += 4 * count;
    }
    return waiting;
  }
}
