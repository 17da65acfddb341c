"""Who may step into the way: people who appear so near that by the time their speed is known brakes come too late.

Runners who come from behind a bin are found as small vehicles, often in doubt, before they are found as walkers, and
tracked on from what they came from behind. So whoever is slight and new is taken to run into the way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SMALL = 0.55  # [m] half length of who walks, whatever he is found as; bicycles have 0.75 and more
SLIGHT = 0.7  # [m] half length of who may be a walker
_NEW = 5  # looks (of walkers: as one) until his speed is believed: before, it may be that of what he came from behind
_NEAREST_ASIDE, _MOST_ASIDE = 1.5, 5.0  # [m] beside the way; what stands farther is furniture
_FULL_BRAKES, _REACTION, _FRONT = 8.0, 0.35, 4.0  # [m/s²], [s], [m] of the ego and before it
_RUNS, _BESIDE = 4.0, 1.2  # [m/s] towards the way, of who lies that far aside [m]


def steps_out(
    boxes: Floats,
    margin: Floats,
    walks: NDArray[np.bool_],
    looks: NDArray[np.int64],
    velocities: Floats,
    speed: float,
) -> NDArray[np.bool_]:
    """(N,) who is taken to run into the way.

    Args:
        boxes: (N, 5) in the planner frame [m, rad].
        margin: (N,) by which scores are above their kind's threshold.
        walks: (N,) who was found as a walker.
        looks: (N,) in which each was found; of walkers, since they were found as such.
        velocities: (N, 2), not a number where they are not known [m/s].
        speed: Of the ego [m/s].
    """
    is_new = np.isnan(velocities).any(axis=1) | (looks <= _NEW)
    is_sure = (walks | (boxes[:, 3] < SMALL)) & (margin >= 0.0)
    return np.asarray((is_sure | _is_slight_beside(boxes)) & is_new & _appears_near(boxes, speed))


def towards_the_way(boxes: Floats) -> Floats:
    """(N, 2) velocities of who runs into the way [m/s]."""
    aside = boxes[:, 0]
    across = np.where(np.abs(aside) > _BESIDE, -np.sign(aside) * _RUNS, 0.0)
    return np.stack([across, np.zeros(len(aside))], axis=1)


def _is_slight_beside(boxes: Floats) -> NDArray[np.bool_]:
    """(N,) who is no longer than a bicycle and right beside the way: sure or not, he may be a walker."""
    aside = np.abs(boxes[:, 0])
    return np.asarray((boxes[:, 3] < SLIGHT) & (aside > _NEAREST_ASIDE) & (aside < _MOST_ASIDE))


def _appears_near(boxes: Floats, speed: float) -> NDArray[np.bool_]:
    """(N,) who is ahead, within the way to a stand."""
    ahead = -boxes[:, 1]
    return np.asarray((ahead > 0.0) & (ahead < speed * speed / (2.0 * _FULL_BRAKES) + _REACTION * speed + _FRONT))
