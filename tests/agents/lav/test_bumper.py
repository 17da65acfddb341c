"""Points right before the bumper brake, for a while; those beside, above and on the ground do not."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.bumper import Bumper
from agents.lav.config import DriveConfig

HEIGHT, HALF = 2.4, (2.45, 1.0)


def scan(ahead: float, right: float, up: float = 1.0, count: int = 5) -> np.ndarray:
    """Points at one place over the ground, and ground around."""
    ground = np.stack(np.meshgrid(np.arange(2.0, 9.0, 0.5), np.arange(-4.0, 4.0, 0.5)), axis=-1).reshape(-1, 2)
    flat = np.column_stack([ground, np.full(len(ground), -HEIGHT)])
    return np.concatenate([flat, np.tile([ahead, right, up - HEIGHT], (count, 1))]).astype(np.float32)


@pytest.mark.parametrize(
    ("points", "steer", "speed", "brakes"),
    [
        (scan(2.6, 0.9), 0.0, 0.0, True),
        (scan(2.6, 1.2), 0.0, 0.0, False),  # beside
        (scan(2.6, -0.9), 0.0, 2.0, True),
        (scan(3.2, 0.0), 0.0, 3.0, True),
        (scan(3.2, 0.0), 0.0, 0.5, False),  # far enough for now
        (scan(3.2, 0.0), 0.0, 6.0, False),  # others look farther ahead
        (scan(2.6, 0.0, up=0.3), 0.0, 0.0, False),  # a kerb
        (scan(2.6, 0.0, up=0.5), 0.0, 0.0, True),  # a wheel
        (scan(2.6, 0.0, up=2.6), 0.0, 0.0, False),  # the arm of a light
        (scan(2.6, 0.0, count=2), 0.0, 0.0, False),
        (scan(3.4, 1.3), 1.0, 4.0, True),  # along the arc
        (scan(3.4, -0.9), 1.0, 4.0, False),
        (scan(1.5, 0.0), 0.0, 0.0, False),  # the ego itself
    ],
)
def test_what_lies_before_the_bumper_brakes(points: np.ndarray, steer: float, speed: float, brakes: bool) -> None:
    assert Bumper(DriveConfig(), HALF).step(points, HEIGHT, steer, speed) == brakes
    assert not Bumper(DriveConfig(bumper=0.0), HALF).step(points, HEIGHT, steer, speed)


def test_it_does_not_hold_for_good() -> None:
    bumper, wreck = Bumper(DriveConfig(bumper=2.0), HALF), scan(2.6, 0.9)
    held = [bumper.step(wreck, HEIGHT, 0.0, 0.0) for _ in range(120)]
    assert held[:39] == [True] * 39
    assert held[39:99] == [False] * 60
    assert held[99] is True
