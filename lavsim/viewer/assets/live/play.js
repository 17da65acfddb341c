// Puts the parts of the live page together: socket, keys and buttons.

import { decode } from "../js/decode.js";
import { Inner } from "../js/inner.js";
import { Panel } from "../js/panel.js";
import { Stage } from "../js/stage.js";
import { clock } from "../js/timeline.js";
import { Keys } from "./keys.js";
import { Link } from "./link.js";
import { World } from "./world.js";

const byId = (id) => document.getElementById(id);
const PANEL_PERIOD = 90; // [ms] between updates of the column while it drives
const LONGEST = 300; // [ms] that a step from tick to tick is drawn over
const PAUSE = "M7 4h4v16H7zM14 4h4v16h-4z";
const PLAY = "M7 4l13 8-13 8z";
const SIGNS = { contact: "!", hazard: "H", set: "+" };

class Player extends Stage {
  constructor(world, link) {
    super(world);
    Object.assign(this, { world, link, status: null, selected: 0, drawn: 0, innerTick: 0 });
    this.show.inner = true;
    this.inner = new Inner(world);
    this.panel = new Panel(world, [], {});
    byId("events").replaceChildren();
    this.panel.listLayers([["route", "route", true], ["trail", "driven", true], ["lights", "lights", true], ["infractions", "set hazards", true],
      ["scenery", "scenery", true], ["labels", "ids", false], ["paint", "own paint", false], ["inner", "agent's view", true]],
    (key, isOn) => this.layer(key, isOn));
    this.keys = new Keys((wish) => link.send("drive", wish));
    this.wire();
  }

  wire() {
    const { isDriven } = this;
    byId("pad").hidden = byId("reverse").hidden = byId("drive-keys").hidden = !isDriven;
    this.click("play", () => this.toggle());
    this.click("step", () => this.step());
    this.click("reverse", () => this.link.send("reverse"));
    this.click("save", () => this.link.send("save"));
    this.click("restart", () => this.wait("restart", "Starting anew …", { seed: Math.min(Math.max(Math.round(byId("seed").valueAsNumber || 0), 0), 2147483647) }));
    this.click("fork", () => this.wait("fork", "Driving there again …", { tick: this.world.tick }));
    this.click("find", () => { byId("find").disabled = true; this.link.send("hazards"); });
    byId("past").addEventListener("input", (event) => this.link.send("look", { tick: event.target.valueAsNumber }));
    byId("speed").addEventListener("change", (event) => this.link.send("speed", { value: Number(event.target.value) }));
    document.addEventListener("keyup", (event) => this.isDriven && this.keys.take(event.key, false));
    this.wireMap();
  }

  get isDriven() {
    return this.world.meta.keyboard;
  }

