"""Which way a vehicle on a line signals: before and while it turns at a junction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.map.town_map import TownMap
from lavsim.scenarios.moves.pursuit import STEP, Line
from lavsim.types import VehicleLight

INDICATORS = int(VehicleLight.LEFT_BLINKER | VehicleLight.RIGHT_BLINKER)
_BEFORE = 30.0  # [m] before a junction from which it signals
_TURNS = np.radians(35.0)  # that a way through a junction turns at least, as in the lane table


def indicators_along(town: TownMap, line: Line, z: float) -> NDArray[np.int32]:
    """What a vehicle signals at each point of `line` (P,), `VehicleLight` bits.

    Args:
        town: Whose junctions count.
        line: Its way.
        z: Height near which the way runs [m].
    """
    places = np.column_stack([line.xy, np.full(len(line.xy), z)])
    is_inside = town.lanes.junction[town.nearest(places).lane] >= 0
    edges = np.flatnonzero(np.diff(is_inside.astype(np.int8), prepend=0, append=0))
    signals = np.zeros(len(line.xy), np.int32)
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        turned = line.yaw[end - 1] - line.yaw[begin]
        if abs(turned) > _TURNS:
            side = VehicleLight.RIGHT_BLINKER if turned > 0.0 else VehicleLight.LEFT_BLINKER
            signals[max(begin - int(_BEFORE / STEP), 0) : end] = int(side)
    return signals
