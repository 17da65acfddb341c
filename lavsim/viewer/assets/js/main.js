// Puts the parts together: time, camera, keys and buttons.

import { decode } from "./decode.js";
import { Drive } from "./drive.js";
import { Inner } from "./inner.js";
import { Panel } from "./panel.js";
import { THEMES, applyTheme, paletteOf } from "./palette.js";
import { Panes } from "./panes.js";
import { Scene, eventAt, eventsOf } from "./scene.js";
import { Tiles } from "./tiles.js";
import { Timeline, clock } from "./timeline.js";
import { View, handle } from "./view.js";

const byId = (id) => document.getElementById(id);
const PANEL_PERIOD = 90; // [ms] between updates of the column while it plays
const TILE_TIME = 10; // [ms] of a frame that missing tiles may take
const PAUSE = "M7 4h4v16H7zM14 4h4v16h-4z";
const PLAY = "M7 4l13 8-13 8z";

class Player {
  constructor(drive) {
    this.drive = drive;
    this.moment = 0;
    this.speed = 1;
    this.isPlaying = false;
    this.isFollowing = true;
    this.isHeadingUp = true;
    this.selected = drive.row.length ? drive.row[0] : -1;
    this.show = { route: true, trail: true, lights: true, infractions: true, scenery: true, labels: false, paint: false, inner: {} };
    this.frames = 0;
    this.isSettled = false;
    this.events = eventsOf(drive);
    this.palette = paletteOf();
    this.view = new View(byId("map"));
    this.tiles = new Tiles(drive, this.palette);
    this.scene = new Scene(drive);
    this.inner = new Inner(drive);
    this.panes = new Panes(drive);
    const hand = { seek: (moment) => this.seek(moment), tell: (text, x) => this.tell(text, x) };
    this.panel = new Panel(drive, this.events, hand);
    this.panel.listColours(this.palette);
    this.listLayers();
    this.timeline = new Timeline(byId("timeline"), drive, this.events, hand);
    this.timeline.prepare(this.palette);
    handle(this.view, {
      moved: () => this.free(),
      zoomed: (x, y, factor) => this.zoom(x, y, factor),
      clicked: (x, y) => this.pick(x, y),
    });
    this.wire();
    this.onHash();
    this.showNote();
    if (!drive.ticks) this.fit();
    this.redraw();
  }

  listLayers() {
    const layers = [["route", "route", true], ["trail", "driven", true], ["lights", "lights", true], ["infractions", "infractions", true],
      ["scenery", "scenery", true], ["labels", "ids", false], ["paint", "own paint", false]];
    for (const name of this.inner.names) {
      this.show.inner[name] = true;
      layers.push([`inner:${name}`, name, true]);
    }
    this.panel.listLayers(layers, (key, isOn) => {
      if (key.startsWith("inner:")) this.show.inner[key.slice(6)] = isOn;
      else this.show[key] = isOn;
      if (key === "scenery") {
        this.tiles.scenery = isOn;
        this.tiles.repaint(this.palette);
      }
      this.redraw();
    });
  }

  wire() {
    const click = (id, action) => byId(id).addEventListener("click", action);
    click("play", () => this.toggle());
    click("start", () => this.seek(0));
    click("back", () => this.step(-1));
    click("forth", () => this.step(1));
    click("next", () => this.jump(1));
    click("zoom-in", () => this.zoomMiddle(1.4));
    click("zoom-out", () => this.zoomMiddle(1 / 1.4));
    click("fit", () => this.fit());
    click("follow", () => this.follow(!this.isFollowing));
    click("heading", () => this.turn(!this.isHeadingUp));
    click("theme", () => this.nextTheme());
    byId("speed").addEventListener("change", (event) => { this.speed = Number(event.target.value); });
    document.addEventListener("keydown", (event) => this.onKey(event));
    window.addEventListener("hashchange", () => this.onHash());
    new ResizeObserver(() => this.onSize()).observe(byId("stage"));
    new ResizeObserver(() => this.onSize()).observe(byId("timeline"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.setTheme(this.theme));
    this.setTheme("auto");
  }

  onKey(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    const second = event.shiftKey ? Math.round(1 / this.drive.dt) : 1;
    const actions = {
      " ": () => this.toggle(), k: () => this.toggle(), ArrowLeft: () => this.step(-second), ArrowRight: () => this.step(second),
      Home: () => this.seek(0), End: () => this.seek(this.drive.last), n: () => this.jump(1), p: () => this.jump(-1),
      f: () => this.follow(!this.isFollowing), h: () => this.turn(!this.isHeadingUp), e: () => this.select(this.drive.row[0]),
      "+": () => this.zoomMiddle(1.4), "=": () => this.zoomMiddle(1.4), "-": () => this.zoomMiddle(1 / 1.4), 0: () => this.fit(),
      t: () => this.nextTheme(), "[": () => this.hasten(-1), "]": () => this.hasten(1),
    };
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action || (event.key === " " && event.target.tagName === "BUTTON") || (event.key === " " && event.target.tagName === "INPUT")) return;
    event.preventDefault();
    action();
  }

