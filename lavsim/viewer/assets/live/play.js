// Puts the parts of the live page together: socket, camera, keys and buttons.

import { decode } from "../js/decode.js";
import { Inner } from "../js/inner.js";
import { THEMES, applyTheme, paletteOf } from "../js/palette.js";
import { Panel } from "../js/panel.js";
import { Scene } from "../js/scene.js";
import { Tiles } from "../js/tiles.js";
import { clock } from "../js/timeline.js";
import { View, handle } from "../js/view.js";
import { Keys } from "./keys.js";
import { Link } from "./link.js";
import { World } from "./world.js";

const byId = (id) => document.getElementById(id);
const TILE_TIME = 10; // [ms] of a frame that missing tiles may take
const PANEL_PERIOD = 90; // [ms] between updates of the column while it drives
const LONGEST = 300; // [ms] that a step from tick to tick is drawn over
const PAUSE = "M7 4h4v16H7zM14 4h4v16h-4z";
const PLAY = "M7 4l13 8-13 8z";
const SIGNS = { contact: "!", hazard: "H", set: "+" };

class Player {
  constructor(world, link) {
    Object.assign(this, { world, link, status: null, selected: 0, isFollowing: true, isHeadingUp: true, frames: 0, drawn: 0, innerTick: 0 });
    this.show = { route: true, trail: true, lights: true, infractions: true, scenery: true, labels: false, paint: false, inner: true };
    this.palette = paletteOf();
    this.view = new View(byId("map"));
    this.tiles = new Tiles(world, this.palette);
    this.scene = new Scene(world);
    this.inner = new Inner(world);
    this.panel = new Panel(world, [], {});
    byId("events").replaceChildren();
    this.panel.listLayers([["route", "route", true], ["trail", "driven", true], ["lights", "lights", true], ["infractions", "set hazards", true],
      ["scenery", "scenery", true], ["labels", "ids", false], ["paint", "own paint", false], ["inner", "agent's view", true]],
    (key, isOn) => this.layer(key, isOn));
    this.keys = new Keys((wish) => link.send("drive", wish));
    handle(this.view, { moved: () => this.free(), zoomed: (x, y, factor) => this.zoom(x, y, factor), clicked: (x, y) => this.pick(x, y) });
    this.wire();
  }

