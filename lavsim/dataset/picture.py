"""Pictures of frames with their labels: the cameras, the LiDAR and the BEV as they were stored, boxes drawn on them.

Everything comes from the dataset, nothing from the simulator: boxes sit on cars only if images, points, poses, sizes
and mounts all mean what the dataset says they mean.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.boxes import HIDDEN_BGR, Boxes, camera_pose, projected_edges
from lavsim.dataset.charts import write_output
from lavsim.dataset.columns import WEATHER
from lavsim.dataset.reader import Dataset
from lavsim.dataset.schema import BLOB, DatasetInfo, FieldSpec
from lavsim.dataset.stats import COMMANDS
from lavsim.errors import DatasetError
from lavsim.geometry import box_corners
from lavsim.random import Draws
from lavsim.render.camera_view import CameraView
from lavsim.render.canvas import Canvas, encode_png, height_colours, write_text
from lavsim.render.frame import rotation
from lavsim.render.palette import EGO_BGR, INK_BGR, PAPER_BGR, ROUTE_BGR, Bgr
from lavsim.sensors.base import Sensor, make_sensor
from lavsim.sensors.bev import Bev, ego_column, ego_row
from lavsim.sensors.camera import ColourCamera, TagCamera
from lavsim.sensors.lidar import Lidar

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]

_WIDTH, _PANEL, _WIDE = 640, 200, 240  # [px] of a frame at scale 1; of the two maps; of a camera that is no wide one
_GAP, _LINE = 3, 16  # [px]
_LIDAR_METRES = 80.0
_DARK = 70.0  # mean level of an image of the night
_LIGHTENED = np.rint(255.0 * (np.arange(256) / 255.0) ** 0.45).astype(np.uint8)
_FEW = 12  # pixels or points: fewer count as hardly seen

_LAYER_BGR: dict[str, Bgr] = {
    "road": (96, 92, 90), "crosswalk": (130, 130, 130), "solid": (240, 240, 240), "broken": (120, 220, 240),
    "stop": (200, 60, 200), "red": (50, 50, 230), "yellow": (40, 190, 250), "green": (70, 200, 60),
    "vehicle": (220, 130, 40), "walker": (80, 160, 255), "pedestrian": (60, 40, 255),
}  # fmt: skip


class FramePainter:
    """Draws frames of a dataset.

    Args:
        dataset: It may lack blobs: they are rendered from its logs then.
        bright: Whether images of the night are lightened.

    Raises:
        DatasetError: it has no tables, or nothing that could be drawn.
    """

    def __init__(self, dataset: Dataset, bright: bool = False) -> None:
        if not dataset.info.columns:
            raise DatasetError(f"{dataset.root.name} holds logs alone; make its tables with: lavsim render.")
        self._dataset = dataset
        self._views = [_View(field, sensor, dataset.info, bright) for field, sensor in _sensors(dataset.info)]
        self._views = [view for view in self._views if view.is_drawn]
        if not self._views:
            raise DatasetError(f"{dataset.root.name} has no camera, LiDAR or BEV to draw.")

    def draw(self, episode: int, frame: int, scale: int = 1) -> Image:
        """(H, W, 3) blue, green, red: all views of a frame, 640 px wide at scale 1."""
        names = [field.name for field in self._dataset.info.columns]
        row = self._dataset.read(episode, frame, [*names, *(view.field.name for view in self._views)])
        boxes = Boxes.of(row)
        pictures = [view.draw(row, boxes, scale) for view in self._views]
        town = self._dataset.episodes[episode].town
        return _arranged(pictures, _caption(row, f"{town} {episode}/{frame}"), scale)


def show_frames(
    data: Path,
    picture: Path,
    count: int = 24,
    seed: int = 0,
    place: tuple[int, int] | None = None,
    bright: bool = False,
    town_path: Sequence[Path] = (),
    watch: Callable[[float], None] | None = None,
) -> None:
    """Writes a picture of frames of a dataset: a sheet of `count` drawn by `seed`, or the one at `place`, larger.

    Raises:
        DatasetError: it has no such frame, nothing to draw, or is damaged.
        OutputError: the picture can't be written.
    """
    dataset = Dataset(data, town_path)
    if place is None:
        image = draw_sheet(FramePainter(dataset, bright), random_frames(dataset, count, seed), watch=watch)
    else:
        try:
            image = FramePainter(dataset, bright).draw(*place, scale=2)
        except IndexError as error:
            raise DatasetError(f"{data}: no frame {place[1]}: {error}.") from None
    write_output(picture, encode_png(image))


def draw_sheet(
    painter: FramePainter,
    frames: Sequence[tuple[int, int]],
    columns: int = 4,
    watch: Callable[[float], None] | None = None,
) -> Image:
    """(H, W, 3) blue, green, red: many frames (episode, frame) in a grid."""
    cells = []
    for number, (episode, frame) in enumerate(frames):
        cells.append(painter.draw(episode, frame))
        if watch is not None:
            watch((number + 1) / len(frames))
    columns = min(columns, len(cells))
    high, wide = max(cell.shape[0] for cell in cells), max(cell.shape[1] for cell in cells)
    rows = -(-len(cells) // columns)
    sheet = _paper(rows * (high + 2 * _GAP), columns * (wide + 2 * _GAP))
    for k, cell in enumerate(cells):
        top, left = (k // columns) * (high + 2 * _GAP), (k % columns) * (wide + 2 * _GAP)
        sheet[top : top + cell.shape[0], left : left + cell.shape[1]] = cell
    return sheet


def random_frames(dataset: Dataset, count: int, seed: int) -> list[tuple[int, int]]:
    """Episode and frame of `count` frames drawn by `seed`, each once, in order; all if there are fewer.

    Raises:
        DatasetError: the dataset has no frame.
    """
    if not len(dataset):
        raise DatasetError(f"{dataset.root.name} has no frame.")
    chosen = Draws.of_seed(seed).stream("contact sheet").permutation(0, len(dataset))[:count]
    return [dataset.locate(int(index)) for index in np.sort(chosen)]


class _View:
    """One sensor of the suite and how its reading is drawn."""

    def __init__(self, field: FieldSpec, sensor: Sensor, info: DatasetInfo, bright: bool) -> None:
        self.field, self._sensor, self._info, self._bright = field, sensor, info, bright

    @property
    def is_drawn(self) -> bool:
        return isinstance(self._sensor, ColourCamera | Lidar | Bev)

    def draw(self, row: Mapping[str, Any], boxes: Boxes, scale: int) -> Image:
        if isinstance(self._sensor, ColourCamera):
            return self._camera(self._sensor.view, row, boxes, scale)
        if isinstance(self._sensor, Bev):
            return self._bev(self._sensor, row, boxes, scale)
        return self._lidar(row, boxes, scale)

    def _camera(self, view: CameraView, row: Mapping[str, Any], boxes: Boxes, scale: int) -> Image:
        image = cv2.cvtColor(row[self.field.name], cv2.COLOR_RGB2BGR)
        if self._bright and image.mean() < _DARK:
            image = cv2.LUT(image, _LIGHTENED)
        # Five wide cameras fill a row; the telephoto is as wide as a map and a bit.
        wide = (_WIDTH // 5 if view.width <= view.height else _WIDE) * scale
        factor = wide / view.width
        image = cv2.resize(image, (wide, round(view.height * factor)), interpolation=cv2.INTER_AREA)
        pose = camera_pose(view, row)
        counts = row["actor_pixels"][:, self._pixels] if self._pixels is not None and "actor_pixels" in row else None
        for k in np.argsort(-np.linalg.norm(boxes.corners.mean(axis=1) - pose.origin, axis=1)):
            is_seen = counts is None or counts[boxes.row[k]] >= _FEW
            colour = boxes.colours[k] if is_seen else HIDDEN_BGR
            for begin, end in projected_edges(view, pose.to_sensor(boxes.corners[k]), factor):
                cv2.line(image, begin, end, colour, 1, cv2.LINE_AA, 4)
        return np.asarray(image)

    @cached_property
    def _pixels(self) -> int | None:
        """Column of `actor_pixels` for this camera: that of the tag camera on the same mount."""
        assert isinstance(self._sensor, ColourCamera)
        tags = [sensor for _, sensor in _sensors(self._info) if isinstance(sensor, TagCamera)]
        same = [k for k, tag in enumerate(tags) if tag.view == self._sensor.view]
        return same[0] if same else None

    def _lidar(self, row: Mapping[str, Any], boxes: Boxes, scale: int) -> Image:
        """From above in the ego's frame, heading up: this tick's points in colour, the last's dimmer."""
        side, mount = _PANEL * scale, self._sensor.config.mount
        canvas = Canvas.facing(0.0, 0.0, 0.0, (side, side), side / _LIDAR_METRES, 0.62, (24, 22, 20))
        points = row[self.field.name].astype(np.float64)
        placed = points[:, :3] @ rotation(mount.roll, mount.pitch, mount.yaw).T + np.array([mount.x, mount.y, mount.z])
        colours = height_colours(placed[:, 2], -1.5, 6.0)
        now = int(row.get("lidar_now", len(points)))
        canvas.dots(placed[now:, :2], colours[now:] // 2)
        canvas.dots(placed[:now, :2], colours[:now])
        hits = row.get("actor_lidar_hits")
        _draw_labels(canvas, row, boxes, hits, scale)
        return canvas.image

    def _bev(self, sensor: Bev, row: Mapping[str, Any], boxes: Boxes, scale: int) -> Image:
        config, layers = sensor.config, row[self.field.name]
        picture = np.full((config.height, config.width, 3), 34, np.uint8)
        for name in _LAYER_BGR:
            if name in config.names:
                picture[layers[config.names.index(name)] > 0] = _LAYER_BGR[name]
        wide = _PANEL * scale
        factor = wide / config.width
        picture = cv2.resize(picture, (wide, round(config.height * factor)), interpolation=cv2.INTER_AREA)
        metre = config.pixels_per_metre * factor
        place = np.array([[0.0, metre, ego_column(config) * factor], [-metre, 0.0, ego_row(config) * factor]])
        canvas = Canvas(np.ascontiguousarray(picture), place)
        _draw_labels(canvas, row, boxes, None, scale)
        return canvas.image


def _draw_labels(
    canvas: Canvas, row: Mapping[str, Any], boxes: Boxes, hits: NDArray[np.int32] | None, scale: int
) -> None:
    """Boxes, the ego, its route and goal on a picture whose world is the ego's frame."""
    for k, outline in enumerate(boxes.outlines):
        is_seen = hits is None or hits[boxes.row[k]] > 0
        canvas.outline(outline, boxes.colours[k] if is_seen else HIDDEN_BGR)
    ego = row["actor_size"][0].astype(np.float64)
    canvas.outline(box_corners([0.0], [0.0], [0.0], ego[:1], ego[1:2])[0], EGO_BGR)
    if "route" in row:
        canvas.outline(row["route"], ROUTE_BGR, 1, closed=False)
    if "goal" in row:
        canvas.disc(row["goal"].tolist(), 2.0 * scale, ROUTE_BGR, INK_BGR)


def _sensors(info: DatasetInfo) -> list[tuple[FieldSpec, Sensor]]:
    """Sensors of the suite that have a field, in order."""
    fields = {field.name: field for field in info.fields if field.place == BLOB}
    sensors = [make_sensor(values) for values in info.record.suite]
    return [(fields[s.config.id.lower()], s) for s in sensors if s.config.id.lower() in fields]


def _arranged(pictures: Sequence[Image], caption: Sequence[str], scale: int) -> Image:
    """The pictures in rows of the usual width, the caption above."""
    width = _WIDTH * scale + 4 * _GAP
    rows: list[list[Image]] = [[]]
    for picture in pictures:
        used = sum(one.shape[1] + _GAP for one in rows[-1])
        if rows[-1] and used + picture.shape[1] > width:
            rows.append([])
        rows[-1].append(picture)
    line = _LINE * scale
    head = line * len(caption) + _GAP
    sheet = _paper(head + sum(max(one.shape[0] for one in row) + _GAP for row in rows), width)
    for k, text in enumerate(caption):
        write_text(sheet, text, (_GAP, line * (k + 1) - 4 * scale), 0.38 * scale)
    top = head
    for row in rows:
        left = 0
        for picture in row:
            sheet[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
            left += picture.shape[1] + _GAP
        top += max(one.shape[0] for one in row) + _GAP
    return sheet


def _caption(row: Mapping[str, Any], name: str) -> list[str]:
    """What the frame says in words."""
    texts = [f"{name}  tick {int(row['tick'])}  {float(row['speed']) * 3.6:.0f} km/h"]
    second = []
    if "command" in row:
        texts.append(COMMANDS.get(int(row["command"]), "no command"))
    if "control" in row:
        throttle, steer, brake = row["control"][:3]
        second.append(f"throttle {throttle:.2f}  steer {steer:+.2f}  brake {brake:.2f}")
    if row.get("brake"):
        second.append(f"stops for {row.get('brake_cause', '?')}")
    if "target_speed" in row and np.isfinite(row["target_speed"]):
        second.append(f"wants {float(row['target_speed']) * 3.6:.0f} km/h")
    if "weather" in row:
        weather = dict(zip(WEATHER, row["weather"].tolist(), strict=True))
        texts.append(f"sun {weather['sun_altitude_angle']:.0f} deg  rain {weather['precipitation']:.0f} %")
    others = len(row["actor_id"]) - 1
    second.append(f"{others} actors within reach")
    return ["   ".join(texts), "   ".join(second)]


def _paper(height: int, width: int) -> Image:
    return np.full((height, width, 3), PAPER_BGR, np.uint8)
