// Puts the parts of the replay together: time, keys and buttons.

import { decode } from "./decode.js";
import { Drive } from "./drive.js";
import { Inner } from "./inner.js";
import { Panel } from "./panel.js";
import { Panes } from "./panes.js";
import { eventAt, eventsOf } from "./scene.js";
import { Stage } from "./stage.js";
import { Timeline, clock } from "./timeline.js";

const byId = (id) => document.getElementById(id);
const PANEL_PERIOD = 90; // [ms] between updates of the column while it plays
const PAUSE = "M7 4h4v16H7zM14 4h4v16h-4z";
const PLAY = "M7 4l13 8-13 8z";

class Player extends Stage {
  constructor(drive) {
    super(drive);
    this.drive = drive;
    this.moment = 0;
    this.speed = 1;
    this.isPlaying = false;
    this.selected = drive.row.length ? drive.row[0] : -1;
    this.show.inner = {};
    this.events = eventsOf(drive);
    this.inner = new Inner(drive);
    this.panes = new Panes(drive);
    const hand = { seek: (moment) => this.seek(moment), tell: (text, x) => this.tell(text, x) };
    this.panel = new Panel(drive, this.events, hand);
    this.panel.listColours(this.palette);
    this.listLayers();
    this.timeline = new Timeline(byId("timeline"), drive, this.events, hand);
    this.timeline.prepare(this.palette);
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
      else this.layer(key, isOn);
      this.redraw();
    });
  }

  wire() {
    this.click("play", () => this.toggle());
    this.click("start", () => this.seek(0));
    this.click("back", () => this.step(-1));
    this.click("forth", () => this.step(1));
    this.click("next", () => this.jump(1));
    byId("speed").addEventListener("change", (event) => { this.speed = Number(event.target.value); });
    window.addEventListener("hashchange", () => this.onHash());
    new ResizeObserver(() => this.onSize()).observe(byId("timeline"));
    this.wireMap();
  }

  onKey(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    const second = event.shiftKey ? Math.round(1 / this.drive.dt) : 1;
    const actions = {
      " ": () => this.toggle(), k: () => this.toggle(), ArrowLeft: () => this.step(-second), ArrowRight: () => this.step(second),
      Home: () => this.seek(0), End: () => this.seek(this.drive.last), n: () => this.jump(1), p: () => this.jump(-1),
      e: () => this.select(this.drive.row[0]), ...this.mapKeys,
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

  /** `#t=12.5` is the simulation time of that many seconds. */
  onHash() {
    const found = /[#&]t=(-?[\d.]+)/.exec(window.location.hash);
    if (found) this.seek(Math.round(this.drive.moment(Number(found[1]))));
  }

  // ---- drawing

  onSize() {
    const box = byId("timeline").getBoundingClientRect();
    if (box.width !== this.timeline.width || box.height !== this.timeline.height) this.timeline.prepare(this.palette);
    super.onSize();
  }

  setTheme(theme) {
    super.setTheme(theme);
    this.timeline.prepare(this.palette);
  }

  frame(now) {
    if (this.isPlaying) this.advance(now);
    const isComplete = this.drawMap(this.moment, this.moment, (name) => this.show.inner[name]);
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
