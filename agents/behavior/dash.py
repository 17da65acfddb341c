"""Taking a gap in one go: whether pulling away firmly now leads through everybody's forecasts, and how firmly."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.behavior.forecast import COUNT, DT, Forecast
from agents.behavior.hazards import Ego, Meetings
from agents.behavior.path import STEP
from lavsim.kernel import kernel
from lavsim.types import ActorClass

Floats = NDArray[np.float64]

PULL = 4.5  # [m/s²]
WAITED = 0.8  # patience below which it looks for such gaps
SLOW = 4.0  # [m/s] only from here: who drives faster has the usual gaps
SPARE, SPARE_UNDER_WAY = 0.4, 0.0  # [s] to others, to begin and to go on
SPARE_WALKER = 1.2  # [s]
ROOM, ROOM_UNDER_WAY = 0.8, 0.1  # [m]
BEHIND = 0.5  # [m] to who is followed
LASTS = 5.0  # [s]
LEAST = 4.0  # [m] that it has to lead on: before somebody who stands it would only creep up to him
HELD = 0.5  # [m/s²] less than that left by others holds it up

_WALKER = int(ActorClass.WALKER)


class Dash:
    """Decides on it, and keeps to what it has begun.

    Attributes:
        is_on: Whether it takes a gap now.
        pull: Acceleration with which it does [m/s²].
    """

    def __init__(self) -> None:
        self.is_on, self.pull = False, PULL
        self._since = 0.0

    def update(
        self,
        ego: Ego,
        met: Meetings,
        forecast: Forecast,
        yields: NDArray[np.bool_],
        allowed: Floats,
        patience: float,
        time: float,
    ) -> bool:
        """Whether to go now, whatever the usual distances say.

        Args:
            ego: Where it is.
            met: What the forecasts mean for it.
            forecast: Where others will be.
            yields: (H,) who brakes for somebody who has come before it.
            allowed: (S,) speeds along the whole way [m/s].
            patience: 1 at first; falls to 0 while it stands for others.
            time: Now [s].
        """
        others = met.acceleration[~met.follows]
        is_held = bool(len(others)) and float(others.min()) < HELD
        if not self.is_on:
            if not is_held or ego.speed > SLOW or patience > WAITED:
                return False
            self._since = time
        elif time - self._since > LASTS or not np.any(met.enters[~met.follows] >= 0.0):
            self.is_on = False
            return False
        spare, room, least = (SPARE_UNDER_WAY, ROOM_UNDER_WAY, 0.0) if self.is_on else (SPARE, ROOM, LEAST)
        ahead = allowed[round(met.base / STEP) :]
        start = ego.s - met.base
        meets = (met.enters, met.leaves, forecast.kind, yields)
        self.is_on, limit, until = _leads_through(*meets, start, ego.speed, ahead, spare, room, least, PULL, 0.0)
        if self.is_on and limit < PULL:  # somebody has to pass first
            self.is_on, _, _ = _leads_through(*meets, start, ego.speed, ahead, spare, room, least, limit, until)
        self.pull = limit
        return self.is_on


@kernel
def _leads_through(
    enters: Floats,
    leaves: Floats,
    kind: NDArray[np.uint8],
    yields: NDArray[np.bool_],
    start: float,
    speed: float,
    allowed: Floats,
    spare: float,
    room: float,
    least: float,
    pull: float,
    until: float,
) -> tuple[bool, float, float]:
    """Drives on with `pull` for `until` seconds and with `PULL` then; who is ahead when their ways meet passes first.

    Returns:
        Whether that leads on before all others, by `least` metres or more, the largest acceleration up to `PULL`
        [m/s²] that comes near nobody ahead, and how long it is needed [s].
    """
    begun, limit, lasts = speed, PULL, 0.0
    count, last = len(enters), len(allowed) - 1
    is_ahead, is_behind = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    place = start
    for k in range(COUNT):
        for h in range(count):
            if enters[h, k] < 0.0:
                continue
            margin = (max(spare, SPARE_WALKER) if kind[h] == _WALKER else spare) * speed + room
            low, high = STEP * enters[h, k], STEP * leaves[h, k]
            if is_ahead[h]:
                if place > low - 0.3:
                    return False, limit, lasts
            elif place - margin > high:
                is_behind[h] = True
            elif is_behind[h]:
                if not yields[h]:
                    return False, limit, lasts
            elif place + margin < low:
                is_ahead[h] = True
            else:
                return False, limit, lasts
        if k + 1 == COUNT:
            break
        cap = math.inf
        for h in range(count):
            if is_ahead[h] and enters[h, k + 1] >= 0.0:
                cap = min(cap, STEP * enters[h, k + 1] - max(room, BEHIND))
        gain = (pull if k * DT < until else PULL) * DT / 3.0
        for _ in range(3):
            top = allowed[min(int(place / STEP), last)]
            speed = max(min(speed + gain, max(top, speed - PULL * DT / 3.0)), 0.0)
            place += speed * DT / 3.0
        if place > cap:
            speed = max(speed - (place - cap) / DT, 0.0)
            place = max(cap, start)
            time, way = (k + 1) * DT, place - start
            needed = 2.0 * (way - begun * time) / (time * time)
            if begun + needed * time < 0.0:
                needed = -begun * begun / (2.0 * max(way, 0.1))
            if needed < limit:
                limit, lasts = needed, time
    return place - start >= least, limit, lasts
