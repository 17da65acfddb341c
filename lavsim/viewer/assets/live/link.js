// The socket to the simulation: commands go, scene and ticks come.

export class Link {
  /** `hand`: {told(message), lost(text)}. */
  constructor(hand) {
    const token = new URLSearchParams(window.location.hash.slice(1)).get("token") || "";
    this.hand = hand;
    this.socket = new WebSocket(`ws://${window.location.host}/live?token=${encodeURIComponent(token)}`);
    this.socket.addEventListener("message", (event) => hand.told(JSON.parse(event.data)));
    this.socket.addEventListener("close", () => hand.lost());
  }

  send(name, values = {}) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ do: name, ...values }));
  }
}