  // ---- time

  toggle() {
    if (!this.isPlaying && this.moment >= this.drive.last) this.moment = 0;
    this.isPlaying = !this.isPlaying;
    byId("play-icon").setAttribute("d", this.isPlaying ? PAUSE : PLAY);
    byId("play").setAttribute("aria-label", this.isPlaying ? "Pause" : "Play");
    this.before = null;
    if (!this.isPlaying) this.moment = Math.round(this.moment);
    this.redraw();
  }

  seek(moment) {
    this.moment = Math.min(Math.max(moment, 0), this.drive.last);
    this.redraw();
  }

  step(ticks) {
    if (this.isPlaying) this.toggle();
    this.seek(Math.round(this.moment) + ticks);
  }

  jump(direction) {
    const later = this.events.filter((event) => (direction > 0 ? event.moment > this.moment + 0.5 : event.moment < this.moment - 0.5));
    if (later.length) this.seek(direction > 0 ? later[0].moment : later[later.length - 1].moment);
  }

  hasten(direction) {
    const select = byId("speed");
    select.selectedIndex = Math.min(Math.max(select.selectedIndex + direction, 0), select.options.length - 1);
    this.speed = Number(select.value);
  }

  /** `#t=12.5` is the simulation time of that many seconds. */
  onHash() {
    const found = /[#&]t=(-?[\d.]+)/.exec(window.location.hash);
    if (found) this.seek(Math.round(this.drive.moment(Number(found[1]))));
  }

  // ---- camera

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
    this.view.fit(...this.drive.meta.frame);
    this.redraw();
  }

  pick(x, y) {
    let best = null;
    for (const actor of this.scene.drawn) {
      const gap = Math.hypot(actor.x - x, actor.y - y);
      if (gap < Math.max(16, 2.4 * this.view.scale) && (!best || gap < best.gap)) best = { gap, id: actor.id };
    }
    if (best) this.select(this.drive.actors.id.indexOf(best.id));
  }

  select(row) {
    this.selected = row;
    this.redraw();
  }

  aim() {
    const track = this.drive.trackOf(this.selected, this.moment);
    this.view.ahead = this.isFollowing && this.isHeadingUp ? 0.64 : 0.5;
    if (!this.isFollowing || track < 0) return;
    const now = this.drive.turnTo(this.moment);
    for (let i = 0; i < now.count; i++) {
      if (now.track[i] !== track) continue;
      this.view.x = now.x[i];
      this.view.y = now.y[i];
      if (this.isHeadingUp) this.view.angle = -Math.PI / 2 - now.yaw[i];
    }
  }

  onSize() {
    const isNew = this.view.resize();
    const box = byId("timeline").getBoundingClientRect();
    if (box.width !== this.timeline.width || box.height !== this.timeline.height) this.timeline.prepare(this.palette);
    if (isNew) this.redraw();
    this.redraw();
  }

  // ---- theme

  nextTheme() {
    this.setTheme(THEMES[(THEMES.indexOf(this.theme) + 1) % THEMES.length]);
  }

  setTheme(theme) {
    this.theme = theme;
    applyTheme(theme);
    this.palette = paletteOf();
    this.tiles.repaint(this.palette);
    this.timeline.prepare(this.palette);
    this.panel.listColours(this.palette);
    this.redraw();
  }

