"""Drivers that wait for each other in a circle, or that nobody lets go.

One of them is given the right to go; as a last resort one is taken out.

CARLA's traffic manager takes out who has stood for 90 s without a red light, at most one in 10 s (reference
`carla.md` 5.1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.traffic.fleet import NOBODY, RED_LIGHT, Fleet
from lavsim.traffic.network import Lanes

LOOK_EVERY = 20  # ticks between two looks at who stands
_CIRCLE_PATIENCE = 160  # ticks at rest, without a red light to blame, after which a circle is broken
_PATIENCE = 600  # ticks after which whoever is first in a queue need not wait for others any longer
_LAST_RESORT = 1800  # ticks
_LAST_RESORT_BEHIND_GUEST = 3600  # ticks, behind the ego or what a hazard has set there
_GRANT = 200  # ticks for which the right to go holds
_STARTS = 0.2  # [m/s²] who accelerates that much is about to go
_CHAIN = 32  # vehicles of a queue that are followed to its head
_FREE, _LIGHT, _GUEST, _CIRCLE = 0, 1, 2, 3  # what holds a queue up: nobody, a light, no background driver, itself


@kernel
def find_deadlocks(lanes: Lanes, fleet: Fleet, slots: NDArray[np.int32], tick: int) -> int:
    """Gives the right to go where drivers block each other.

    Args:
        lanes: The road network.
        fleet: All drivers.
        slots: (N,) slot in the fleet of each row.
        tick: Now.

    Returns:
        The slot that has to be taken out as a last resort, -1.
    """
    worst, longest = -1, 0
    for i in range(len(fleet.row)):
        if fleet.row[i] < 0 or fleet.still[i] < LOOK_EVERY:
            fleet.stuck[i] = 0
            continue
        head, reason = _head_of_queue(fleet, slots, i)
        fleet.stuck[i] = 0 if reason == _LIGHT else fleet.stuck[i] + LOOK_EVERY
        if fleet.stuck[i] < _CIRCLE_PATIENCE:
            continue
        if lanes.junction[fleet.lane[head]] < 0 and fleet.granted[head] < tick:
            patience = _CIRCLE_PATIENCE if reason == _CIRCLE else _PATIENCE
            if fleet.stuck[head] >= patience:
                fleet.granted[head] = tick + _GRANT
        limit = _LAST_RESORT_BEHIND_GUEST if reason == _GUEST else _LAST_RESORT
        if fleet.stuck[i] >= limit and fleet.stuck[i] > longest:
            worst, longest = i, fleet.stuck[i]
    return worst


@kernel
def _head_of_queue(fleet: Fleet, slots: NDArray[np.int32], i: int) -> tuple[int, int]:
    """Who is at the head of the queue in which vehicle `i` stands, and for what that one waits."""
    at = i
    for _ in range(_CHAIN):
        row = fleet.blame[at]
        if row == RED_LIGHT:
            return at, _LIGHT
        if row == NOBODY:
            return at, _LIGHT if fleet.brake[at] > _STARTS else _FREE
        slot = slots[row]
        if slot < 0:
            return at, _GUEST
        if fleet.still[slot] == 0:
            return at, _LIGHT  # it moves: so will the others
        at = slot
        if at == i:
            return i, _CIRCLE
    return at, _CIRCLE
