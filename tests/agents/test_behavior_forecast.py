"""Where others are expected: slower in bends."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from agents.behavior.forecast import COUNT, DT, TIMES
from agents.behavior.ways import HARDEST, LATERAL, MAX_LANES, slow_for_bends, ways_of
from tests import worlds

Floats = NDArray[np.float64]


def covered(radius: float, speed: float) -> Floats:
    """Distance (COUNT,) [m] that a car at the start of a bend is expected to cover."""
    town = worlds.arc(radius, 120.0)
    chain = np.zeros(MAX_LANES, np.int64)
    lane = int(np.argmax(np.abs(town.lanes.points[town.lanes.first[:-1], 4]) > 0.5 / radius))
    chain[0] = lane
    out = np.empty(COUNT)
    slow_for_bends(ways_of(town), chain, 1, 0.0, speed, speed * TIMES, DT, out)
    return out


@pytest.mark.parametrize("radius", [12.0, 30.0])
def test_who_is_too_fast_for_a_bend_slows_down(radius: float) -> None:
    most = math.sqrt(LATERAL * (radius - 1.75))  # on the inner lane
    speeds = np.diff(covered(radius, 14.0)) / DT
    assert speeds[-1] == pytest.approx(most, rel=0.02)
    assert np.diff(np.append(14.0, speeds)).min() >= -HARDEST * DT - 1e-9


def test_who_is_slow_enough_keeps_its_speed() -> None:
    assert covered(30.0, 8.0) == pytest.approx(8.0 * TIMES)
