"""A frame from above: what is seen over what is true."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.lav.config import GridConfig

Picture = NDArray[np.uint8]

ROAD, SOLID, BROKEN = (70, 70, 78), (230, 200, 90), (235, 235, 235)
POINT, TRUTH, FOUND = (40, 110, 120), (80, 220, 90), (240, 80, 70)
_SIZE = 384  # [px] of a side, about


def map_picture(layers: NDArray[np.bool_], grid: GridConfig) -> Picture:
    """Road and marks (3, rows, cols), enlarged."""
    cells = np.full((grid.rows, grid.cols, 3), 18, np.uint8)
    for layer, colour in zip(layers, (ROAD, SOLID, BROKEN), strict=True):
        cells[layer] = colour
    factor = max(1, round(_SIZE / grid.rows))
    return np.ascontiguousarray(np.repeat(np.repeat(cells, factor, axis=0), factor, axis=1))


def draw_points(picture: Picture, points: NDArray[np.floating], grid: GridConfig) -> None:
    """Points (P, >= 2) ahead and right [m]."""
    place = _pixels(np.column_stack([points[:, 1], -points[:, 0]]), picture, grid)
    inside = ((place >= 0) & (place < picture.shape[0])).all(axis=1)
    picture[place[inside, 1], place[inside, 0]] = POINT


def draw_boxes(
    picture: Picture, boxes: NDArray[np.floating], grid: GridConfig, colour: tuple[int, int, int], width: int = 1
) -> None:
    """Boxes (N, 5) in the planner frame, with a line to where they head."""
    for x, y, heading, length, breadth in boxes:
        c, s = np.cos(heading), np.sin(heading)
        own = np.array(
            [[-breadth, -length], [breadth, -length], [breadth, length], [-breadth, length], [0, 0], [0, -length]]
        )
        corners = own @ np.array([[c, s], [-s, c]]) + (x, y)
        place = _pixels(corners, picture, grid)
        cv2.polylines(picture, [place[:4]], True, colour, width, cv2.LINE_AA)
        cv2.line(picture, place[4].tolist(), place[5].tolist(), colour, width, cv2.LINE_AA)


def draw_path(
    picture: Picture, path: NDArray[np.floating], grid: GridConfig, colour: tuple[int, int, int], dot: int = 2
) -> None:
    """A path (T, 2) in the planner frame."""
    for place in _pixels(path, picture, grid):
        cv2.circle(picture, place.tolist(), dot, colour, -1, cv2.LINE_AA)


def _pixels(points: NDArray[np.floating], picture: Picture, grid: GridConfig) -> NDArray[np.int32]:
    """(N, 2) column and row of planner points (N, 2)."""
    scale = picture.shape[0] / (grid.rows * grid.cell)
    return np.floor((points + np.array([grid.aside, grid.ahead])) * scale).astype(np.int32)
