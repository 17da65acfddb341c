"""LAV's units and frames against ours: goals (left, forward), degrees, half extents, commands counted from 0.

Convention:
    Ours: ego frame x forward, y right; yaw [rad]; full sizes; `RoadOption` (1 left … 6 change right).
    LAV's dataset: goals (left, forward) [m]; yaw [deg]; half sizes; commands 0 left … 5 change right, no command 3.
    LAV's planner: x right, y backward, the negative of a goal. Compass: clockwise from north [rad], yaw + 90 degrees.

Source: reference `lav.md` 1.1, 3.1.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from lavsim.types import ActorClass, RoadOption

Floats = NDArray[np.float64]

WALKER, VEHICLE = 0, 1  # LAV's types
FOLLOW = 3  # what LAV makes of an undefined command
TICKS = 5  # between two frames

# LAV's eleven layers; the six lane-direction layers served its recorder alone and are written empty.
MAP_LAYERS = (
    "road", "vehicle", "pedestrian", "left", "right", "straight", "follow", "change_left", "change_right", "solid",
    "broken",
)  # fmt: skip
OUR_LAYERS = ("road", "vehicle", "pedestrian", "solid", "broken")


def goal_from_lav(goal: ArrayLike) -> Floats:
    """(…, 2) ahead, right [m] of a stored target (left, forward)."""
    left, forward = np.moveaxis(np.asarray(goal, np.float64), -1, 0)
    return np.stack([forward, -left], axis=-1)


def goal_to_lav(goal: ArrayLike) -> Floats:
    """(…, 2) left, forward [m] of a goal (ahead, right)."""
    ahead, right = np.moveaxis(np.asarray(goal, np.float64), -1, 0)
    return np.stack([-right, ahead], axis=-1)


def goal_of_position(offset: ArrayLike, yaw: float) -> Floats:
    """(left, forward) [m] of a world displacement (dx, dy) seen at heading `yaw` [rad]."""
    dx, dy = np.moveaxis(np.asarray(offset, np.float64), -1, 0)
    return np.stack([dx * np.sin(yaw) - dy * np.cos(yaw), dx * np.cos(yaw) + dy * np.sin(yaw)], axis=-1)


def command_from_lav(command: int) -> int:
    """`RoadOption` of a stored command."""
    return command + 1 if 0 <= command < 6 else int(RoadOption.LANEFOLLOW)


def command_to_lav(command: int) -> int:
    """0 to 5; without a command 3 (follow), as the recorder did."""
    return command - 1 if command >= 1 else FOLLOW


def compass_of_yaw(yaw: ArrayLike) -> Floats:
    """Compass [rad] in [0, 2 pi) of headings [rad]: 0 is north, which is yaw -90 degrees."""
    return np.mod(np.asarray(yaw, np.float64) + np.pi / 2.0, 2.0 * np.pi)


def types_to_lav(classes: ArrayLike) -> NDArray[np.uint8]:
    """(A,) 0 walker or 1 vehicle of `ActorClass`; two-wheelers are vehicles."""
    return np.where(np.asarray(classes) == ActorClass.WALKER, WALKER, VEHICLE).astype(np.uint8)


def classes_from_lav(types: ArrayLike, half: ArrayLike) -> NDArray[np.uint8]:
    """(A,) `ActorClass` of LAV's types and half sizes (A, 2) [m], which tell two-wheelers and long vehicles apart.

    LAV keeps no finer class. A vehicle narrower than 1.2 m is a two-wheeler (CARLA's are at most 1.1 m wide, its
    narrowest car 1.5 m), one longer than 7 m a truck.
    """
    half = np.asarray(half, np.float64).reshape(-1, 2)
    classes = np.full(len(half), ActorClass.CAR, np.uint8)
    classes[half[:, 0] > 3.5] = ActorClass.TRUCK
    classes[half[:, 1] < 0.6] = ActorClass.MOTORCYCLE
    classes[np.asarray(types) == WALKER] = ActorClass.WALKER
    return classes


def sizes_from_lav(half: ArrayLike, classes: ArrayLike) -> NDArray[np.float32]:
    """(A, 3) full length, width, height [m]; LAV has no heights: usual ones of the class stand in."""
    half = np.asarray(half, np.float32).reshape(-1, 2)
    usual = np.full(len(ActorClass), 1.6, np.float32)
    usual[ActorClass.WALKER], usual[ActorClass.TRUCK] = 1.8, 3.0
    return np.column_stack([2.0 * half, usual[np.asarray(classes, np.int64)]]).astype(np.float32)


def layers_from_png(maps: tuple[bytes, ...]) -> NDArray[np.uint8]:
    """(5, 320, 320) uint8, 255 where set: `OUR_LAYERS` of LAV's PNG files."""
    chosen = [maps[MAP_LAYERS.index(name)] for name in OUR_LAYERS]
    layers = np.stack([decode_image(data, cv2.IMREAD_GRAYSCALE) for data in chosen])
    return np.where(layers > 0, np.uint8(255), np.uint8(0))


def layers_to_png(layers: dict[str, NDArray[np.uint8]]) -> tuple[bytes, ...]:
    """LAV's eleven PNG files of our layers (H, W) by name; those that are not given are empty."""
    blank = np.zeros_like(next(iter(layers.values())))
    return tuple(encode_image(".png", layers.get(name, blank)) for name in MAP_LAYERS)


def decode_image(data: bytes, mode: int = cv2.IMREAD_COLOR) -> NDArray[np.uint8]:
    """(H, W, 3) blue, green, red, or (H, W) of a JPEG or PNG file.

    Raises:
        ValueError: it is none.
    """
    image = cv2.imdecode(np.frombuffer(data, np.uint8), mode)
    if image is None:
        raise ValueError("no image")
    return np.asarray(image, np.uint8)


def encode_image(suffix: str, image: NDArray[np.uint8]) -> bytes:
    """The image as a file, `.png` or `.jpg`."""
    done, data = cv2.imencode(suffix, image)
    if not done:
        raise ValueError(f"OpenCV can't encode an image of shape {image.shape} as {suffix}")
    return bytes(data)
