// What the sensors saw: the cameras as a film of few pictures a second, and the LiDAR's points from above.

import { lastBefore, starts } from "./drive.js";

export class Panes {
  constructor(drive) {
    this.drive = drive;
    const { panes } = drive.meta;
    document.getElementById("panes").hidden = !panes;
    if (!panes) return;
    if (panes.film) this.addFilm(panes.film);
    if (panes.lidar) {
      this.canvas = document.getElementById("pane-lidar");
      this.canvas.hidden = false;
      this.first = starts(drive.arrays["pane.lidar.n"]);
    }
  }

  addFilm({ label }) {
    this.film = document.createElement("canvas");
    this.film.setAttribute("role", "img");
    this.film.setAttribute("aria-label", label);
    this.pictures = starts(this.drive.arrays["pane.film.n"]);
    this.shown = -1;
    document.getElementById("pane-film").append(this.film);
  }

  /** Decodes the picture of `frame`; one at a time, and the newest wish next. */
  async showPicture(frame) {
    this.wanted = frame;
    if (this.isDecoding) return;
    this.isDecoding = true;
    while (this.shown !== this.wanted) {
      const next = this.wanted;
      const bytes = this.drive.arrays["pane.film"].subarray(this.pictures[next], this.pictures[next + 1]);
      const picture = await createImageBitmap(new Blob([bytes], { type: this.drive.meta.panes.film.type }));
      this.film.width = picture.width;
      this.film.height = picture.height;
      this.film.getContext("2d").drawImage(picture, 0, 0);
      picture.close();
      this.shown = next;
    }
    this.isDecoding = false;
  }

  draw(moment) {
    const { panes } = this.drive.meta;
    if (!panes) return;
    const frame = Math.max(lastBefore(this.drive.arrays["pane.at"], Math.floor(moment + 1e-6)), 0);
    if (this.film && frame !== this.wanted) this.showPicture(frame);
    if (this.canvas && frame !== this.swept) {
      this.swept = frame;
      this.drawLidar(frame, panes.lidar);
    }
  }

  drawLidar(frame, { reach }) {
    const { "pane.lidar.x": ahead, "pane.lidar.y": aside, "pane.lidar.z": height } = this.drive.arrays;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.round(this.canvas.clientWidth * ratio);
    const tall = Math.round(this.canvas.clientHeight * ratio);
    this.canvas.width = width;
    this.canvas.height = tall;
    const context = this.canvas.getContext("2d");
    const scale = Math.max(width, tall) / (2 * reach);
    for (let i = this.first[frame]; i < this.first[frame + 1]; i++) {
      const share = Math.min(Math.max((height[i] / 10 + 2.6) / 5, 0), 1);
      context.fillStyle = `hsl(${Math.round((1 - share) * 230)} 80% 60%)`;
      context.fillRect(width / 2 + (aside[i] / 10) * scale, tall / 2 - (ahead[i] / 10) * scale, ratio * 1.4, ratio * 1.4);
    }
    context.fillStyle = "#ffffff";
    context.fillRect(width / 2 - scale, tall / 2 - 2.4 * scale, 2 * scale, 4.8 * scale);
  }
}
