// What moves: actors with their lamps, traffic lights, the route, events on the map.

import { CLASSES, lastBefore } from "./drive.js";

const LIGHT_COLOURS = ["#e5352b", "#f2b632", "#2fae4d", "#8a8f98", "#8a8f98"];
const BRAKE = 8;
const RIGHT_BLINKER = 16;
const LEFT_BLINKER = 32;
const REVERSE = 64;
const SPECIAL = 512;
const WALKER = 6;
const PROP = 7;
const CROWD = 22; // px between pins
const FLASH = 30; // ticks that a contact stays marked

export class Scene {
  constructor(drive) {
    this.drive = drive;
    this.drawn = []; // what the last frame showed: {id, x, y, yaw} in CSS pixels
    const { arrays } = drive;
    this.route = line(arrays["route.x"], arrays["route.y"], 100);
    this.trail = [drive.x.subarray(0, drive.ticks), drive.y.subarray(0, drive.ticks)];
    this.stops = arrays["stop.at"];
    this.heads = arrays["light.at"];
    this.signs = arrays["sign.at"];
  }

  /** Draws a frame over the tiles. `show`: the layers that are on. */
  draw(context, view, moment, show, palette, selected) {
    this.world(context, view);
    if (show.route) this.drawRoute(context, view, palette);
    if (show.trail) this.drawTrail(context, view, moment, palette);
    if (show.lights) this.drawLights(context, view, moment);
    this.drawActors(context, view, moment, show, palette, selected);
    this.drawTouches(context, view, moment, palette);
    if (show.infractions) this.drawInfractions(context, view, palette);
  }

  world(context, view) {
    const [a, b, c, d, e, f] = view.matrix();
    const r = view.ratio;
    context.setTransform(a * r, b * r, c * r, d * r, e * r, f * r);
  }

  drawRoute(context, view, palette) {
    context.strokeStyle = palette.route;
    context.globalAlpha = 0.28;
    context.lineWidth = Math.max(1.1, 2.5 / view.scale);
    context.lineJoin = context.lineCap = "round";
    context.stroke(this.route);
    context.globalAlpha = 1;
    const { start, target } = this.drive.meta;
    for (const [place, colour] of [[start, palette.route], [target, palette.good]]) {
      if (!place) continue;
      context.beginPath();
      context.arc(place[0], place[1], Math.max(1.4, 6 / view.scale), 0, 2 * Math.PI);
      context.lineWidth = Math.max(0.5, 2.5 / view.scale);
      context.strokeStyle = colour;
      context.stroke();
    }
  }

  drawTrail(context, view, moment, palette) {
    const [x, y] = this.trail;
    const end = Math.floor(moment);
    const step = view.scale > 4 ? 2 : 8;
    context.beginPath();
    for (let i = 0; i < end; i += step) context.lineTo(x[i] / 1000, y[i] / 1000);
    if (end >= 0 && end < x.length) context.lineTo(x[end] / 1000, y[end] / 1000);
    context.strokeStyle = palette.trail;
    context.lineWidth = Math.max(0.25, 1.2 / view.scale);
    context.lineJoin = "round";
    context.stroke();
  }

  drawLights(context, view, moment) {
    const states = this.drive.lights(moment);
    const { "stop.light": owner } = this.drive.arrays;
    context.lineCap = "butt";
    context.lineWidth = Math.max(0.45, 2 / view.scale);
    for (let k = 0; k < owner.length; k++) {
      const x = this.stops[4 * k] / 100;
      const y = this.stops[4 * k + 1] / 100;
      const yaw = this.stops[4 * k + 2] / 1e4;
      const half = this.stops[4 * k + 3] / 200;
      context.beginPath();
      context.moveTo(x + Math.sin(yaw) * half, y - Math.cos(yaw) * half);
      context.lineTo(x - Math.sin(yaw) * half, y + Math.cos(yaw) * half);
      context.strokeStyle = LIGHT_COLOURS[states[owner[k]]] || LIGHT_COLOURS[4];
      context.stroke();
    }
    if (view.scale < 1.5) return;
    for (let k = 0; k < states.length; k++) {
      context.beginPath();
      context.arc(this.heads[2 * k] / 100, this.heads[2 * k + 1] / 100, 0.55, 0, 2 * Math.PI);
      context.fillStyle = LIGHT_COLOURS[states[k]] || LIGHT_COLOURS[4];
      context.fill();
      context.lineWidth = 0.15;
      context.strokeStyle = "#20242b";
      context.stroke();
    }
    const { "sign.kind": kinds } = this.drive.arrays;
    for (let k = 0; k < kinds.length; k++) drawSign(context, this.signs[2 * k] / 100, this.signs[2 * k + 1] / 100, kinds[k]);
  }

