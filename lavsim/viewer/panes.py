"""What the sensors saw in a drive, for the page: the cameras side by side, and the LiDAR's points from above.

The cameras are a film of single WebP pictures: half as large as what OpenCV's film encoders make of them, and any of
them is there at once when somebody scrubs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import to_local, to_world
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.sensors.suites import find_suite
from lavsim.types import DT
from lavsim.viewer.pack import Pack
from lavsim.viewer.tracks import Tracks
from lavsim.world.snapshot import Snapshot

if TYPE_CHECKING:
    from lavsim.map.town_map import TownMap
    from lavsim.random import Draws

RATE = 4  # pictures a second
STEP = round(1.0 / (RATE * DT))  # ticks between pictures
MOST_POINTS = 1500  # of a sweep
REACH = 45.0  # [m] around the ego that is shown
FILM_WIDTH = 560  # [px] of the cameras side by side
QUALITY = 42  # of WebP
_CAMERA, _LIDAR = "sensor.camera.rgb", "sensor.lidar.ray_cast"


@dataclass(frozen=True)
class Panes:
    """Sensor data at every `STEP`th tick.

    Attributes:
        film: WebP pictures of all cameras; empty if there is no camera.
        label: What the film shows.
        sweeps: (N, 3) points ahead, right, up of the ego [m] for each picture; empty if there is no LiDAR.
        at: Index of the tick of each picture.
    """

    film: list[bytes]
    label: str
    sweeps: list[NDArray[np.float32]]
    at: list[int]

    def add(self, pack: Pack, tracks: Tracks) -> dict[str, Any]:
        """Adds the data to `pack`; what there is."""
        pack.add("pane.at", self.at, 1)
        entry: dict[str, Any] = {"rate": RATE, "film": None, "lidar": None}
        if self.film:
            pack.add("pane.film.n", [len(picture) for picture in self.film])
            pack.add_bytes("pane.film", b"".join(self.film))
            entry["film"] = {"type": "image/webp", "label": self.label}
        if self.sweeps:
            pack.add("pane.lidar.n", [len(sweep) for sweep in self.sweeps])
            points = np.concatenate(self.sweeps).astype(np.float64)
            for column, name in enumerate("xyz"):
                pack.add(f"pane.lidar.{name}", np.rint(points[:, column] * 10.0), 1, "pane.lidar.n")
            entry["lidar"] = {"reach": REACH}
        return entry


def render_panes(
    town: TownMap,
    snapshots: Sequence[Snapshot],
    draws: Draws,
    suite_name: str = "lav",
    progress: Callable[[float], None] | None = None,
) -> Panes:
    """Renders the cameras and the LiDAR of a suite at every `STEP`th tick.

    Args:
        town: Where.
        snapshots: All ticks of the drive.
        draws: Root of its draws: the readings are those of the drive.
        suite_name: Which sensors.
        progress: Told the share done.
    """
    wanted = [dict(sensor) for sensor in find_suite(suite_name) if sensor["type"] in (_CAMERA, _LIDAR)]
    cameras = [sensor for sensor in wanted if sensor["type"] == _CAMERA]
    suite = SensorSuite(get_scene(town), wanted, draws)
    lidar = next((sensor for sensor in wanted if sensor["type"] == _LIDAR), None)
    turning = SensorSuite(get_scene(town), [lidar] if lidar is not None else [], draws)
    at = list(range(0, len(snapshots), STEP))
    film: list[bytes] = []
    sweeps: list[NDArray[np.float32]] = []
    for number, index in enumerate(at):
        readings = suite.read(snapshots[max(0, index - suite.history) : index + 1])
        if cameras:
            film.append(_webp(joined_cameras([readings[sensor["id"]][1] for sensor in cameras], FILM_WIDTH)))
        if lidar is not None:
            sweeps.append(_sweep(turning, snapshots, index, readings[lidar["id"]][1], lidar))
        if progress is not None:
            progress((number + 1) / len(at))
    return Panes(film, "Cameras: " + ", ".join(sensor["id"] for sensor in cameras), sweeps, at)


def _webp(picture: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1].tobytes()


def joined_cameras(pictures: Sequence[NDArray[np.uint8]], width: int, most: int = 3) -> NDArray[np.uint8]:
    """Pictures (H, W, 3 or 4) in rows of at most `most`, each row `width` [px] wide."""
    rows = [pictures[k : k + most] for k in range(0, len(pictures), most)]
    return np.concatenate([_row([p[..., :3] for p in row], width) for row in rows])


def _row(pictures: Sequence[NDArray[np.uint8]], width: int) -> NDArray[np.uint8]:
    """Pictures side by side, as high as makes them fill `width`."""
    shares = [picture.shape[1] / picture.shape[0] for picture in pictures]
    height = 2 * round(width / sum(shares) / 2.0)
    widths = [round(height * share) for share in shares]
    widths[-1] += width - sum(widths)
    sized = [cv2.resize(p, (w, height), interpolation=cv2.INTER_AREA) for p, w in zip(pictures, widths, strict=True)]
    return np.concatenate(sized, axis=1).astype(np.uint8)


def _sweep(
    suite: SensorSuite,
    snapshots: Sequence[Snapshot],
    index: int,
    newest: NDArray[np.float32],
    lidar: Mapping[str, Any],
) -> NDArray[np.float32]:
    """Points of the last whole turn in the ego's frame: this tick's half and the one before."""
    mount = np.array([lidar.get(key, 0.0) for key in "xyz"])
    points = np.asarray(newest, np.float64)[:, :3] + mount
    if index > 0:
        before = snapshots[max(0, index - 1 - suite.history) : index]
        half = np.asarray(suite.read(before)[lidar["id"]][1], np.float64)[:, :3] + mount
        then, now = before[-1].ego, snapshots[index].ego
        half[:, :2] = to_local(to_world(half[:, :2], (then.x, then.y), then.yaw), (now.x, now.y), now.yaw)
        points = np.concatenate([points, half])
    points = points[(np.abs(points[:, :2]) < REACH).all(axis=1)]
    return points[:: max(1, -(-len(points) // MOST_POINTS))].astype(np.float32)
