"""Points painted from the recorded semantic cameras: what a perfect segmentation would write onto them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.lav.data.points import CAMERA_AHEAD, SCORES, Floats
from agents.lav.models.segmentation import TAG_OF_CLASS
from lavsim.dataset.reader import Dataset

YAWS = tuple(np.radians((-120.0, -60.0, 0.0, 60.0, 120.0)))  # of sem_0 … sem_4
FOCAL = 204.84  # [px] of images 256 wide and 288 high
_LEAST_DEPTH = 0.1  # [m]


class TrueScores:
    """One for the class that a point's pixel shows, else nothing.

    Args:
        data: With the five semantic cameras.
    """

    def __init__(self, data: Dataset) -> None:
        self._data = data
        self._names = [f"sem_{number}" for number in range(len(YAWS))]
        self._row_of_tag = np.zeros((256, SCORES), np.float32)
        for number, tag in enumerate(TAG_OF_CLASS):
            if tag is not None:
                self._row_of_tag[int(tag), number - 1] = 1.0

    def scores(self, episode: int, frame: int) -> Floats:
        """(N, 4) of the frame's scan."""
        readings = self._data.read(episode, frame, ["lidar", *self._names])
        points = readings["lidar"]
        found = np.zeros((len(points), SCORES), np.float32)
        for name, yaw in zip(self._names, YAWS, strict=True):
            tags = readings[name]
            seen, rows, cols = pixels_of(points, yaw, tags.shape)
            found[seen] = self._row_of_tag[tags[rows, cols]]
        return found


def pixels_of(
    points: Floats, yaw: float, shape: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Which points (N, >= 3) a camera of that yaw sees, and at which row and column of its image (H, W)."""
    x, y, z = points[:, 0] - np.float32(CAMERA_AHEAD), points[:, 1], points[:, 2]
    c, s = np.float32(np.cos(yaw)), np.float32(np.sin(yaw))
    depth = x * c + y * s
    before = np.flatnonzero(depth > _LEAST_DEPTH)
    scale = np.float32(FOCAL) / depth[before]
    u = (y[before] * c - x[before] * s) * scale + shape[1] / 2.0
    v = shape[0] / 2.0 - z[before] * scale
    inside = (u >= 0.0) & (u < shape[1]) & (v >= 0.0) & (v < shape[0])
    return before[inside], v[inside].astype(np.int64), u[inside].astype(np.int64)
