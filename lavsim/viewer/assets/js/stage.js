// The map of a page and the hands on it: camera, selection, layers, colours. The replay and the live page are made of it.

import { Scene } from "./scene.js";
import { Tiles } from "./tiles.js";
import { View, handle } from "./view.js";
import { THEMES, applyTheme, paletteOf } from "./palette.js";

const byId = (id) => document.getElementById(id);
const CLOSER = 1.4; // factor of a press on + or -
const TILE_TIME = 10; // [ms] of a frame that missing tiles may take

export class Stage {
  /** `source`: who is where and what the town looks like. A page adds `inner`, `panel` and `frame(now)`. */
  constructor(source) {
    this.source = source;
    this.selected = -1;
    this.isFollowing = true;
    this.isHeadingUp = true;
    this.show = { route: true, trail: true, lights: true, infractions: true, scenery: true, labels: false, paint: false };
    this.frames = 0;
    this.isSettled = false;
    this.palette = paletteOf();
    this.view = new View(byId("map"));
    this.tiles = new Tiles(source, this.palette);
    this.scene = new Scene(source);
    handle(this.view, { moved: () => this.free(), zoomed: (x, y, factor) => this.zoom(x, y, factor), clicked: (x, y) => this.pick(x, y) });
  }

  /** Gives the buttons of the map something to do. */
  wireMap() {
    this.click("zoom-in", () => this.zoomMiddle(CLOSER));
    this.click("zoom-out", () => this.zoomMiddle(1 / CLOSER));
    this.click("fit", () => this.fit());
    this.click("follow", () => this.follow(!this.isFollowing));
    this.click("heading", () => this.turn(!this.isHeadingUp));
    this.click("theme", () => this.nextTheme());
    document.addEventListener("keydown", (event) => this.onKey(event));
    new ResizeObserver(() => this.onSize()).observe(byId("stage"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.setTheme(this.theme));
    this.setTheme("auto");
  }

  click(id, action) {
    byId(id).addEventListener("click", action);
  }

  /** What keys do on both pages. */
  get mapKeys() {
    return {
      f: () => this.follow(!this.isFollowing), h: () => this.turn(!this.isHeadingUp), 0: () => this.fit(),
      "+": () => this.zoomMiddle(CLOSER), "=": () => this.zoomMiddle(CLOSER), "-": () => this.zoomMiddle(1 / CLOSER),
      t: () => this.nextTheme(), "[": () => this.hasten(-1), "]": () => this.hasten(1),
    };
  }

  /** Takes the next slower or faster pace of the list. */
  hasten(direction) {
    const select = byId("speed");
    select.selectedIndex = Math.min(Math.max(select.selectedIndex + direction, 0), select.options.length - 1);
    select.dispatchEvent(new Event("change"));
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
    this.view.fit(...this.source.meta.frame);
    this.redraw();
  }

  /** Selects who is drawn nearest to a pixel, if anybody is near. */
  pick(x, y) {
    let best = null;
    for (const actor of this.scene.drawn) {
      const gap = Math.hypot(actor.x - x, actor.y - y);
      if (gap < Math.max(16, 2.4 * this.view.scale) && (!best || gap < best.gap)) best = { gap, id: actor.id };
    }
    if (best) this.select(this.source.actors.id.indexOf(best.id));
  }

  select(row) {
    this.selected = row;
    this.redraw();
  }

  /** Turns the camera to whom it follows. */
  aim(moment) {
    this.view.ahead = this.isFollowing && this.isHeadingUp ? 0.64 : 0.5;
    const track = this.source.trackOf(this.selected, moment);
    if (!this.isFollowing || track < 0) return;
    const now = this.source.turnTo(moment);
    for (let i = 0; i < now.count; i++) {
      if (now.track[i] !== track) continue;
      this.view.x = now.x[i];
      this.view.y = now.y[i];
      if (this.isHeadingUp) this.view.angle = -Math.PI / 2 - now.yaw[i];
    }
  }

  onSize() {
    this.view.resize();
    this.redraw();
  }

  // ---- layers and colours

  layer(key, isOn) {
    this.show[key] = isOn;
    if (key === "scenery") {
      this.tiles.scenery = isOn;
      this.tiles.repaint(this.palette);
    }
    this.redraw();
  }

  nextTheme() {
    this.setTheme(THEMES[(THEMES.indexOf(this.theme) + 1) % THEMES.length]);
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
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame((now) => {
      this.asked = false;
      this.frame(now);
    });
  }

  /** Draws the town and all in it; false if tiles are still missing. `isShown(name)` is of the agent's view at `innerMoment`. */
  drawMap(moment, innerMoment, isShown) {
    const { view, palette } = this;
    this.aim(moment);
    const context = view.canvas.getContext("2d", { alpha: false });
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = palette.land;
    context.fillRect(0, 0, view.canvas.width, view.canvas.height);
    const isComplete = this.tiles.draw(context, view, performance.now() + TILE_TIME);
    this.inner.draw(context, view, innerMoment, isShown, palette);
    this.scene.draw(context, view, moment, this.show, palette, this.selected);
    this.inner.drawLabels(context, view, innerMoment, isShown, palette);
    this.showScale();
    return isComplete;
  }

  showScale() {
    const metres = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000].find((m) => m * this.view.scale > 50) || 5000;
    byId("scale").firstElementChild.style.width = `${metres * this.view.scale}px`;
    byId("scale").lastElementChild.textContent = `${metres} m`;
  }
}
