// The column beside the map: the chosen actor, events, layers, colours. All texts go in as text, never as markup.

import { CLASSES, ROLES, timeToContact } from "./drive.js";
import { clock } from "./timeline.js";

const byId = (id) => document.getElementById(id);

function element(tag, text, className) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  if (className) made.className = className;
  return made;
}

/** Fills a definition list; keeps its elements from call to call, so that nothing flickers. */
function fill(list, entries) {
  while (list.children.length > 2 * entries.length) list.lastChild.remove();
  while (list.children.length < 2 * entries.length) list.append(element("dt"), element("dd"));
  entries.forEach(([name, value], k) => {
    const [term, text] = [list.children[2 * k], list.children[2 * k + 1]];
    if (term.textContent !== name) term.textContent = name;
    if (text.textContent !== value) text.textContent = value;
  });
}

export class Panel {
  constructor(drive, events, hand) {
    Object.assign(this, { drive, events });
    byId("title").textContent = drive.meta.title;
    byId("subtitle").textContent = drive.meta.subtitle;
    if (drive.meta.badge) {
      byId("badge").textContent = drive.meta.badge.text;
      byId("badge").classList.add(drive.meta.badge.good ? "good" : "bad");
      byId("badge").hidden = false;
    }
    this.listEvents(hand);
    this.bars = ["throttle", "brake", "steer"].map((name) => this.addBar(name));
  }

  listEvents(hand) {
    const list = byId("events");
    if (!this.events.length) list.append(element("li", "No infraction, no contact, no hazard.", "none"));
    for (const event of this.events) {
      const button = element("button");
      const text = element("span", event.text);
      if (event.more) button.title = event.more;
      button.append(element("span", event.sign, `dot ${event.kind}`), element("span", clock(this.drive.time(event.moment), true), "t"), text);
      button.addEventListener("click", () => hand.seek(event.moment));
      const item = element("li");
      item.append(button);
      list.append(item);
    }
  }

  addBar(name) {
    const row = element("div", undefined, `bar ${name}`);
    const track = element("i");
    track.append(element("b"));
    row.append(element("span", name), track, element("span"));
    byId("bars").append(row);
    return row;
  }

  /** A checkbox for each layer; `changed(key, isOn)`. */
  listLayers(layers, changed) {
    for (const [key, name, isOn] of layers) {
      const label = element("label");
      const box = element("input");
      box.type = "checkbox";
      box.checked = isOn;
      box.dataset.layer = key;
      box.addEventListener("change", () => changed(key, box.checked));
      label.append(box, name);
      byId("layers").append(label);
    }
  }

  listColours(palette) {
    const used = new Set(this.drive.actors.class.map((kind) => CLASSES[kind]));
    byId("legend").replaceChildren();
    const entries = [["ego", "ego"], ...CLASSES.filter((name) => used.has(name)).map((name) => [name, name])];
    if (this.drive.actors.role.includes(2)) entries.push(["scenario", "hazard's (edge)"]);
    for (const [key, name] of entries) {
      const item = element("span");
      const dot = element("i");
      dot.style.background = palette[key];
      item.append(dot, name);
      byId("legend").append(item);
    }
  }

  /** Shows an actor's row at a moment, and which event is on. */
  update(row, moment, current, scalars) {
    const { drive } = this;
    const track = row < 0 ? -1 : drive.trackOf(row, moment);
    const body = track < 0 ? null : drive.body(track, moment);
    fill(byId("facts"), row < 0 ? [["none", ""]] : this.factsOf(row, body, moment));
    const isEgo = drive.actors.role[row] === 0;
    byId("bars").hidden = !isEgo;
    if (isEgo) this.showControls(Math.round(moment));
    if (current !== this.current) this.markEvent(current);
    byId("inner").hidden = !scalars.length;
    fill(byId("scalars"), scalars.map(([name, value, unit]) => [name, `${Number(value.toFixed(2))} ${unit}`.trim()]));
  }

  /** Marks the event that is on, and scrolls the list (never the page) to it. */
  markEvent(current) {
    this.current = current;
    const list = byId("events");
    [...list.children].forEach((item, k) => item.classList.toggle("now", k === current));
    const item = list.children[current];
    if (!item) return;
    const [top, bottom] = [item.offsetTop - list.offsetTop, item.offsetTop - list.offsetTop + item.offsetHeight];
    if (top < list.scrollTop || bottom > list.scrollTop + list.clientHeight) list.scrollTop = top - 4;
  }

  factsOf(row, body, moment) {
    const { actors } = this.drive;
    const [length, width, height] = actors.size[row];
    const entries = [["actor", `${actors.id[row]} (${ROLES[actors.role[row]]})`], ["class", CLASSES[actors.class[row]]],
      ["blueprint", actors.blueprint[row]], ["size", `${length.toFixed(1)} x ${width.toFixed(1)} x ${height.toFixed(1)} m`]];
    if (!body) return [...entries, ["now", "not there"]];
    const isEgo = actors.role[row] === 0;
    const speed = isEgo ? this.drive.arrays["ego.speed"][Math.round(moment)] / 100 : Math.hypot(body.vx, body.vy);
    entries.push(["speed", `${(speed * 3.6).toFixed(1)} km/h`], ["place", `${body.x.toFixed(2)}, ${body.y.toFixed(2)} m`],
      ["heading", `${((((body.yaw * 180) / Math.PI) % 360 + 360) % 360).toFixed(1)} deg`]);
    if (isEgo) {
      const nearest = this.drive.nearestContact(moment);
      entries.push(["time to contact", nearest.time < 30 ? `${nearest.time.toFixed(1)} s (${nearest.id})` : "-"]);
    } else {
      const ego = this.drive.body(0, moment);
      const time = timeToContact(ego, body);
      entries.push(["from the ego", `${Math.hypot(body.x - ego.x, body.y - ego.y).toFixed(1)} m`],
        ["time to contact", time < 30 ? `${time.toFixed(1)} s` : "-"]);
    }
    const lamps = [[8, "brake"], [32, "left"], [16, "right"], [64, "reverse"], [512, "emergency"]]
      .filter(([bit]) => body.state & bit).map(([, name]) => name);
    return [...entries, ["lamps", lamps.join(", ") || "-"]];
  }

  showControls(index) {
    const values = ["throttle", "brake", "steer"].map((name) => (this.drive.arrays[`ego.${name}`][index] || 0) / 1000);
    values.forEach((value, k) => {
      const [, track, text] = this.bars[k].children;
      const fillBar = track.firstChild;
      const isSteer = k === 2;
      fillBar.style.left = isSteer ? `${50 + Math.min(value, 0) * 50}%` : "0";
      fillBar.style.width = `${Math.abs(value) * (isSteer ? 50 : 100)}%`;
      text.textContent = (Math.abs(value) < 0.005 ? 0 : value).toFixed(2);
    });
  }
}
