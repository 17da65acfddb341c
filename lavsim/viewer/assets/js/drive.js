// A drive as numbers: who is where at a moment, what the ego does, and when things happen.

export const CLASSES = ["car", "van", "truck", "bus", "motorcycle", "bicycle", "walker", "prop"];
export const ROLES = ["ego", "traffic", "scenario", "parked", "prop"];
const TURN = (2 * Math.PI) / 65536;

/** Lengths of groups as the index of each group's first member, with the end behind the last. */
export function starts(lengths) {
  const first = new Int32Array(lengths.length + 1);
  for (let i = 0; i < lengths.length; i++) first[i + 1] = first[i] + lengths[i];
  return first;
}

/** Time until two boxes touch if both keep their velocities and headings [s]; Infinity if they never do. */
export function timeToContact(a, b) {
  let enter = 0;
  let leave = Infinity;
  const dx = b.x - a.x;
  const dy = b.y - a.y;
  const vx = b.vx - a.vx;
  const vy = b.vy - a.vy;
  for (const yaw of [a.yaw, a.yaw + Math.PI / 2, b.yaw, b.yaw + Math.PI / 2]) {
    const ax = Math.cos(yaw);
    const ay = Math.sin(yaw);
    const reach = extent(a, ax, ay) + extent(b, ax, ay);
    const gap = dx * ax + dy * ay;
    const speed = vx * ax + vy * ay;
    if (Math.abs(speed) < 1e-9) {
      if (Math.abs(gap) > reach) return Infinity;
      continue;
    }
    const t0 = (-reach - gap) / speed;
    const t1 = (reach - gap) / speed;
    enter = Math.max(enter, Math.min(t0, t1));
    leave = Math.min(leave, Math.max(t0, t1));
    if (enter > leave) return Infinity;
  }
  return enter;
}

function extent(box, ax, ay) {
  const c = Math.cos(box.yaw);
  const s = Math.sin(box.yaw);
  return (box.length / 2) * Math.abs(c * ax + s * ay) + (box.width / 2) * Math.abs(-s * ax + c * ay);
}

export class Drive {
  constructor({ meta, arrays }) {
    this.meta = meta;
    this.arrays = arrays;
    this.ticks = meta.ticks;
    this.dt = meta.dt;
    this.begin = meta.first_tick * meta.dt;
    this.row = arrays["track.row"];
    this.from = arrays["track.start"];
    this.first = starts(arrays["track.n"]);
    this.x = arrays["pose.x"];
    this.y = arrays["pose.y"];
    this.yaw = arrays["pose.yaw"];
    this.state = arrays["pose.state"];
    this.actors = meta.actors;
    const tracks = this.row.length;
    this.now = { count: 0, track: new Int32Array(tracks), x: new Float64Array(tracks), y: new Float64Array(tracks),
      yaw: new Float64Array(tracks), state: new Int32Array(tracks) };
    this.lightRuns = runs(arrays["lights.n"], arrays["lights.at"], arrays["lights.state"]);
  }

  /** Last moment, counted in ticks from the first. */
  get last() {
    return Math.max(this.ticks - 1, 0);
  }

  /** Simulation time of a moment [s]. */
  time(moment) {
    return this.begin + moment * this.dt;
  }

  /** The moment of a simulation time, within the drive. */
  moment(time) {
    return Math.min(Math.max((time - this.begin) / this.dt, 0), this.last);
  }

  /** Fills `now` with everybody present at `moment`; between ticks on the line from one to the next. */
  turnTo(moment) {
    const now = this.now;
    const whole = Math.floor(moment);
    const share = moment - whole;
    let n = 0;
    for (let s = 0; s < this.row.length; s++) {
      const ahead = whole - this.from[s];
      if (ahead < 0) continue;
      const at = this.first[s] + ahead;
      if (at >= this.first[s + 1]) continue;
      const then = share > 0 && at + 1 < this.first[s + 1] ? at + 1 : at;
      now.track[n] = s;
      now.x[n] = (this.x[at] + share * (this.x[then] - this.x[at])) / 1000;
      now.y[n] = (this.y[at] + share * (this.y[then] - this.y[at])) / 1000;
      now.yaw[n] = (this.yaw[at] + share * (this.yaw[then] - this.yaw[at])) * TURN;
      now.state[n] = this.state[at];
      n++;
    }
    now.count = n;
    return now;
  }

  /** Pose, velocity and box of a track at a moment; null while it is absent. */
  body(track, moment) {
    const whole = Math.round(moment);
    const at = this.first[track] + whole - this.from[track];
    if (whole < this.from[track] || at >= this.first[track + 1]) return null;
    const before = Math.max(at - 1, this.first[track]);
    const after = Math.min(at + 1, this.first[track + 1] - 1);
    const span = Math.max(after - before, 1) * this.dt * 1000;
    const row = this.row[track];
    const [length, width] = this.actors.size[row];
    return { x: this.x[at] / 1000, y: this.y[at] / 1000, yaw: this.yaw[at] * TURN, length, width,
      vx: (this.x[after] - this.x[before]) / span, vy: (this.y[after] - this.y[before]) / span,
      state: this.state[at], row, id: this.actors.id[row] };
  }

  /** Track of an actor's row that is there at a moment, or -1. */
  trackOf(row, moment) {
    const whole = Math.round(moment);
    for (let s = 0; s < this.row.length; s++) {
      if (this.row[s] === row && whole >= this.from[s] && whole - this.from[s] < this.first[s + 1] - this.first[s]) return s;
    }
    return -1;
  }

  /** State of each light at a moment. */
  lights(moment) {
    return this.lightRuns.map((run) => valueAt(run, Math.round(moment)));
  }

  /** What an actor is called: its class and id; 0 is what stands still. */
  nameOf(id) {
    const row = this.actors.id.indexOf(id);
    return row < 0 ? "the static world" : `${CLASSES[this.actors.class[row]]} ${id}`;
  }

  /** The next contact of the ego if everybody goes on as now: {time, id}. */
  nearestContact(moment) {
    const ego = this.body(0, moment);
    let best = { time: Infinity, id: -1 };
    if (!ego) return best;
    for (let s = 1; s < this.row.length; s++) {
      const other = this.body(s, moment);
      if (!other || Math.hypot(other.x - ego.x, other.y - ego.y) > 100) continue;
      const time = timeToContact(ego, other);
      if (time < best.time) best = { time, id: other.id };
    }
    return best;
  }
}

function runs(lengths, at, values) {
  const first = starts(lengths);
  return Array.from(lengths, (_, k) => ({ at: at.subarray(first[k], first[k + 1]), value: values.subarray(first[k], first[k + 1]) }));
}

/** Index of the last entry of a rising array that is not above `key`; -1 if there is none. */
export function lastBefore(array, key) {
  let low = 0;
  let high = array.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (array[middle] <= key) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

function valueAt(run, moment) {
  const k = lastBefore(run.at, moment);
  return k < 0 ? 4 : run.value[k];
}
