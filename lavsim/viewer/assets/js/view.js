// Where on the screen a place of the world is, and the hands that move it.

const NEAREST = 60; // [px/m]
const FARTHEST = 0.05;

export class View {
  constructor(canvas) {
    this.canvas = canvas;
    this.x = 0;
    this.y = 0;
    this.scale = 8; // CSS pixels per metre
    this.angle = 0; // turn of the world on the screen
    this.ahead = 0.5; // share of the height above the middle
    this.resize();
  }

  /** Takes on the size of its element; true if it changed. */
  resize() {
    const box = this.canvas.getBoundingClientRect();
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.max(Math.round(box.width * ratio), 1);
    const height = Math.max(Math.round(box.height * ratio), 1);
    const changed = width !== this.canvas.width || height !== this.canvas.height;
    if (changed) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    this.ratio = ratio;
    this.width = width / ratio;
    this.height = height / ratio;
    return changed;
  }

  /** [a, b, c, d, e, f] that takes world metres to CSS pixels. */
  matrix() {
    const c = Math.cos(this.angle) * this.scale;
    const s = Math.sin(this.angle) * this.scale;
    const e = this.width / 2 - (c * this.x - s * this.y);
    const f = this.height * this.ahead - (s * this.x + c * this.y);
    return [c, s, -s, c, e, f];
  }

  toScreen(x, y) {
    const [a, b, c, d, e, f] = this.matrix();
    return [a * x + c * y + e, b * x + d * y + f];
  }

  toWorld(px, py) {
    const dx = px - this.width / 2;
    const dy = py - this.height * this.ahead;
    const c = Math.cos(this.angle) / this.scale;
    const s = Math.sin(this.angle) / this.scale;
    return [this.x + c * dx + s * dy, this.y - s * dx + c * dy];
  }

  /** Zooms so that the place under a pixel stays there. */
  zoomAt(px, py, factor) {
    const [x, y] = this.toWorld(px, py);
    this.scale = Math.min(Math.max(this.scale * factor, FARTHEST), NEAREST);
    const [nx, ny] = this.toWorld(px, py);
    this.x += x - nx;
    this.y += y - ny;
  }

  pan(dx, dy) {
    const [x, y] = this.toWorld(this.width / 2 - dx, this.height * this.ahead - dy);
    this.x = x;
    this.y = y;
  }

  /** Shows a box of the world [m] whole, north up. */
  fit(x0, y0, x1, y1) {
    this.angle = 0;
    this.ahead = 0.5;
    this.x = (x0 + x1) / 2;
    this.y = (y0 + y1) / 2;
    const room = Math.min(this.width / Math.max(x1 - x0, 1), this.height / Math.max(y1 - y0, 1));
    this.scale = Math.min(Math.max(room * 0.9, FARTHEST), NEAREST);
  }
}

/** Drag, wheel and pinch on the view's canvas. `hand`: {moved(), zoomed(px, py, factor), clicked(px, py)}. */
export function handle(view, hand) {
  const canvas = view.canvas;
  const fingers = new Map();
  let travelled = 0;
  let spread = 0;
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, at(event));
    travelled = 0;
    spread = gap(fingers);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const now = at(event);
    fingers.set(event.pointerId, now);
    const dx = now[0] - before[0];
    const dy = now[1] - before[1];
    travelled += Math.abs(dx) + Math.abs(dy);
    if (fingers.size === 2) {
      const wide = gap(fingers);
      const [a, b] = [...fingers.values()];
      if (spread > 0 && wide > 0) hand.zoomed((a[0] + b[0]) / 2, (a[1] + b[1]) / 2, wide / spread);
      spread = wide;
    } else if (travelled > 4) {
      view.pan(dx, dy);
      hand.moved();
    }
  });
  const released = (event) => {
    if (fingers.delete(event.pointerId) && fingers.size === 0 && travelled <= 4 && event.type === "pointerup") hand.clicked(...at(event));
    spread = gap(fingers);
  };
  canvas.addEventListener("pointerup", released);
  canvas.addEventListener("pointercancel", released);
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    hand.zoomed(...at(event), Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)));
  }, { passive: false });
}

function gap(fingers) {
  if (fingers.size !== 2) return 0;
  const [a, b] = [...fingers.values()];
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}
