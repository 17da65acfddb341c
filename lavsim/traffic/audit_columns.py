"""What the audit of traffic remembers of each actor from look to look."""

from __future__ import annotations

import numpy as np


class Columns:
    """One entry for each row of the actor table; grows with it."""

    def __init__(self) -> None:
        self.seen = np.full(0, -1, np.int64)  # tick of the last look at it
        self.yaw = np.zeros(0)
        self.xy = np.zeros((0, 2))
        self.speed = np.zeros(0)
        self.slowest = np.zeros(0)  # lowest speed since the last look [m/s]
        self.acceleration = np.full(0, np.nan)
        self.lane = np.full(0, -1, np.int32)
        self.line = np.full(0, -1, np.int64)  # stop line ahead
        self.before = np.zeros(0)  # distance from the front to it [m]
        self.has_queued = np.zeros(0, np.bool_)  # stood or nearly so since its last line
        self.has_halted = np.zeros(0, np.bool_)
        self.is_off = np.zeros(0, np.bool_)
        self.still = np.zeros(0)  # [s] standing
        self.still_free = np.zeros(0)  # [s] the same without a red light ahead

    def grow(self, count: int) -> None:
        """Makes room for `count` rows; new ones hold what the empty columns were made with."""
        have = len(self.seen)
        if count <= have:
            return
        blank = {"seen": -1, "lane": -1, "line": -1, "acceleration": np.nan, "slowest": np.inf}
        for name, column in vars(self).items():
            more = np.full((count - have, *column.shape[1:]), blank.get(name, 0), column.dtype)
            setattr(self, name, np.concatenate([column, more]))
