// What stands still, drawn once into squares of pixels per zoom level and put together from them in every frame.

import { starts } from "./drive.js";

const SIZE = 512; // pixels of a tile's side
const BLEED = 1; // pixels drawn beyond it, so that neighbours leave no seam
const MOST = 160; // tiles kept
const CELL = 80; // [m] squares by which shapes are found again
const LEVELS = [-4, 5]; // powers of two [px/m]

/** Shapes (x, y in hundredths of metres) with an index by place. */
class Shapes {
  constructor(arrays, name) {
    this.n = arrays[`${name}.n`];
    this.x = arrays[`${name}.x`];
    this.y = arrays[`${name}.y`];
    this.first = starts(this.n);
    this.stamp = new Int32Array(this.n.length);
    this.round = 0;
    this.cells = new Map();
    for (let k = 0; k < this.n.length; k++) {
      let [x0, y0, x1, y1] = [Infinity, Infinity, -Infinity, -Infinity];
      for (let i = this.first[k]; i < this.first[k + 1]; i++) {
        x0 = Math.min(x0, this.x[i]);
        x1 = Math.max(x1, this.x[i]);
        y0 = Math.min(y0, this.y[i]);
        y1 = Math.max(y1, this.y[i]);
      }
      for (let cx = Math.floor(x0 / 100 / CELL); cx <= Math.floor(x1 / 100 / CELL); cx++) {
        for (let cy = Math.floor(y0 / 100 / CELL); cy <= Math.floor(y1 / 100 / CELL); cy++) {
          const key = `${cx},${cy}`;
          if (!this.cells.has(key)) this.cells.set(key, []);
          this.cells.get(key).push(k);
        }
      }
    }
  }

  /** Numbers of the shapes that may reach into a box [m], in order, each once. */
  within(x0, y0, x1, y1, margin) {
    const found = [];
    this.round++;
    for (let cx = Math.floor((x0 - margin) / CELL); cx <= Math.floor((x1 + margin) / CELL); cx++) {
      for (let cy = Math.floor((y0 - margin) / CELL); cy <= Math.floor((y1 + margin) / CELL); cy++) {
        for (const k of this.cells.get(`${cx},${cy}`) || []) {
          if (this.stamp[k] === this.round) continue;
          this.stamp[k] = this.round;
          found.push(k);
        }
      }
    }
    return found.sort((a, b) => a - b);
  }

  trace(context, k) {
    const end = this.first[k + 1];
    let i = this.first[k];
    context.moveTo(this.x[i] / 100, this.y[i] / 100);
    for (i++; i < end; i++) context.lineTo(this.x[i] / 100, this.y[i] / 100);
  }
}

export class Tiles {
  constructor(drive, palette) {
    const { arrays, meta } = drive;
    this.ground = meta.town.ground.map((name) => [name, new Shapes(arrays, `ground.${name}`)]);
    this.solids = meta.town.solids.map((name) => [name, new Shapes(arrays, `solid.${name}`)]);
    this.marks = new Shapes(arrays, "mark");
    this.crosswalks = new Shapes(arrays, "crosswalk");
    this.arrays = arrays;
    this.scenery = true;
    this.tiles = new Map();
    this.repaint(palette);
  }

  /** Forgets what was drawn: another theme, or other layers. */
  repaint(palette) {
    this.palette = palette;
    this.tiles.clear();
  }

  /** Puts the visible tiles on the canvas; draws missing ones until `deadline` [ms]. True when all were there. */
  draw(context, view, deadline) {
    const wanted = Math.round(Math.log2(view.scale * view.ratio));
    const level = Math.min(Math.max(wanted, LEVELS[0]), LEVELS[1]);
    const pixel = BLEED / 2 ** level;
    const side = SIZE / 2 ** level;
    const [x0, y0, x1, y1] = visible(view);
    const [a, b, c, d, e, f] = view.matrix();
    const r = view.ratio;
    context.setTransform(a * r, b * r, c * r, d * r, e * r, f * r);
    context.imageSmoothingEnabled = true;
    let complete = true;
    let drawn = 0;
    for (let ty = Math.floor(y0 / side); ty * side < y1; ty++) {
      for (let tx = Math.floor(x0 / side); tx * side < x1; tx++) {
        let tile = this.take(level, tx, ty);
        if (!tile && (drawn === 0 || performance.now() < deadline)) {
          tile = this.make(level, tx, ty);
          drawn++;
        }
        if (tile) context.drawImage(tile, tx * side - pixel, ty * side - pixel, side + 2 * pixel, side + 2 * pixel);
        else {
          complete = false;
          this.substitute(context, level, tx, ty);
        }
      }
    }
    return complete;
  }

