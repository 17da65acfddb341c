"""Traffic that comes towards the ego."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.map.waypoint import Waypoint
from lavsim.scenarios.place import join, line_ahead, line_behind, oncoming


def oncoming_line(beside: Waypoint, ahead: float, behind: float) -> NDArray[np.float64] | None:
    """The nearest lane of the other direction as a line (N, 2).

    Args:
        beside: Lane centre of the ego's direction; None is given where the road has no other.
        ahead: Metres from there on (as the ego looks) at which the line begins.
        behind: Metres before it at which it ends.
    """
    other = oncoming(beside)
    if other is None:
        return None
    return join(line_behind(other, ahead), line_ahead(other, behind))