  wire() {
    const click = (id, action) => byId(id).addEventListener("click", action);
    const { isDriven } = this;
    byId("pad").hidden = byId("reverse").hidden = byId("drive-keys").hidden = !isDriven;
    click("play", () => this.toggle());
    click("step", () => this.step());
    click("reverse", () => this.link.send("reverse"));
    click("zoom-in", () => this.zoomMiddle(1.4));
    click("zoom-out", () => this.zoomMiddle(1 / 1.4));
    click("fit", () => this.fit());
    click("follow", () => this.follow(!this.isFollowing));
    click("heading", () => this.turn(!this.isHeadingUp));
    click("theme", () => this.setTheme(THEMES[(THEMES.indexOf(this.theme) + 1) % THEMES.length]));
    click("save", () => this.link.send("save"));
    click("restart", () => this.wait("restart", "Starting anew …", { seed: Math.min(Math.max(Math.round(byId("seed").valueAsNumber || 0), 0), 2147483647) }));
    click("fork", () => this.wait("fork", "Driving there again …", { tick: this.world.tick }));
    click("find", () => { byId("find").disabled = true; this.link.send("hazards"); });
    byId("past").addEventListener("input", (event) => this.link.send("look", { tick: event.target.valueAsNumber }));
    byId("speed").addEventListener("change", (event) => this.link.send("speed", { value: Number(event.target.value) }));
    document.addEventListener("keydown", (event) => this.onKey(event));
    document.addEventListener("keyup", (event) => this.isDriven && this.keys.take(event.key, false));
    new ResizeObserver(() => this.onSize()).observe(byId("stage"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.setTheme(this.theme));
    this.setTheme("auto");
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
      f: () => this.follow(!this.isFollowing), h: () => this.turn(!this.isHeadingUp), e: () => this.select(0),
      "+": () => this.zoomMiddle(1.4), "=": () => this.zoomMiddle(1.4), "-": () => this.zoomMiddle(1 / 1.4), 0: () => this.fit(),
      t: () => byId("theme").click(), "[": () => this.hasten(-1), "]": () => this.hasten(1),
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

  hasten(direction) {
    const select = byId("speed");
    select.selectedIndex = Math.min(Math.max(select.selectedIndex + direction, 0), select.options.length - 1);
    this.link.send("speed", { value: Number(select.value) });
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

  // ---- camera

  layer(key, isOn) {
    this.show[key] = isOn;
    if (key === "scenery") {
      this.tiles.scenery = isOn;
      this.tiles.repaint(this.palette);
    }
    this.redraw();
  }

  follow(isOn) {
    this.isFollowing = isOn;
    byId("follow").setAttribute("aria-pressed", String(isOn));
    this.redraw();
  }

  free() {
    if (this.isFollowing) this.follow(false);
    this.redraw();
  }

  turn(isUp) {
    this.isHeadingUp = isUp;
    byId("heading").setAttribute("aria-pressed", String(isUp));
    if (!isUp) this.view.angle = 0;
    this.redraw();
  }

  zoom(x, y, factor) {
    this.view.zoomAt(x, y, factor);
    this.redraw();
  }

  zoomMiddle(factor) {
    this.zoom(this.view.width / 2, this.view.height * this.view.ahead, factor);
  }

  fit() {
    this.follow(false);
    this.turn(false);
    this.view.fit(...this.world.meta.frame);
    this.redraw();
  }

  pick(x, y) {
    let best = null;
    for (const actor of this.scene.drawn) {
      const gap = Math.hypot(actor.x - x, actor.y - y);
      if (gap < Math.max(16, 2.4 * this.view.scale) && (!best || gap < best.gap)) best = { gap, id: actor.id };
    }
    if (best) this.select(this.world.actors.id.indexOf(best.id));
  }

  select(row) {
    this.selected = row;
    this.redraw();
  }

  aim() {
    this.view.ahead = this.isFollowing && this.isHeadingUp ? 0.64 : 0.5;
    const now = this.world.turnTo();
    for (let i = 0; this.isFollowing && i < now.count; i++) {
      if (now.track[i] !== this.selected) continue;
      this.view.x = now.x[i];
      this.view.y = now.y[i];
      if (this.isHeadingUp) this.view.angle = -Math.PI / 2 - now.yaw[i];
    }
  }

  onSize() {
    this.view.resize();
    this.redraw();
  }

  setTheme(theme) {
    this.theme = theme;
    applyTheme(theme);
    this.palette = paletteOf();
    this.tiles.repaint(this.palette);
    this.panel.listColours(this.palette);
    this.redraw();
  }

  // ---- drawing

  redraw() {
    this.isSettled = false;
    if (this.asked || !this.status) return;
    this.asked = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  /** How far the picture is between the last two ticks that came. */
  share() {
    const { status, world } = this;
    if (status.paused || !status.speed) return 1;
    const span = Math.min(((world.tick - world.tickBefore) * world.dt * 1000) / status.speed, LONGEST);
    return span > 0 ? Math.min((performance.now() - this.arrived) / span, 1) : 1;
  }

  frame(now) {
    this.asked = false;
    const { world, view } = this;
    world.share = this.share();
    const moment = world.shownMoment;
    this.aim();
    const context = byId("map").getContext("2d", { alpha: false });
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = this.palette.land;
    context.fillRect(0, 0, view.canvas.width, view.canvas.height);
    const isComplete = this.tiles.draw(context, view, performance.now() + TILE_TIME);
    const isShown = () => this.show.inner;
    const late = world.tick - this.innerTick;
    this.inner.draw(context, view, late, isShown, this.palette);
    this.scene.draw(context, view, moment, this.show, this.palette, this.selected);
    this.inner.drawLabels(context, view, late, isShown, this.palette);
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
    const { world, status, view } = this;
    byId("hud-speed").textContent = `${Math.abs(world.speed * 0.036).toFixed(0)} km/h${world.isReverse ? " R" : ""}`;
    byId("hud-state").textContent = `${status.metres.toFixed(0)} of ${status.length.toFixed(0)} m`;
    byId("clock").textContent = clock(world.tick * world.dt);
    const more = document.createElement("small");
    more.textContent = `  tick ${world.tick}`;
    byId("clock").append(more);
    const metres = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000].find((m) => m * view.scale > 50) || 5000;
    byId("scale").firstElementChild.style.width = `${metres * view.scale}px`;
    byId("scale").lastElementChild.textContent = `${metres} m`;
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
