"""What LAV's stages learn from, as arrays of fixed sizes, cut from frames of a dataset."""

from __future__ import annotations

from functools import reduce
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.lav.config import CameraConfig, GridConfig
from agents.lav.frames import command_of, planner_from_vehicle
from lavsim.dataset.samples import Motions, SampleFilter, motions_of
from lavsim.dataset.tables import Table
from lavsim.errors import ConfigError
from lavsim.random import Draws
from lavsim.sensors.bev import BevConfig, ego_column, ego_row

FRONT = ("rgb_1", "rgb_2", "rgb_3")  # -60, 0, 60 degrees
TELEPHOTO_KEPT = 192  # rows of the telephoto's 288 that the brake network sees; the lowest third is left out


def motion_arrays(table: Table, first: int, steps: int, filters: SampleFilter) -> dict[str, NDArray[Any]]:
    """Poses and futures of the vehicles of a window, and what the ego was told.

    Args:
        table: Of the episode.
        first: Frame at which the window begins.
        steps: T.
        filters: Who counts; `filters.most` is R.

    Returns:
        "poses" (R, 3) float32 x, y [m], heading [rad] in the ego's planner frame, the ego first; "futures" (R, T, 2)
        float32 [m], each in its vehicle's own planner frame; "is_real" (R,) bool, false for padding; "is_vehicle"
        (R,) bool; "sizes" (R, 2) float32 length, width [m]; "speeds" (R,) float32 [m/s]; "command" int64 0 to 5;
        "goals" (2, 2) float32 [m] the next two in the planner frame; "brake" and "speed" float32 [m/s].
    """
    motions = motions_of(table, first, steps, filters)
    count, most = len(motions.ids), filters.most
    arrays: dict[str, NDArray[Any]] = {
        "poses": np.zeros((most, 3), np.float32),
        "futures": np.zeros((most, steps, 2), np.float32),
        "is_real": np.arange(most) < count,
        "is_vehicle": np.zeros(most, np.bool_),
        "sizes": np.zeros((most, 2), np.float32),
        "speeds": np.zeros(most, np.float32),
    }
    arrays["poses"][:count] = _poses(motions)
    arrays["futures"][:count] = planner_from_vehicle(motions.futures)
    arrays["is_vehicle"][:count] = motions.is_vehicle
    arrays["sizes"][:count] = motions.sizes[:, :2]
    arrays["speeds"][:count] = motions.speeds
    goals = np.stack([table["goal"][first], table["next_goal"][first]])
    return {
        **arrays,
        "command": np.array(command_of(int(table["command"][first])), np.int64),
        "goals": planner_from_vehicle(goals).astype(np.float32),
        "brake": table["brake"][first].astype(np.float32),
        "speed": table["speed"][first].astype(np.float32),
    }


def _poses(motions: Motions) -> NDArray[np.float64]:
    return np.column_stack([planner_from_vehicle(motions.places), motions.headings])


def grid_layers(layers: NDArray[np.uint8], bev: BevConfig, grid: GridConfig) -> NDArray[np.uint8]:
    """(C, rows, cols) 0 or 1: stored layers (C, H, W) on a grid; a coarser cell is set if any of its pixels is.

    Raises:
        ConfigError: the grid reaches farther than the stored picture, or its cells are no whole number of pixels.
    """
    scale = bev.pixels_per_metre
    top, left = ego_row(bev) - grid.ahead * scale, ego_column(bev) - grid.aside * scale
    factor = grid.cell * scale
    height, width = grid.rows * round(factor), grid.cols * round(factor)
    if any(abs(value - round(value)) > 1e-6 for value in (top, left, factor)) or factor < 1.0:
        raise ConfigError(f"cells of {grid.cell} m do not fit pixels of {1.0 / scale:g} m.")
    row, column, k = round(top), round(left), round(factor)
    if row < 0 or column < 0 or row + height > bev.height or column + width > bev.width:
        raise ConfigError("the grid reaches farther than the dataset's picture from above.")
    cut = layers[:, row : row + height, column : column + width]
    # Maxima of whole slices: ten times as fast as one over the axes of blocks.
    cut = reduce(np.maximum, [cut[:, i::k] for i in range(k)])
    cut = reduce(np.maximum, [cut[:, :, i::k] for i in range(k)])
    return (cut > 0).astype(np.uint8)


def some_points(points: NDArray[np.float32], most: int, draws: Draws, frame: int) -> tuple[NDArray[np.float32], int]:
    """(most, 4) points of a scan and how many they are: all, or `most` that are drawn; zeros behind them."""
    chosen = points
    if len(points) > most:
        order = np.argpartition(draws.bits(frame, len(points)), most)[:most]
        chosen = points[np.sort(order)]
    padded = np.zeros((most, points.shape[1]), np.float32)
    padded[: len(chosen)] = chosen
    return padded, len(chosen)


def front_images(frame: dict[str, Any], cameras: CameraConfig) -> dict[str, NDArray[np.uint8]]:
    """ "images" (3, 3, H, W) of the front cameras, left to right, and "telephoto" (3, H', W'), red first, as networks
    take them."""
    wide = np.stack([_resized(frame[name], cameras.width, cameras.height) for name in FRONT])
    telephoto = _resized(frame["tel_rgb"][:TELEPHOTO_KEPT], cameras.telephoto_width, cameras.telephoto_height)
    return {
        "images": np.ascontiguousarray(wide.transpose(0, 3, 1, 2)),
        "telephoto": np.ascontiguousarray(telephoto.transpose(2, 0, 1)),
    }


def _resized(image: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    if image.shape[:2] == (height, width):
        return image
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA))
