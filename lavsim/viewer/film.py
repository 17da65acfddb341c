"""Films, film strips and contact sheets of recorded drives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lavsim.drawings import Drawing
from lavsim.errors import OutputError
from lavsim.geometry import box_corners, to_world
from lavsim.render.birdseye import draw_snapshot
from lavsim.render.canvas import Canvas, write_png, write_text
from lavsim.render.palette import PAPER_BGR, Bgr
from lavsim.render.scene import Scene, get_scene
from lavsim.render.sheet import draw_sweep
from lavsim.render.video import VideoWriter
from lavsim.sensors.base import SensorSuite
from lavsim.sensors.suites import find_suite
from lavsim.types import DT
from lavsim.viewer.inner import InnerView
from lavsim.viewer.panes import joined_cameras
from lavsim.world.snapshot import Snapshot

if TYPE_CHECKING:
    from lavsim.map.town_map import TownMap
    from lavsim.random import Draws

_GAP, _LABEL = 6, 22  # [px]
_COLOURS: Mapping[str, Bgr] = {"plan": (67, 128, 11), "forecast": (206, 48, 132)}
_OTHER: Bgr = (91, 24, 194)  # of drawings with another name


class Snapshots(Protocol):
    """Ticks by number: a list, or a log reader."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> Snapshot: ...


@dataclass(frozen=True, eq=False)
class Footage:
    """A recorded drive and what is needed to picture it.

    Attributes:
        snapshots: All ticks.
        town: Where.
        draws: Root of the drive's draws.
        route: (R, 3) points of the route [m].
        inner: What the agent published.
    """

    snapshots: Snapshots
    town: TownMap
    draws: Draws
    route: NDArray[np.float64]
    inner: InnerView | None = None

    def index_at(self, time: float) -> int:
        """Number of the snapshot at simulation time `time` [s], or the nearest there is."""
        if not len(self.snapshots):
            raise OutputError("the drive holds no tick to draw.")
        return min(max(round(time / DT) - self.snapshots[0].tick, 0), len(self.snapshots) - 1)


@dataclass(frozen=True)
class Cut:
    """Which piece of a drive is filmed, and how.

    Attributes:
        begin, end: Simulation time [s]; None: the drive's own.
        rate: Pictures a second.
        speed: Of the film; 2 is twice as fast as the drive.
        size: Width, height of the view from above [px].
        metres: Width of the piece of world in it.
        panes: Whether the cameras and the LiDAR are shown below.
    """

    begin: float | None = None
    end: float | None = None
    rate: float = 10.0
    speed: float = 1.0
    size: tuple[int, int] = (720, 540)
    metres: float = 80.0
    panes: bool = False


def write_film(footage: Footage, path: Path, cut: Cut, progress: Callable[[float], None] | None = None) -> None:
    """Films a drive to `path` (*.mp4, *.webm, *.gif).

    Raises:
        OutputError: there is nothing to film, or the file can't be written.
    """
    first = footage.index_at(cut.begin if cut.begin is not None else 0.0)
    last = footage.index_at(cut.end) if cut.end is not None else len(footage.snapshots) - 1
    step = cut.speed / (cut.rate * DT)
    indices = np.unique(np.rint(np.arange(first, last + 0.5, step)).astype(int))
    camera = _Camera(footage, cut)
    with VideoWriter(path, cut.rate) as film:
        for number, index in enumerate(indices.tolist()):
            film.add(camera.picture(index))
            if progress is not None:
                progress((number + 1) / len(indices))


def write_strip(footage: Footage, path: Path, time: float) -> None:
    """Writes a film strip as PNG; see `draw_strip`."""
    write_png(draw_strip(footage, time), path)


def draw_strip(footage: Footage, time: float, count: int = 6, spacing: float = 0.5) -> NDArray[np.uint8]:
    """A film strip: `count` pictures `spacing` seconds apart, the moment `time` at two thirds of them."""
    before = (2 * count) // 3
    cut = Cut(size=(320, 320), metres=50.0)
    camera = _Camera(footage, cut)
    indices = [footage.index_at(time + (k - before) * spacing) for k in range(count)]
    return _side_by_side([camera.picture(index) for index in indices])


