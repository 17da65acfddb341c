"""What of the truth could have been seen: the rest is taken out before the expert drives by it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.behavior.config import Sight
from lavsim.types import Role

_PER_ACTOR = ("ids", "classes", "roles", "sizes", "xyz", "yaw", "velocities", "vehicle_lights")


class Seen:
    """Takes out of readings whom neither LiDAR nor cameras saw lately, and what nobody can see.

    Who was seen once stays for `Sight.memory` seconds. Why an actor is there (its role) can't be seen: all vehicles
    become traffic, things stay things.
    """

    def __init__(self, sight: Sight) -> None:
        self._sight = sight
        self._ids: NDArray[np.int32] = np.zeros(0, np.int32)
        self._last: NDArray[np.float64] = np.zeros(0)

    def filter(self, truth: Mapping[str, Any]) -> dict[str, Any]:
        """`truth` (with `lidar_hits` and `pixels`) as far as it was seen; the ego stays row 0."""
        ids, time = truth["ids"], float(truth["time"])
        last = np.full(len(ids), -np.inf)
        _, here, before = np.intersect1d(ids, self._ids, assume_unique=True, return_indices=True)
        last[here] = self._last[before]
        sight = self._sight
        seen = (truth["lidar_hits"] >= sight.least_hits) | (truth["pixels"] >= sight.least_pixels)
        last[seen] = time
        self._ids, self._last = ids.copy(), last
        known = last >= time - sight.memory
        known[0] = True
        roles = np.where(truth["roles"] == Role.EGO, Role.EGO, Role.TRAFFIC).astype(np.uint8)
        plain = {**truth, "roles": roles}
        return {key: value[known] if key in _PER_ACTOR else value for key, value in plain.items()}
