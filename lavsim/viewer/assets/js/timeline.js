// The strip below the map: speed, pedals and hazards over time, events as marks, and the hand that scrubs.

const TOP = 20; // px of the marks' row
const BOTTOM = 15; // px of the times' row
const PEDALS = 5;
const SIDE = 10;
const CROWD = 13; // px between marks of a kind
const REACH = 8; // px within which a mark is meant

export class Timeline {
  constructor(canvas, drive, events, hand) {
    Object.assign(this, { canvas, drive, events, hand });
    this.back = document.createElement("canvas");
    this.speed = drive.arrays["ego.speed"];
    this.top = Math.max(10, 3.6 * Math.max(...chunks(this.speed)) / 100) * 1.08;
    let isDown = false;
    canvas.addEventListener("pointerdown", (event) => {
      isDown = true;
      canvas.setPointerCapture(event.pointerId);
      const mark = this.markAt(event);
      hand.seek(mark ? mark.moment : this.momentAt(event));
    });
    canvas.addEventListener("pointermove", (event) => {
      if (isDown) hand.seek(this.momentAt(event));
      const mark = this.markAt(event);
      hand.tell(mark ? `${clock(drive.time(mark.moment))}  ${mark.text}` : null, this.offset(event)[0]);
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { isDown = false; });
    canvas.addEventListener("pointerleave", () => hand.tell(null, 0));
    canvas.setAttribute("aria-valuemax", String(drive.last));
  }

  offset(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  x(moment) {
    return SIDE + ((this.width - 2 * SIDE) * moment) / Math.max(this.drive.last, 1);
  }

  momentAt(event) {
    const share = (this.offset(event)[0] - SIDE) / Math.max(this.width - 2 * SIDE, 1);
    return Math.round(Math.min(Math.max(share, 0), 1) * this.drive.last);
  }

  /** The mark under the pointer, the nearest of several. */
  markAt(event) {
    const [x, y] = this.offset(event);
    if (y > TOP + 2) return null;
    let best = null;
    for (const mark of this.events) {
      const gap = Math.abs(this.x(mark.moment) - x);
      if (gap <= REACH && (!best || gap < Math.abs(this.x(best.moment) - x))) best = mark;
    }
    return best;
  }

  /** Draws what does not change; after a new size or theme. */
  prepare(palette) {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const box = this.canvas.getBoundingClientRect();
    this.width = box.width;
    this.height = box.height;
    this.ratio = ratio;
    this.palette = palette;
    for (const canvas of [this.canvas, this.back]) {
      canvas.width = Math.max(Math.round(box.width * ratio), 1);
      canvas.height = Math.max(Math.round(box.height * ratio), 1);
    }
    const context = this.back.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = palette.card;
    context.fillRect(0, 0, this.width, this.height);
    this.drawHazards(context);
    this.drawSpeed(context);
    this.drawPedals(context);
    this.drawTimes(context);
    this.drawMarks(context);
  }

  drawSpeed(context) {
    const { palette, speed, drive } = this;
    const low = this.height - BOTTOM - PEDALS;
    const y = (value) => low - ((low - TOP) * (value * 3.6)) / 100 / this.top;
    const columns = Math.max(Math.round(this.width - 2 * SIDE), 1);
    context.beginPath();
    context.moveTo(this.x(0), low);
    for (let k = 0; k <= columns; k++) {
      const i = Math.round((k / columns) * drive.last);
      context.lineTo(this.x(i), y(speed[i] || 0));
    }
    context.lineTo(this.x(drive.last), low);
    context.closePath();
    context.fillStyle = palette.chartBack;
    context.fill();
    context.strokeStyle = palette.chart;
    context.lineWidth = 1.2;
    context.stroke();
    context.fillStyle = palette.soft;
    context.font = "10px system-ui, sans-serif";
    context.textAlign = "left";
    context.fillText(`${Math.round(this.top)} km/h`, SIDE + 2, TOP + 9);
  }

  /** Throttle above nothing, brake in the marks' colour: a thin strip, the strongest of each column. */
  drawPedals(context) {
    const { throttle, brake } = { throttle: this.drive.arrays["ego.throttle"], brake: this.drive.arrays["ego.brake"] };
    const columns = Math.max(Math.round(this.width - 2 * SIDE), 1);
    const y = this.height - BOTTOM - PEDALS;
    for (let k = 0; k < columns; k++) {
      const from = Math.floor((k / columns) * this.drive.last);
      const to = Math.max(Math.floor(((k + 1) / columns) * this.drive.last), from + 1);
      let [gas, stop] = [0, 0];
      for (let i = from; i < to; i++) {
        gas = Math.max(gas, throttle[i] || 0);
        stop = Math.max(stop, brake[i] || 0);
      }
      context.globalAlpha = Math.min(1, 0.15 + Math.max(gas, stop) / 1000);
      context.fillStyle = stop > 20 ? this.palette.mark : gas > 20 ? this.palette.good : this.palette.grid;
      context.fillRect(SIDE + k, y, 1.2, PEDALS);
    }
    context.globalAlpha = 1;
  }

  drawHazards(context) {
    context.fillStyle = this.palette.scenario;
    context.globalAlpha = 0.18;
    for (const event of this.events) {
      if (event.kind !== "hazard") continue;
      const x = this.x(event.moment);
      context.fillRect(x, TOP, Math.max(this.x(event.end) - x, 2), this.height - TOP - BOTTOM);
    }
    context.globalAlpha = 1;
  }

  drawTimes(context) {
    const { drive, palette } = this;
    const seconds = drive.last * drive.dt;
    const step = [1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800].find((s) => (seconds / s) * 64 < this.width) || 3600;
    context.fillStyle = palette.soft;
    context.font = "10px system-ui, sans-serif";
    context.textAlign = "center";
    for (let t = Math.ceil(drive.begin / step) * step; t <= drive.time(drive.last); t += step) {
      const x = this.x(drive.moment(t));
      context.fillRect(x, this.height - BOTTOM, 1, 3);
      if (x > 20 && x < this.width - 20) context.fillText(clock(t, true), x, this.height - 3);
    }
  }

  drawMarks(context) {
    const { palette } = this;
    const last = {};
    for (const event of this.events) {
      const x = this.x(event.moment);
      if (x - (last[event.kind] ?? -99) < CROWD) continue; // the first of a crowd stands for it
      last[event.kind] = x;
      context.fillStyle = { infraction: palette.mark, hazard: palette.scenario, contact: palette.warn }[event.kind];
      context.beginPath();
      if (event.kind === "infraction") context.arc(x, 9, 7, 0, 2 * Math.PI);
      else context.rect(x - 4, 5, 8, 8);
      context.fill();
      context.strokeStyle = palette.card;
      context.lineWidth = 1.2;
      context.stroke();
      context.fillRect(x - 0.5, 16, 1, 4);
      if (event.kind !== "infraction") continue;
      context.fillStyle = palette.markText;
      context.font = `600 ${event.sign.length > 2 ? 7 : 9}px system-ui, sans-serif`;
      context.textAlign = "center";
      context.fillText(event.sign, x, 12.2);
    }
  }

  /** Draws the strip with the hand at `moment`. */
  draw(moment) {
    const context = this.canvas.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(this.back, 0, 0);
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    const x = this.x(moment);
    context.fillStyle = this.palette.text;
    context.fillRect(x - 1, 0, 2, this.height - BOTTOM);
    context.beginPath();
    context.arc(x, this.height - BOTTOM, 5, 0, 2 * Math.PI);
    context.fill();
  }
}

/** Largest values of pieces: `Math.max` takes only so many arguments. */
function chunks(values) {
  const found = [0];
  for (let i = 0; i < values.length; i += 4096) found.push(values.subarray(i, i + 4096).reduce((a, b) => Math.max(a, b), 0));
  return found;
}

/** "1:05.35", or "1:05" if `short`. */
export function clock(seconds, short = false) {
  const text = short ? String(Math.round(seconds % 60)) : (seconds % 60).toFixed(2);
  return `${Math.floor(seconds / 60)}:${text.padStart(short ? 2 : 5, "0")}`;
}