class _Camera:
    """Takes the pictures of a drive."""

    def __init__(self, footage: Footage, cut: Cut) -> None:
        self._footage, self._cut = footage, cut
        self._scene: Scene = get_scene(footage.town)
        cameras = [dict(s) for s in find_suite("lav") if s["type"] == "sensor.camera.rgb"] if cut.panes else []
        self._suite = SensorSuite(self._scene, cameras, footage.draws)

    def picture(self, index: int) -> NDArray[np.uint8]:
        """(H, W, 3) blue, green, red."""
        snapshot, cut = self._footage.snapshots[index], self._cut
        canvas = draw_snapshot(self._scene, snapshot, cut.size, cut.metres, self._footage.route)
        if self._footage.inner is not None:
            draw_inner(canvas, self._footage.inner.at(snapshot.tick), snapshot)
        _caption(canvas.image, snapshot)
        return self._with_panes(canvas.image, index) if cut.panes else canvas.image

    def _with_panes(self, above: NDArray[np.uint8], index: int) -> NDArray[np.uint8]:
        snapshots = self._footage.snapshots
        recent = [snapshots[k] for k in range(max(0, index - max(self._suite.history, 1)), index + 1)]
        readings: Mapping[str, Any] = self._suite.read(recent[-1 - self._suite.history :])
        sweep = draw_sweep(self._scene, recent[-2:], (above.shape[0], above.shape[0])).image
        both = np.concatenate([above, sweep], axis=1)
        cameras = joined_cameras([data for _, data in readings.values()], both.shape[1], len(readings))
        return np.concatenate([both, cameras])


def draw_inner(canvas: Canvas, drawings: Mapping[str, Drawing], snapshot: Snapshot) -> None:
    """Draws what an agent published over a picture; grids and numbers are left to the replay."""
    for name, drawing in drawings.items():
        kind = drawing["kind"]
        if kind in ("scalar", "raster"):
            continue
        colour = _COLOURS.get(name, _OTHER)
        if kind == "boxes":
            poses = _world_poses(drawing, snapshot)
            x, y, yaw, length, width = poses.T
            for corners in box_corners(x, y, yaw, length + 0.5, width + 0.5):
                canvas.outline(corners, colour, 2)
            continue
        xy = _world(np.asarray(drawing["xy"], np.float64), drawing, snapshot)
        if kind == "points":
            for point in xy.tolist():
                canvas.disc(point, 2.0, colour)
            continue
        likely = np.asarray(drawing["likelihood"]).tolist()
        for line, share in zip(np.split(xy, np.cumsum(drawing["count"])[:-1]), likely, strict=False):
            if len(line) > 1:
                canvas.outline(line, _faded(colour, share), 2, closed=False)


def _world(xy: NDArray[np.float64], drawing: Drawing, snapshot: Snapshot) -> NDArray[np.float64]:
    ego = snapshot.ego
    return to_world(xy, (ego.x, ego.y), ego.yaw) if drawing["frame"] == "ego" else xy


def _world_poses(drawing: Drawing, snapshot: Snapshot) -> NDArray[np.float64]:
    poses = np.asarray(drawing["poses"], np.float64).copy()
    poses[:, :2] = _world(poses[:, :2], drawing, snapshot)
    poses[:, 2] += snapshot.ego.yaw if drawing["frame"] == "ego" else 0.0
    return poses


def _faded(colour: Bgr, share: float) -> Bgr:
    blue, green, red = (round(200 + (value - 200) * (0.2 + 0.8 * share)) for value in colour)
    return blue, green, red


def _caption(image: NDArray[np.uint8], snapshot: Snapshot) -> None:
    """Time and speed on a strip of paper along the top."""
    image[:_LABEL] = PAPER_BGR
    text = f"t {snapshot.time:.2f} s   {snapshot.ego.forward_speed * 3.6:.0f} km/h"
    write_text(image, text, (_GAP, 16))


def _side_by_side(pictures: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    height, width = pictures[0].shape[:2]
    strip = np.empty((height + 2 * _GAP, len(pictures) * (width + _GAP) + _GAP, 3), np.uint8)
    strip[:] = PAPER_BGR
    for k, picture in enumerate(pictures):
        left = _GAP + k * (width + _GAP)
        strip[_GAP : _GAP + height, left : left + width] = picture
    return strip