  // ---- drawing

  redraw() {
    this.isSettled = false;
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.asked = false;
    if (this.isPlaying) this.advance(now);
    this.aim();
    const context = byId("map").getContext("2d", { alpha: false });
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = this.palette.land;
    context.fillRect(0, 0, this.view.canvas.width, this.view.canvas.height);
    const isComplete = this.tiles.draw(context, this.view, performance.now() + TILE_TIME);
    this.inner.draw(context, this.view, this.moment, (name) => this.show.inner[name], this.palette);
    this.scene.draw(context, this.view, this.moment, this.show, this.palette, this.selected);
    this.inner.drawLabels(context, this.view, this.moment, (name) => this.show.inner[name], this.palette);
    this.timeline.draw(this.moment);
    this.panes.draw(this.moment);
    this.showHud();
    if (!this.isPlaying || !this.told || now - this.told > PANEL_PERIOD) {
      this.told = now;
      this.panel.update(this.selected, this.moment, eventAt(this.events, this.moment), this.inner.scalars(this.moment));
    }
    this.frames++;
    this.isSettled = isComplete && !this.isPlaying;
    if (this.isPlaying || !isComplete) this.redraw();
  }

  advance(now) {
    const passed = this.before === null ? 0 : Math.min(now - this.before, 250);
    this.before = now;
    this.moment += (passed * this.speed) / 1000 / this.drive.dt;
    if (this.moment < this.drive.last) return;
    this.moment = this.drive.last;
    this.toggle();
  }

  showHud() {
    const index = Math.round(this.moment);
    const { arrays, meta } = this.drive;
    const time = this.drive.time(this.moment);
    byId("clock").textContent = clock(time);
    const more = document.createElement("small");
    more.textContent = ` / ${clock(this.drive.time(this.drive.last), true)}  tick ${meta.first_tick + index}`;
    byId("clock").append(more);
    byId("timeline").setAttribute("aria-valuenow", String(index));
    byId("timeline").setAttribute("aria-valuetext", clock(time));
    const speed = arrays["ego.speed"].length ? `${Math.abs((arrays["ego.speed"][index] * 3.6) / 100).toFixed(0)} km/h` : "no tick";
    byId("hud-speed").textContent = speed;
    const active = meta.hazards.filter((hazard) => hazard.first <= index && index < hazard.last).map((hazard) => hazard.type);
    byId("hud-state").textContent = active.join(", ");
    const metres = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000].find((m) => m * this.view.scale > 50) || 5000;
    byId("scale").firstElementChild.style.width = `${metres * this.view.scale}px`;
    byId("scale").lastElementChild.textContent = `${metres} m`;
  }

  showNote() {
    const { note } = this.drive.meta;
    byId("note").hidden = !note;
    byId("note").textContent = note || "";
  }

  tell(text, x) {
    const tip = byId("tip");
    tip.hidden = !text;
    if (!text) return;
    tip.textContent = text;
    const width = byId("transport").clientWidth;
    tip.style.left = `${Math.min(Math.max(x + 12 - tip.offsetWidth / 2, 6), width - tip.offsetWidth - 6)}px`;
  }
}

async function open() {
  const begun = performance.now();
  const data = byId("data");
  const drive = new Drive(await decode(data.textContent));
  data.remove();
  byId("loading").remove();
  const player = new Player(drive);
  // What tests and consoles may ask: where everybody was drawn, and how the page stands.
  window.replay = {
    player,
    opened: performance.now() - begun,
    seek: (time) => player.seek(Math.round(drive.moment(time))),
    drawn: () => player.scene.drawn.slice(),
    state: () => ({ time: drive.time(player.moment), tick: drive.meta.first_tick + Math.round(player.moment), isPlaying: player.isPlaying,
      isSettled: player.isSettled, frames: player.frames, theme: document.documentElement.dataset.theme, scale: player.view.scale,
      isFollowing: player.isFollowing, selected: drive.actors.id[player.selected] }),
  };
}

open().catch((error) => {
  byId("loading").textContent = `This replay can't be shown: ${error.message}`;
  throw error;
});
