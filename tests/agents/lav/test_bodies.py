"""Detections near the ego need points above the ground, walkers none above people's heads."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.bodies import body_points, with_body, without_poles
from agents.lav.models.detection import Detections

HEIGHT = 2.4
GROUND = np.stack([*np.meshgrid(np.arange(-20.0, 20.0, 0.5), np.arange(-20.0, 20.0, 0.5)), np.full((80, 80), -HEIGHT)])


def kept(place: tuple[float, float], body: tuple[float, float, float] | None, yaw: float = 0.0) -> bool:
    """Whether a car found ahead and to the right stays, on bare ground but for one point."""
    box = torch.tensor([[place[1], -place[0], yaw, 2.2, 0.9]])
    scan = GROUND.reshape(3, -1).T.astype(np.float32)
    points = scan if body is None else np.concatenate([scan, np.array([body], np.float32)])
    return len(with_body(Detections(box, torch.tensor([0.5])), body_points(points, HEIGHT)).scores) == 1


@pytest.mark.parametrize(
    ("place", "body", "yaw", "stays"),
    [
        ((0.2, -3.8), None, 0.0, False),
        ((0.2, -3.8), (2.0, -3.2, -1.5), 0.0, True),
        ((0.2, -3.8), (2.0, -3.2, -2.3), 0.0, False),  # a kerb
        ((0.2, -3.8), (0.2, -5.7, -1.5), 0.0, False),  # beside it
        ((6.0, 0.0), (6.0, 1.9, -1.5), np.pi / 2.0, True),  # across
        ((6.0, 0.0), (7.9, 0.0, -1.5), np.pi / 2.0, False),
        ((14.0, 0.0), None, 0.0, True),  # too far away to tell
    ],
)
def test_who_is_near_needs_a_body(
    place: tuple[float, float], body: tuple[float, float, float] | None, yaw: float, stays: bool
) -> None:
    assert kept(place, body, yaw) == stays


def test_nobody_found_is_nobody_kept() -> None:
    none = Detections(torch.zeros((0, 5)), torch.zeros(0))
    assert len(with_body(none, body_points(np.zeros((0, 4), np.float32), HEIGHT)).scores) == 0


@pytest.mark.parametrize(
    ("place", "top", "above", "stays"),
    [
        ((3.0, 2.3), 1.85, 0, True),  # a man
        ((3.0, 2.3), 2.1, 0, True),  # on a bicycle
        ((3.0, 2.3), 2.9, 30, False),  # the pole of a light
        ((10.0, 2.3), 3.5, 6, False),
        ((10.0, 2.3), 2.6, 0, True),  # a man uphill
        ((3.0, 2.3), 1.85, 2, True),  # a man who walks past a pole
        ((14.0, 2.3), 3.5, 30, True),  # too far away to tell
    ],
)
def test_who_is_taller_than_people_is_no_walker(
    place: tuple[float, float], top: float, above: int, stays: bool
) -> None:
    up = np.concatenate([np.linspace(0.5, min(top, 2.2), 40), np.linspace(2.6, 3.5, above)]) - HEIGHT
    if top > 2.2 and not above:
        up = np.concatenate([up, [top - HEIGHT]])
    body = np.column_stack([np.full(len(up), place[0]), np.full(len(up), place[1]), up]).astype(np.float32)
    scan = np.concatenate([GROUND.reshape(3, -1).T.astype(np.float32), body])
    box = torch.tensor([[place[1], -place[0], 0.0, 0.3, 0.3]])
    assert len(without_poles(Detections(box, torch.tensor([0.5])), scan, HEIGHT).scores) == stays


def test_without_walkers_there_are_no_poles() -> None:
    none = Detections(torch.zeros((0, 5)), torch.zeros(0))
    assert len(without_poles(none, np.zeros((0, 4), np.float32), HEIGHT).scores) == 0
