"""Images as they might have been taken otherwise: LAV's augmenters, each with even odds, in a drawn order.

Source: reference `lav.md` 3.4. Labels are not touched: what moves pixels moves them by a pixel or two at random.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from lavsim.random import Draws

Image = NDArray[np.uint8]
T = TypeVar("T", bound=np.generic)
_TABLE = 1 << 21  # draws that all images share; each begins somewhere else
_GREY = np.array((0.299, 0.587, 0.114), np.float32)


def augmented(image: Image, draws: Draws) -> Image:
    """(H, W, 3) an image under drawn blur, noise, lost pixels, brightness, contrast, loss of colour and jitter."""
    unit = draws.uniform(0, 3 * len(_AUGMENTERS))
    odds, order, amount = unit.reshape(3, -1)
    for number in np.argsort(order, kind="stable"):
        if odds[number] < 0.5:
            image = _AUGMENTERS[number](image, float(amount[number]), draws.integer(1, _TABLE // 2, int(number)))
    return image


def _blurred(image: Image, amount: float, _: int) -> Image:
    sigma = 0.5 * amount
    return image if sigma < 0.2 else np.asarray(cv2.GaussianBlur(image, (3, 3), sigma))


def _noisy(image: Image, amount: float, begin: int) -> Image:
    """The same noise in all colours, or each its own."""
    count = image.size if begin % 2 else image.size // 3
    noise = _cut(_normals(), begin, count).reshape(*image.shape[:2], -1).astype(np.float32) * (
        0.05 * 255.0 * amount / 32.0
    )
    return _bytes(image + noise)


def _lost(image: Image, amount: float, begin: int) -> Image:
    """Black pixels, 1 to 10 %."""
    kept = _cut(_bytes_of_noise(), begin, image.shape[0] * image.shape[1]) >= (0.01 + 0.09 * amount) * 256.0
    return image * kept.reshape(*image.shape[:2], 1)


def _brighter(image: Image, amount: float, _: int) -> Image:
    return np.asarray(cv2.convertScaleAbs(image, alpha=_factor(amount)))


def _contrasted(image: Image, amount: float, _: int) -> Image:
    """Linear contrast about the middle grey."""
    factor = _factor(amount)
    return _bytes(image * np.float32(factor) + np.float32(128.0 * (1.0 - factor)))


def _greyer(image: Image, amount: float, _: int) -> Image:
    alpha = np.float32(0.5 * amount)
    mixing = np.eye(3, dtype=np.float32) * (1.0 - alpha) + alpha * _GREY
    return np.asarray(cv2.transform(image, mixing))


def _jittered(image: Image, amount: float, begin: int) -> Image:
    """Every pixel from a place up to some away: the reference's elastic with hardly any smoothing."""
    height, width = image.shape[:2]
    reach = (0.5 + 3.0 * amount) * height / 288.0 / 3.0
    noise = _cut(_normals(), begin, 2 * height * width).reshape(2, height, width).astype(np.float32) * (reach / 32.0)
    rows, columns = _places(height, width)
    moved = cv2.remap(image, columns + noise[0], rows + noise[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved)


_AUGMENTERS: tuple[Callable[[Image, float, int], Image], ...] = (
    _blurred, _noisy, _lost, _brighter, _contrasted, _greyer, _jittered,
)  # fmt: skip


def _factor(amount: float) -> float:
    """1 / 1.2 to 1.2, evenly on a log scale."""
    return float(1.2 ** (2.0 * amount - 1.0))


def _bytes(values: NDArray[np.float32]) -> Image:
    return np.clip(values, 0.0, 255.0).astype(np.uint8)


def _cut(table: NDArray[T], begin: int, count: int) -> NDArray[T]:
    """`count` draws of a table from a place on; it begins anew at its end."""
    return np.take(table, np.arange(begin, begin + count), mode="wrap")


@cache
def _normals() -> NDArray[np.int8]:
    """Gaussian draws in steps of 1 / 32."""
    return np.clip(np.rint(Draws.of_seed(0).stream("noise").normal(0, _TABLE, 0.0, 32.0)), -127, 127).astype(np.int8)


@cache
def _bytes_of_noise() -> NDArray[np.uint8]:
    return (Draws.of_seed(0).stream("lost").bits(0, _TABLE) >> np.uint64(56)).astype(np.uint8)


@cache
def _places(height: int, width: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    return rows, columns