  drawActors(context, view, moment, show, palette, selected) {
    const { drive } = this;
    const now = drive.turnTo(moment);
    const blink = (drive.time(moment) * 1.5) % 1 < 0.55;
    const [a, b, c, d, e, f] = view.matrix();
    const reach = 14 * view.scale + 20;
    this.drawn = [];
    for (let i = now.count - 1; i >= 0; i--) {
      const px = a * now.x[i] + c * now.y[i] + e;
      const py = b * now.x[i] + d * now.y[i] + f;
      if (px < -reach || py < -reach || px > view.width + reach || py > view.height + reach) continue;
      const row = drive.row[now.track[i]];
      const yaw = now.yaw[i] + view.angle;
      this.drawn.push({ id: drive.actors.id[row], x: px, y: py, yaw });
      const scale = view.scale * view.ratio;
      context.setTransform(Math.cos(yaw) * scale, Math.sin(yaw) * scale, -Math.sin(yaw) * scale, Math.cos(yaw) * scale,
        px * view.ratio, py * view.ratio);
      this.drawActor(context, view, row, now.state[i], blink, show, palette, row === selected);
    }
    context.setTransform(view.ratio, 0, 0, view.ratio, 0, 0);
    if (show.labels) this.drawLabels(context, palette);
  }

  drawActor(context, view, row, state, blink, show, palette, isSelected) {
    const { actors } = this.drive;
    const kind = actors.class[row];
    const role = actors.role[row];
    const fill = colourOf(actors, row, show, palette);
    const pixel = 1 / view.scale;
    const grow = Math.max(1, (kind === WALKER ? 5 : 7) * pixel / actors.size[row][0]);
    const length = actors.size[row][0] * Math.min(grow, 8);
    const width = actors.size[row][1] * Math.min(grow, 8);
    context.lineWidth = Math.max(0.12, pixel);
    context.strokeStyle = role === 2 ? palette.scenario : palette.ink;
    if (role === 2) context.lineWidth = Math.max(kind === WALKER ? 0.12 : 0.3, 2 * pixel);
    context.globalAlpha = role === 3 ? 0.6 : 1;
    context.fillStyle = fill;
    if (kind === WALKER) drawWalker(context, Math.max(length, width) / 2, pixel);
    else if (kind === PROP || view.scale < 3) {
      context.fillRect(-length / 2, -width / 2, length, width);
      context.strokeRect(-length / 2, -width / 2, length, width);
    } else drawVehicle(context, length, width, kind, state, blink, palette);
    context.globalAlpha = 1;
    if (!isSelected) return;
    context.beginPath();
    context.arc(0, 0, Math.hypot(length, width) / 2 + 5 * pixel, 0, 2 * Math.PI);
    context.strokeStyle = palette.accent;
    context.lineWidth = 2 * pixel;
    context.stroke();
  }

  drawLabels(context, palette) {
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "center";
    context.lineWidth = 3;
    context.strokeStyle = palette.halo;
    context.fillStyle = palette.text;
    for (const { id, x, y } of this.drawn) {
      context.strokeText(String(id), x, y - 9);
      context.fillText(String(id), x, y - 9);
    }
  }

  drawTouches(context, view, moment, palette) {
    context.setTransform(view.ratio, 0, 0, view.ratio, 0, 0);
    for (const touch of this.drive.meta.touches) {
      const age = moment - touch.index;
      if (age < 0 || age > FLASH) continue;
      const [x, y] = view.toScreen(touch.x, touch.y);
      context.beginPath();
      context.arc(x, y, 8 + age / 2, 0, 2 * Math.PI);
      context.globalAlpha = 1 - age / FLASH;
      context.lineWidth = 3;
      context.strokeStyle = palette.mark;
      context.stroke();
      context.globalAlpha = 1;
    }
  }

  drawInfractions(context, view, palette) {
    context.setTransform(view.ratio, 0, 0, view.ratio, 0, 0);
    context.textAlign = "center";
    context.font = "600 11px system-ui, sans-serif";
    const { infractions } = this.drive.meta;
    const taken = [];
    for (let k = 0; k < infractions.length; k++) {
      const [x, y] = view.toScreen(infractions[k].x, infractions[k].y);
      if (x < -20 || y < -20 || x > view.width + 20 || y > view.height + 40) continue;
      if (taken.some(([px, py]) => Math.hypot(px - x, py - y) < CROWD)) continue; // the first of a crowd stands for it
      taken.push([x, y]);
      context.beginPath();
      context.moveTo(x, y);
      context.arc(x, y - 17, 10, 0.85 * Math.PI, 0.15 * Math.PI);
      context.closePath();
      context.fillStyle = palette.mark;
      context.fill();
      context.lineWidth = 1.5;
      context.strokeStyle = palette.halo;
      context.stroke();
      context.fillStyle = palette.markText;
      context.fillText(String(k + 1), x, y - 13);
    }
  }
}

/** Fill of an actor: by class, or its own paint. */
export function colourOf(actors, row, show, palette) {
  if (actors.role[row] === 0) return palette.ego;
  if (show.paint) return `rgb(${actors.colour[row].join(",")})`;
  return palette[CLASSES[actors.class[row]]];
}

