"""LiDAR returns as an image from above, for agents that want one: how many lie in each cell and height bin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.random import Draws
from lavsim.render.frame import rotation
from lavsim.render.scene import Scene
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor, attribute
from lavsim.sensors.lidar import Lidar, LidarConfig
from lavsim.world.snapshot import Snapshot

LARGEST = 4096  # [px] a side
MOST_BINS = 64


@dataclass(frozen=True)
class LidarRasterConfig(LidarConfig):
    """Place and size of the image; the LiDAR's own attributes too, except that a tick gives a whole turn by default.

    Attributes:
        ahead, behind, side: What the image shows, from the ego's origin [m]; `side` to either hand.
        pixels_per_metre: Cells a metre.
        low, high: Heights above the ego's ground that are counted [m].
        bins: Layers between them, of equal thickness.
    """

    ahead: float = 70.0
    behind: float = 10.0
    side: float = 40.0
    pixels_per_metre: float = 4.0
    low: float = -0.5
    high: float = 3.5
    bins: int = 4
    full_sweep: bool = attribute("full_sweep", True)

    def problem(self) -> str | None:
        if self.pixels_per_metre <= 0.0:
            return f"'pixels_per_metre' must be positive, got {self.pixels_per_metre:g}"
        if not (1 <= self.rows <= LARGEST and 1 <= self.columns <= LARGEST):
            return f"the image must have 1 to {LARGEST} pixels a side, got {self.columns} x {self.rows}"
        if not 1 <= self.bins <= MOST_BINS:
            return f"'bins' must be 1 to {MOST_BINS}, got {self.bins}"
        if self.low >= self.high:
            return f"'low' must be below 'high', got {self.low:g} and {self.high:g}"
        if self.motion:
            return "'motion' is for point clouds; an image shows one moment"
        return super().problem()

    @property
    def rows(self) -> int:
        return round((self.ahead + self.behind) * self.pixels_per_metre)

    @property
    def columns(self) -> int:
        return round(2.0 * self.side * self.pixels_per_metre)


@SENSORS.register("sensor.lavsim.lidar_raster")
class LidarRaster(Sensor):
    """Returns from above: row 0 lies ahead, columns run to the right, in the ego's frame.

    "histogram" counts the returns of each cell and height bin (lowest bin first), up to 255; "occupancy" is 1 where a
    cell has any return between `low` and `high`.
    """

    config_type = LidarRasterConfig
    config: LidarRasterConfig

    def __init__(self, config: LidarRasterConfig) -> None:
        super().__init__(config)
        self._lidar = Lidar(config)

    @property
    def spec(self) -> Mapping[str, ArraySpec]:
        size = (self.config.rows, self.config.columns)
        return {
            "histogram": ArraySpec((self.config.bins, *size), np.uint8, "returns"),
            "occupancy": ArraySpec(size, np.uint8, "0 or 1", "png"),
        }

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> dict[str, NDArray[np.uint8]]:
        c = self.config
        points = self._lidar.read(history, scene, draws)
        counts = np.zeros((c.bins, c.rows, c.columns), np.uint8)
        axes = rotation(c.roll, c.pitch, c.yaw)
        per_bin = c.bins / (c.high - c.low)
        _count(points, np.array([c.x, c.y, c.z]), axes, c.ahead, c.side, c.pixels_per_metre, c.low, per_bin, counts)
        occupancy: NDArray[np.uint8] = (counts.max(axis=0) > 0).view(np.uint8)
        return {"histogram": counts, "occupancy": occupancy}


@kernel
def _count(points, place, axes, ahead, side, per_metre, low, per_bin, counts):  # type: ignore[no-untyped-def]
    """Adds points of the sensor's frame to the bins of the ego's."""
    bins, rows, columns = counts.shape
    for n in range(len(points)):
        f, r, u = points[n, 0], points[n, 1], points[n, 2]
        x = place[0] + axes[0, 0] * f + axes[0, 1] * r + axes[0, 2] * u
        y = place[1] + axes[1, 0] * f + axes[1, 1] * r + axes[1, 2] * u
        z = place[2] + axes[2, 0] * f + axes[2, 1] * r + axes[2, 2] * u
        row, column = int(np.floor((ahead - x) * per_metre)), int(np.floor((y + side) * per_metre))
        layer = int(np.floor((z - low) * per_bin))
        if 0 <= row < rows and 0 <= column < columns and 0 <= layer < bins and counts[layer, row, column] < 255:
            counts[layer, row, column] += np.uint8(1)