  take(level, tx, ty) {
    const key = `${level}/${tx}/${ty}`;
    const tile = this.tiles.get(key);
    if (tile) {
      this.tiles.delete(key); // the newest last: the first is the one longest unused
      this.tiles.set(key, tile);
    }
    return tile;
  }

  /** The part of a coarser tile in place of one that is missing. */
  substitute(context, level, tx, ty) {
    const side = SIZE / 2 ** level;
    for (let up = 1; up <= 4; up++) {
      const tile = this.tiles.get(`${level - up}/${tx >> up}/${ty >> up}`);
      if (!tile) continue;
      const part = SIZE >> up;
      const column = tx - ((tx >> up) << up);
      const row = ty - ((ty >> up) << up);
      context.drawImage(tile, BLEED + column * part, BLEED + row * part, part, part, tx * side, ty * side, side, side);
      return;
    }
  }

  make(level, tx, ty) {
    const tile = document.createElement("canvas");
    tile.width = tile.height = SIZE + 2 * BLEED;
    const context = tile.getContext("2d", { alpha: false });
    const scale = 2 ** level;
    const side = SIZE / scale;
    const edge = BLEED / scale;
    const box = [tx * side - edge, ty * side - edge, (tx + 1) * side + edge, (ty + 1) * side + edge];
    context.fillStyle = this.palette.land;
    context.fillRect(0, 0, tile.width, tile.height);
    context.setTransform(scale, 0, 0, scale, -box[0] * scale, -box[1] * scale);
    for (const [name, shapes] of this.ground) this.fill(context, shapes, box, this.palette[name]);
    this.paintCrosswalks(context, box);
    this.paintMarks(context, box, 1 / scale);
    if (this.scenery) this.paintScenery(context, box, scale);
    this.tiles.set(`${level}/${tx}/${ty}`, tile);
    if (this.tiles.size > MOST) this.tiles.delete(this.tiles.keys().next().value);
    return tile;
  }

  fill(context, shapes, box, colour) {
    context.beginPath();
    for (const k of shapes.within(...box, 0)) {
      shapes.trace(context, k);
      context.closePath();
    }
    context.fillStyle = colour;
    context.fill();
  }

  paintCrosswalks(context, box) {
    context.strokeStyle = this.palette.white;
    context.lineCap = "butt";
    context.setLineDash([0.5, 0.5]);
    for (const k of this.crosswalks.within(...box, 10)) {
      context.lineWidth = this.arrays["crosswalk.width"][k] / 100;
      context.beginPath();
      this.crosswalks.trace(context, k);
      context.stroke();
    }
    context.setLineDash([]);
  }

  paintMarks(context, box, pixel) {
    context.lineJoin = "round";
    if (pixel > 1.5) return; // finer than can be seen
    for (const k of this.marks.within(...box, 2)) {
      const kind = this.arrays["mark.kind"][k];
      context.strokeStyle = kind === 2 ? this.palette.curb : kind >= 4 ? this.palette.yellow : this.palette.white;
      context.setLineDash(kind % 4 === 1 ? [3, 6] : []);
      context.lineWidth = Math.max(this.arrays["mark.width"][k] / 100, 0.7 * pixel);
      context.beginPath();
      this.marks.trace(context, k);
      context.stroke();
    }
    context.setLineDash([]);
  }

  paintScenery(context, box, scale) {
    for (const [name, shapes] of this.solids) {
      if (name === "pole" && scale < 2) continue;
      this.fill(context, shapes, box, this.palette[name]);
      if (name !== "building" || scale < 1) continue;
      context.strokeStyle = this.palette.buildingEdge;
      context.lineWidth = 1 / scale;
      context.stroke();
    }
  }
}

/** Box of the world that the view shows [m]. */
export function visible(view) {
  const corners = [[0, 0], [view.width, 0], [0, view.height], [view.width, view.height]].map(([x, y]) => view.toWorld(x, y));
  const xs = corners.map((p) => p[0]);
  const ys = corners.map((p) => p[1]);
  return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
}