  onKey(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || ["SELECT", "INPUT"].includes(event.target.tagName)) return;
    if (this.isDriven && this.keys.take(event.key, true)) {
      event.preventDefault();
      return;
    }
    const actions = {
      " ": () => this.toggle(), k: () => this.toggle(), ".": () => this.step(), r: () => this.isDriven && this.link.send("reverse"),
      e: () => this.select(0), ...this.mapKeys,
    };
    const action = actions[event.key.toLowerCase()];
    if (!action || (event.repeat && event.key !== ".") || (event.key === " " && event.target.tagName === "BUTTON")) return;
    event.preventDefault();
    action();
  }

  // ---- what is asked of the simulation

  toggle() {
    this.link.send("pause", { on: !this.status.paused });
  }

  step() {
    if (this.isPast) this.link.send("look", { tick: this.world.tick + 1 });
    else this.link.send("step", { ticks: 1 });
  }

  /** Asks for something that takes its time. */
  wait(name, text, values) {
    this.tell(text);
    this.link.send(name, values);
  }

  // ---- what the simulation tells

  async told(message) {
    if (message.frame) return this.take(message);
    byId("find").disabled = false;
    if (message.error) this.tell(message.error, true);
    else if (message.saved) this.tell(`Saved ${message.saved}`);
    else if (message.told) this.tell(message.told);
    else if (message.hazards) this.listPlaces(message.hazards);
    return undefined;
  }

  take(message) {
    const { world } = this;
    const isNew = world.take(message);
    if (message.reset) {
      byId("events").replaceChildren();
      this.listed = 0;
      this.select(0);
    }
    this.status = message.status;
    this.newest = message.frame;
    this.arrived = performance.now();
    if (message.inner !== undefined) this.takeInner(message.inner);
    this.scene.trail = world.trail.map((places) => places.subarray(0, world.trailEnd));
    if (isNew) this.panel.listColours(this.palette);
    this.listEvents();
    this.showStatus();
    this.redraw();
  }

  async takeInner([tick, text]) {
    this.wanted = text;
    const found = text ? await decode(text) : { meta: { drawings: [] }, arrays: {} };
    if (this.wanted !== text) return; // a newer one came meanwhile
    this.inner = new Inner(found);
    this.innerTick = tick; // their pack counts from it
    this.redraw();
  }

  get isPast() {
    return this.world.tick < this.status.last;
  }

  showStatus() {
    const { status } = this;
    byId("play-icon").setAttribute("d", status.paused ? PLAY : PAUSE);
    byId("play").setAttribute("aria-label", status.paused ? "Go on" : "Pause");
    byId("reverse").setAttribute("aria-pressed", String(status.reverse));
    if (document.activeElement !== byId("speed")) byId("speed").value = String(status.speed);
    if (document.activeElement !== byId("seed") && this.seed !== status.seed) byId("seed").value = this.seed = status.seed;
    const past = byId("past");
    past.min = status.first;
    past.max = status.last;
    if (!past.matches(":active")) past.value = this.world.tick;
    byId("fork").hidden = !this.isPast;
    byId("note").hidden = !status.note && !this.isPast;
    byId("note").textContent = this.isPast ? `The past: ${((status.last - this.world.tick) * this.world.dt).toFixed(2)} s before the newest tick` : status.note;
    byId("badge").hidden = false;
    byId("badge").textContent = status.note ? "ended" : status.paused ? "paused" : "driving";
    byId("badge").className = `badge ${status.note ? "bad" : status.paused ? "" : "good"}`;
  }

  tell(text, isBad = false) {
    byId("told").textContent = text;
    byId("told").classList.toggle("bad", isBad);
  }

  listPlaces(hazards) {
    byId("places").replaceChildren();
    if (!hazards.length) this.tell("No hazard fits in the next 150 m.");
    for (const { type, ahead } of hazards) {
      const button = document.createElement("button");
      const far = document.createElement("span");
      far.textContent = `${ahead} m`;
      button.append(type, far);
      button.addEventListener("click", () => this.wait("hazard", `${type} …`, { type }));
      const item = document.createElement("li");
      item.append(button);
      byId("places").append(item);
    }
  }

  listEvents() {
    const { events, dt } = this.world;
    for (; this.listed < events.length; this.listed++) {
      const { tick, kind, text } = events[this.listed];
      const item = document.createElement("li");
      for (const [content, name] of [[SIGNS[kind] || "?", `dot ${kind}`], [clock(tick * dt, true), "t"], [text, ""]]) {
        const part = document.createElement("span");
        part.textContent = content;
        part.className = name;
        item.append(part);
      }
      byId("events").prepend(item);
    }
  }

  // ---- drawing

  redraw() {
    if (this.status) super.redraw();
  }

  /** How far the picture is between the last two ticks that came. */
  share() {
    const { status, world } = this;
    if (status.paused || !status.speed) return 1;
    const span = Math.min(((world.tick - world.tickBefore) * world.dt * 1000) / status.speed, LONGEST);
    return span > 0 ? Math.min((performance.now() - this.arrived) / span, 1) : 1;
  }

  frame(now) {
    const { world } = this;
    world.share = this.share();
    const late = world.tick - this.innerTick;
    const isComplete = this.drawMap(world.shownMoment, late, () => this.show.inner);
    this.showHud();
    if (this.status.paused || !this.shown || now - this.shown > PANEL_PERIOD) {
      this.shown = now;
      this.panel.update(this.selected, world.last, undefined, this.inner.scalars(late));
    }
    this.frames++;
    if (this.drawn !== this.newest) {
      this.drawn = this.newest;
      this.link.send("seen", { frame: this.newest });
    }
    this.isSettled = isComplete && world.share === 1;
    if (!this.isSettled) this.redraw();
  }

  showHud() {
    const { world, status } = this;
    byId("hud-speed").textContent = `${Math.abs(world.speed * 0.036).toFixed(0)} km/h${world.isReverse ? " R" : ""}`;
    byId("hud-state").textContent = `${status.metres.toFixed(0)} of ${status.length.toFixed(0)} m`;
    byId("clock").textContent = clock(world.tick * world.dt);
    const more = document.createElement("small");
    more.textContent = `  tick ${world.tick}`;
    byId("clock").append(more);
  }
}

let player = null;
let opening = Promise.resolve(); // messages are taken one after the other, the first one takes its time

async function take(link, message) {
  if (message.scene) {
    player = new Player(new World(await decode(message.scene)), link);
    byId("loading").hidden = true;
    document.title = `${player.world.meta.title} - lavsim view`;
    // What tests and consoles may ask: where everybody was drawn, and how the page stands.
    window.replay = {
      player,
      drawn: () => player.scene.drawn.slice(),
      state: () => ({ ...player.status, tick: player.world.tick, isSettled: Boolean(player.isSettled), frames: player.frames,
        theme: document.documentElement.dataset.theme }),
    };
  } else player.told(message);
}

const link = new Link({
  told: (message) => { opening = opening.then(() => take(link, message)); },
  lost: () => {
    const loading = byId("loading");
    loading.hidden = false;
    loading.classList.toggle("over", Boolean(player));
    loading.textContent = player ? "The simulation has ended, or the connection is lost." : "No simulation answers here: open the address that lavsim view printed.";
  },
});