/** Infractions, hazards and contacts of the ego in the order of time. */
export function eventsOf(drive) {
  const { infractions, hazards, touches } = drive.meta;
  const events = infractions.map((entry, k) => ({ kind: "infraction", sign: String(k + 1), moment: drive.moment(entry.tick * drive.dt),
    text: entry.name, more: entry.message }));
  for (const hazard of hazards) events.push({ kind: "hazard", sign: "H", moment: hazard.first, end: hazard.last, text: hazard.type, more: "hazard begins" });
  for (const touch of touches) {
    if (touch.a !== 1 && touch.b !== 1) continue;
    const other = touch.a === 1 ? touch.b : touch.a;
    events.push({ kind: "contact", sign: "!", moment: touch.index, text: `Contact with ${drive.nameOf(other)}`,
      more: `${Math.round(touch.impulse)} N s` });
  }
  return events.sort((p, q) => p.moment - q.moment);
}

/** Number of the event that a moment belongs to: the last one begun, -1 before the first. */
export function eventAt(events, moment) {
  return lastBefore(events.map((event) => event.moment), moment + 1e-6);
}

function line(xs, ys, unit) {
  const path = new Path2D();
  for (let i = 0; i < xs.length; i++) path.lineTo(xs[i] / unit, ys[i] / unit);
  return path;
}

function drawWalker(context, radius, pixel) {
  context.beginPath();
  context.arc(0, 0, Math.max(radius, 2.5 * pixel), 0, 2 * Math.PI);
  context.fill();
  context.stroke();
  context.beginPath();
  context.moveTo(0, 0);
  context.lineTo(Math.max(radius, 2.5 * pixel) * 1.6, 0);
  context.stroke();
}

function drawVehicle(context, length, width, kind, state, blink, palette) {
  const [front, side] = [length / 2, width / 2];
  const corner = Math.min(0.45, width * 0.25);
  context.beginPath();
  context.roundRect(-front, -side, length, width, [corner * 0.6, corner, corner, corner * 0.6]);
  context.fill();
  context.stroke();
  if (kind === 4 || kind === 5) {
    context.beginPath();
    context.arc(-0.1, 0, Math.min(0.32, side * 0.8), 0, 2 * Math.PI);
    context.fillStyle = palette.ink;
    context.fill();
  } else {
    context.fillStyle = "rgba(12, 16, 22, 0.62)";
    const glass = kind === 3 || kind === 2 ? front - 0.9 : front * 0.42;
    context.fillRect(glass, -side * 0.82, Math.min(0.75, length * 0.16), width * 0.82);
    if (kind < 2) context.fillRect(-front * 0.78, -side * 0.76, length * 0.09, width * 0.76);
  }
  lamps(context, front, side, state, blink);
  doors(context, length, side, state >> 12, palette);
}

function lamps(context, front, side, state, blink) {
  const wide = side * 0.5;
  if (state & BRAKE) {
    context.fillStyle = "#ff2d20";
    context.fillRect(-front - 0.12, -side * 0.95, 0.42, wide);
    context.fillRect(-front - 0.12, side * 0.95 - wide, 0.42, wide);
  }
  if (state & REVERSE) {
    context.fillStyle = "#ffffff";
    context.fillRect(-front - 0.12, -side * 0.25, 0.3, side * 0.5);
  }
  if (blink && state & (LEFT_BLINKER | RIGHT_BLINKER)) {
    context.fillStyle = "#ffa41b";
    for (const [bit, sign] of [[LEFT_BLINKER, -1], [RIGHT_BLINKER, 1]]) {
      if (!(state & bit)) continue;
      const at = sign < 0 ? -side - 0.1 : side * 0.5;
      context.fillRect(front - 0.55, at, 0.6, side * 0.5 + 0.1);
      context.fillRect(-front - 0.1, at, 0.6, side * 0.5 + 0.1);
    }
  }
  if (state & SPECIAL) {
    context.fillStyle = blink ? "#2b6cff" : "#9dbcff";
    context.fillRect(-0.3, -side * 0.7, 0.6, side * 1.4);
  }
}

function doors(context, length, side, open, palette) {
  if (!open) return;
  context.strokeStyle = palette.ink;
  context.lineWidth = 0.14;
  for (let door = 0; door < 4; door++) {
    if (!(open & (1 << door))) continue;
    const x = door < 2 ? length * 0.18 : -length * 0.08;
    const sign = door % 2 ? 1 : -1;
    context.beginPath();
    context.moveTo(x, sign * side);
    context.lineTo(x - 0.25, sign * (side + 0.95));
    context.stroke();
  }
}

function drawSign(context, x, y, isStop) {
  context.beginPath();
  const corners = isStop ? 8 : 3;
  for (let k = 0; k < corners; k++) {
    const turn = ((k + (isStop ? 0.5 : 0.75)) * 2 * Math.PI) / corners;
    context.lineTo(x + 0.55 * Math.cos(turn), y + 0.55 * Math.sin(turn));
  }
  context.closePath();
  context.fillStyle = isStop ? "#c9222b" : "#ffffff";
  context.strokeStyle = isStop ? "#ffffff" : "#c9222b";
  context.lineWidth = 0.14;
  context.fill();
  context.stroke();
}
