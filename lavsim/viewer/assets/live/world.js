// The drive as far as this page knows it: the newest tick, the one before it, and where the ego has been.

import { Drive } from "../js/drive.js";

const TURN = (2 * Math.PI) / 65536;
const JUMP = 30; // ticks between two messages beyond which nothing is drawn in between
const ROOM = 256;

export class World extends Drive {
  constructor({ meta, arrays }) {
    const none = new Int32Array(0);
    const empty = {};
    for (const name of ["track.row", "track.start", "track.n", "pose.x", "pose.y", "pose.yaw", "pose.state", "lights.n", "lights.at", "lights.state"]) {
      empty[name] = none;
    }
    super({ meta: { ...meta, ticks: 0, first_tick: 1, actors: null, touches: [], infractions: [], hazards: [], drawings: [] },
      arrays: { ...empty, ...arrays } });
    this.lamps = new Uint8Array(meta.lights).fill(4);
    this.forget();
  }

  /** Another drive, or another past. */
  forget() {
    this.actors = { id: [], class: [], role: [], size: [], colour: [], blueprint: [] };
    this.row = [];
    this.tick = this.tickBefore = 0;
    this.share = 1; // of the way from the tick before to this one
    this.values = new Int32Array(0); // x, y, yaw, state of each row
    this.before = new Int32Array(0);
    this.isThere = new Uint8Array(0);
    this.wasThere = new Uint8Array(0);
    this.trail = [new Int32Array(ROOM), new Int32Array(ROOM)];
    this.trailEnd = 0;
    this.meta.touches = [];
    this.meta.infractions = [];
    this.events = [];
    for (const name of ["speed", "throttle", "steer", "brake"]) this.arrays[`ego.${name}`] = [];
  }

  /** Takes in a message of `lavsim.live.stream`; true if there are new actors. */
  take(told) {
    if (told.reset) {
      this.forget();
      this.begin = told.status.first * this.dt;
      this.firstTick = told.status.first;
      const [ticks, xs, ys] = told.reset;
      ticks.forEach((tick, k) => this.extendTrail(tick - this.firstTick, xs[k], ys[k]));
    }
    if (told.actors) this.addActors(told.actors);
    this.before.set(this.values);
    this.wasThere.set(this.isThere);
    this.tickBefore = this.tick;
    this.tick = told.tick;
    told.rows.forEach((row, k) => {
      this.values.set([told.x[k], told.y[k], told.yaw[k], told.state[k]], 4 * row);
      this.isThere[row] = 1;
    });
    for (const row of told.gone || []) this.isThere[row] = 0;
    if (told.lights) told.lights[0].forEach((light, k) => { this.lamps[light] = told.lights[1][k]; });
    this.takeEgo(told);
    for (const event of told.events || []) this.addEvent(event);
    return Boolean(told.actors);
  }

  takeEgo(told) {
    const at = told.tick - this.firstTick;
    if (at >= this.trailEnd) this.extendTrail(at, this.values[0], this.values[1]);
    const [speed, throttle, steer, brake, isReverse] = told.ego;
    Object.assign(this, { speed, isReverse });
    for (const [name, value] of Object.entries({ speed, throttle, steer, brake })) this.arrays[`ego.${name}`][at] = value;
  }

  addActors(actors) {
    const fields = Object.keys(this.actors);
    for (const actor of actors) {
      fields.forEach((field, k) => this.actors[field].push(actor[k]));
      this.row.push(this.row.length);
    }
    const size = this.row.length;
    this.values = grown(this.values, 4 * size);
    this.before = grown(this.before, 4 * size);
    this.isThere = grown(this.isThere, size);
    this.wasThere = grown(this.wasThere, size);
  }

  addEvent([tick, kind, text, x, y]) {
    this.events.push({ tick, kind, text });
    if (kind === "contact") this.meta.touches.push({ index: tick - this.firstTick, x, y });
    if (kind === "set") this.meta.infractions.push({ x, y });
  }

  /** Puts the ego's place of a tick on its trail; ticks that were skipped lie on the line to it. */
  extendTrail(at, x, y) {
    if (at >= this.trail[0].length) this.trail = this.trail.map((places) => grown(places, 2 * at + ROOM));
    const from = this.trailEnd;
    [x, y].forEach((value, axis) => {
      const places = this.trail[axis];
      const last = from > 0 ? places[from - 1] : value;
      for (let k = from; k <= at; k++) places[k] = last + ((value - last) * (k - from + 1)) / (at - from + 1);
    });
    this.trailEnd = at + 1;
  }

  get last() {
    return Math.max(this.tick - this.firstTick, 0);
  }

  /** The moment that is drawn: on the way from the tick before to this one. */
  get shownMoment() {
    return this.isNear ? this.tickBefore + this.share * (this.tick - this.tickBefore) - this.firstTick : this.last;
  }

  get isNear() {
    return this.tick > this.tickBefore && this.tick - this.tickBefore <= JUMP && this.tickBefore > 0;
  }

  turnTo() {
    const { now, values, before } = this;
    const share = this.isNear ? this.share : 1;
    if (now.x.length < this.row.length) {
      for (const name of ["track", "x", "y", "yaw", "state"]) now[name] = grown(now[name], this.row.length + ROOM);
    }
    let n = 0;
    for (let row = 0; row < this.row.length; row++) {
      if (!this.isThere[row]) continue;
      const from = this.wasThere[row] ? before : values;
      const at = 4 * row;
      const turn = ((((values[at + 2] - from[at + 2] + 32768) % 65536) + 65536) % 65536) - 32768;
      now.track[n] = row;
      now.x[n] = (from[at] + share * (values[at] - from[at])) / 1000;
      now.y[n] = (from[at + 1] + share * (values[at + 1] - from[at + 1])) / 1000;
      now.yaw[n] = (values[at + 2] - (1 - share) * turn) * TURN;
      now.state[n] = values[at + 3];
      n++;
    }
    now.count = n;
    return now;
  }

  body(row) {
    if (!this.isThere[row]) return null;
    const { values, before } = this;
    const at = 4 * row;
    const span = this.isNear && this.wasThere[row] ? (this.tick - this.tickBefore) * this.dt * 1000 : Infinity;
    const [length, width] = this.actors.size[row];
    return { x: values[at] / 1000, y: values[at + 1] / 1000, yaw: values[at + 2] * TURN, length, width,
      vx: (values[at] - before[at]) / span, vy: (values[at + 1] - before[at + 1]) / span,
      state: values[at + 3], row, id: this.actors.id[row] };
  }

  trackOf(row) {
    return this.isThere[row] ? row : -1;
  }

  lights() {
    return this.lamps;
  }
}

/** The same numbers with room for `size`. */
function grown(values, size) {
  const larger = new values.constructor(Math.max(size, values.length));
  larger.set(values);
  return larger;
}
