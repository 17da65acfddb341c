"""A picture of a piece of the world from above, and the few strokes that pictures need: OpenCV's door."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from lavsim.cache import replace_atomically
from lavsim.render.ground import GroundRaster
from lavsim.render.palette import INK_BGR, SURFACE_BGR, Bgr

cv2.setNumThreads(1)  # the same bytes on any machine, and the cores belong to the workers

_FRACTION = 4  # bits of sub-pixel positions
_FINER = 3  # ground is drawn this much finer and averaged
_FONT = cv2.FONT_HERSHEY_SIMPLEX


@dataclass(frozen=True, eq=False)
class Canvas:
    """An image with its place in the world.

    Attributes:
        image: (H, W, 3) uint8 blue, green, red; drawn on in place.
        pixels_from_world: (2, 3) affine map from x, y [m] to column, row [px].
    """

    image: NDArray[np.uint8]
    pixels_from_world: NDArray[np.float64]

    @staticmethod
    def facing(
        x: float, y: float, yaw: float, size: tuple[int, int], scale: float, ahead: float = 0.5, fill: Bgr = (0, 0, 0)
    ) -> Canvas:
        """A picture in which heading `yaw` points up.

        Args:
            x, y: Where the picture is anchored [m].
            yaw: Heading that points up; -pi/2 keeps north up.
            size: Width, height [px].
            scale: Pixels per metre.
            ahead: Share of the height above the anchor.
            fill: Colour of the empty picture.
        """
        width, height = size
        c, s = np.cos(yaw), np.sin(yaw)
        turn = scale * np.array([[-s, c], [-c, -s]])  # right of the heading to the right, ahead upward
        anchor = np.array([width / 2.0, height * ahead]) - turn @ np.array([x, y])
        image = np.empty((height, width, 3), np.uint8)
        image[:] = fill
        return Canvas(image, np.column_stack([turn, anchor]))

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return float(np.hypot(self.pixels_from_world[0, 0], self.pixels_from_world[1, 0]))

    def pixels(self, points: ArrayLike) -> NDArray[np.float64]:
        """Columns and rows `(N, 2)` [px] of world points `(N, 2)`."""
        points = np.asarray(points, np.float64)
        return points[:, :2] @ self.pixels_from_world[:, :2].T + self.pixels_from_world[:, 2]

    def draw_ground(self, ground: GroundRaster, is_deck: bool = False) -> None:
        """Paints the classes of the ground over the whole picture; of a bridge's deck, only its road."""
        height, width = self.image.shape[:2]
        cell = np.array([[ground.resolution, 0.0, ground.origin[0]], [0.0, ground.resolution, ground.origin[1]]])
        cell[:, 2] += ground.resolution / 2.0  # a cell's number is that of its centre
        linear = self.pixels_from_world[:, :2] @ cell[:, :2]
        offset = self.pixels_from_world[:, :2] @ cell[:, 2] + self.pixels_from_world[:, 2] - 0.5
        fine = np.column_stack([linear * _FINER, offset * _FINER + (_FINER - 1) / 2.0])
        classes = cv2.warpAffine(
            ground.classes, fine, (width * _FINER, height * _FINER), flags=cv2.INTER_NEAREST, borderValue=0
        )
        paint = cv2.resize(SURFACE_BGR[classes], (width, height), interpolation=cv2.INTER_AREA)
        if is_deck:
            road = classes[_FINER // 2 :: _FINER, _FINER // 2 :: _FINER] > 0
            self.image[road] = paint[road]
        else:
            self.image[:] = paint

    def fill(self, polygon: ArrayLike, colour: Bgr, outline: Bgr | None = None) -> None:
        """Fills a convex world polygon (N, 2)."""
        corners = self._fixed(polygon)
        cv2.fillConvexPoly(self.image, corners, colour, cv2.LINE_AA, _FRACTION)
        if outline is not None:
            cv2.polylines(self.image, [corners], True, outline, 1, cv2.LINE_AA, _FRACTION)

    def outline(self, polygon: ArrayLike, colour: Bgr, thickness: int = 1, closed: bool = True) -> None:
        """Draws a world polyline (N, 2)."""
        cv2.polylines(self.image, [self._fixed(polygon)], closed, colour, thickness, cv2.LINE_AA, _FRACTION)

    def disc(self, point: Sequence[float], radius: float, colour: Bgr, outline: Bgr | None = None) -> None:
        """Draws a disc of `radius` pixels about a world point."""
        centre = self._fixed([point])[0, 0].tolist()
        fixed = round(radius * 2**_FRACTION)
        cv2.circle(self.image, centre, fixed, colour, -1, cv2.LINE_AA, _FRACTION)
        if outline is not None:
            cv2.circle(self.image, centre, fixed, outline, 1, cv2.LINE_AA, _FRACTION)

    def dots(self, points: NDArray[np.float64], colours: NDArray[np.uint8]) -> None:
        """Sets one pixel at each world point (N, 2), in order."""
        at = np.floor(self.pixels(points)).astype(np.int64)
        inside = (at >= 0).all(axis=1) & (at[:, 0] < self.image.shape[1]) & (at[:, 1] < self.image.shape[0])
        self.image[at[inside, 1], at[inside, 0]] = colours[inside]

    def _fixed(self, points: ArrayLike) -> NDArray[np.int32]:
        fixed = np.rint((self.pixels(points) - 0.5) * 2**_FRACTION)
        return np.clip(fixed, -(2**24), 2**24).astype(np.int32).reshape(-1, 1, 2)


def write_text(
    image: NDArray[np.uint8], text: str, at: tuple[int, int], size: float = 0.45, colour: Bgr = INK_BGR
) -> None:
    """Writes one line; `at` is the left end of its base line [px]."""
    cv2.putText(image, text, at, _FONT, size, colour, 1, cv2.LINE_AA)


def height_colours(heights: NDArray[np.float64], low: float, high: float) -> NDArray[np.uint8]:
    """(N, 3) colours from blue over green to red."""
    share = np.clip((heights - low) / (high - low), 0.0, 1.0)
    level = np.rint(share * 255.0).astype(np.uint8).reshape(-1, 1)
    colours: NDArray[np.uint8] = cv2.applyColorMap(level, cv2.COLORMAP_TURBO).reshape(-1, 3)
    return colours


def encode_png(image: NDArray[np.uint8]) -> bytes:
    """The image (H, W, 3 or 4) as a PNG file."""
    done, data = cv2.imencode(".png", image)
    if not done:
        raise ValueError("OpenCV could not encode the image")
    return bytes(data)


def write_png(image: NDArray[np.uint8], path: Path) -> None:
    """Writes a PNG file whole or not at all."""
    replace_atomically(path, encode_png(image))
