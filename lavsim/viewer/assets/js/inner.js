// What the agent published: points, boxes, polylines, rasters on the map, and scalars beside it.

import { lastBefore, starts } from "./drive.js";

const HOLD = 12; // ticks that a drawing is shown after it was published

export class Inner {
  constructor(drive) {
    this.items = drive.meta.drawings.map((entry, k) => new Item(entry, drive.arrays, `inner.${k}`));
    this.names = [...new Set(this.items.filter((item) => item.kind !== "scalar").map((item) => item.name))];
  }

  draw(context, view, moment, isShown, palette) {
    const [a, b, c, d, e, f] = view.matrix();
    const r = view.ratio;
    for (const item of this.items) {
      if (item.kind === "scalar" || !isShown(item.name)) continue;
      const frame = item.frame(moment);
      if (frame < 0) continue;
      context.setTransform(a * r, b * r, c * r, d * r, e * r, f * r);
      context.strokeStyle = context.fillStyle = palette[item.name] || palette.inner;
      item.draw(context, view, frame);
      context.globalAlpha = 1;
    }
  }

  /** Writes the boxes' labels; called when everything else is drawn. */
  drawLabels(context, view, moment, isShown, palette) {
    if (view.scale < 3) return;
    context.setTransform(view.ratio, 0, 0, view.ratio, 0, 0);
    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "center";
    context.lineWidth = 4;
    context.lineJoin = "round";
    context.strokeStyle = palette.halo;
    for (const item of this.items) {
      const frame = item.kind === "boxes" && isShown(item.name) ? item.frame(moment) : -1;
      if (frame < 0) continue;
      context.fillStyle = palette[item.name] || palette.inner;
      for (let i = item.first[frame]; i < item.first[frame + 1]; i++) {
        if (item.label[i] < 0) continue;
        const [x, y] = view.toScreen(item.x[i] / 100, item.y[i] / 100);
        context.strokeText(item.labels[item.label[i]], x, y - 18);
        context.fillText(item.labels[item.label[i]], x, y - 18);
      }
    }
  }

  /** [name, value, unit] of the scalars at a moment. */
  scalars(moment) {
    return this.items.filter((item) => item.kind === "scalar" && item.frame(moment) >= 0)
      .map((item) => [item.name, item.value[item.frame(moment)] / 1000, item.unit]);
  }
}

class Item {
  constructor(entry, arrays, key) {
    Object.assign(this, entry);
    this.at = arrays[`${key}.at`];
    for (const part of ["n", "count", "x", "y", "yaw", "length", "width", "likelihood", "label", "value", "shape", "data"]) {
      this[part] = arrays[`${key}.${part}`];
    }
    if (this.n) this.first = starts(this.n);
    if (this.count) this.begin = starts(this.count);
    if (this.kind === "raster") this.places = rasterPlaces(this.shape);
    this.pictures = new Map();
  }

  /** Number of the drawing that is up at a moment; -1 if none is. */
  frame(moment) {
    const k = lastBefore(this.at, Math.floor(moment + 1e-6));
    return k >= 0 && moment - this.at[k] <= HOLD ? k : -1;
  }

  draw(context, view, frame) {
    const pixel = 1 / view.scale;
    if (this.kind === "raster") return this.drawRaster(context, frame);
    for (let i = this.first[frame]; i < this.first[frame + 1]; i++) {
      context.globalAlpha = 0.15 + 0.85 * (this.likelihood[i] / 255);
      if (this.kind === "polylines") this.drawLine(context, i, pixel);
      else if (this.kind === "boxes") this.drawBox(context, i, pixel);
      else {
        const size = Math.max(0.25, 3 * pixel);
        context.fillRect(this.x[i] / 100 - size / 2, this.y[i] / 100 - size / 2, size, size);
      }
    }
    return undefined;
  }

  drawLine(context, i, pixel) {
    context.beginPath();
    for (let p = this.begin[i]; p < this.begin[i + 1]; p++) context.lineTo(this.x[p] / 100, this.y[p] / 100);
    context.lineWidth = Math.max(0.22, 1.8 * pixel);
    context.lineJoin = context.lineCap = "round";
    context.stroke();
  }

  drawBox(context, i, pixel) {
    const yaw = this.yaw[i] / 1000;
    context.save();
    context.translate(this.x[i] / 100, this.y[i] / 100);
    context.rotate(yaw);
    context.lineWidth = Math.max(0.25, 2 * pixel);
    context.strokeRect(-this.length[i] / 200 - 0.25, -this.width[i] / 200 - 0.25, this.length[i] / 100 + 0.5, this.width[i] / 100 + 0.5);
    context.restore();
  }

  drawRaster(context, frame) {
    const { rows, columns, cell, offset } = this.places[frame];
    let picture = this.pictures.get(frame);
    if (!picture) {
      picture = rasterPicture(this.data, offset, rows, columns, context.fillStyle);
      if (this.pictures.size > 20) this.pictures.clear();
      this.pictures.set(frame, picture);
    }
    context.save();
    context.translate(this.x[frame] / 100, this.y[frame] / 100);
    context.rotate(this.yaw[frame] / 1000 + Math.PI / 2); // row 0 lies ahead, columns to the right
    context.imageSmoothingEnabled = false;
    context.drawImage(picture, (-columns * cell) / 2, (-rows * cell) / 2, columns * cell, rows * cell);
    context.restore();
  }
}

function rasterPlaces(shape) {
  const places = [];
  let offset = 0;
  for (let k = 0; k < shape.length; k += 3) {
    places.push({ rows: shape[k], columns: shape[k + 1], cell: shape[k + 2] / 1000, offset });
    offset += shape[k] * shape[k + 1];
  }
  return places;
}

function rasterPicture(data, offset, rows, columns, colour) {
  const canvas = document.createElement("canvas");
  canvas.width = columns;
  canvas.height = rows;
  const context = canvas.getContext("2d");
  context.fillStyle = colour;
  context.fillRect(0, 0, columns, rows);
  const image = context.getImageData(0, 0, columns, rows);
  for (let i = 0; i < rows * columns; i++) image.data[4 * i + 3] = data[offset + i] * 0.8;
  context.putImageData(image, 0, 0);
  return canvas;
}
