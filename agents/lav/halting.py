"""How fast the ego may drive towards lights, stop signs and whoever is in the way.

A brake network that tells causes says what holds the ego and how far the line is: it then drives up to the line and
leaves when the light is green. One that tells only whether to stop goes through `controller.BrakeHold`.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.lav.config import DriveConfig
from lavsim.types import DT

Floats = NDArray[np.float64]

FREE = math.inf  # [m/s] nothing holds
_STANDS = 0.1  # [m/s]
_FAR = 18.0  # [m]
_AVERAGED, _FIRST_LOOKS = 8.0, 0.5  # [m] driven over which distances are averaged; what looks at first weigh
_LOOKS = 3  # of the network, whose median counts
_LIGHT_NEAR, _LIGHT_GONE = 12.0, 3.0  # [m] nearer, a light holds until green is told, or none for so long [s]
_LIGHT_SEEN = 0.3  # that there is a light at all
_SIGN_NEAR = 15.0  # [m] signs farther away are not stopped for yet
_SIGN_STAND, _SIGN_GONE = 1.0, 2.0  # [s] to stand; not seen for so long, a sign is another one
_OVER_LINE = 2.0  # [m]
_HARD = 4.0  # [m/s²] braking for a yellow light harder than this is worse than to drive on


class Told(NamedTuple):
    """What a brake network that tells causes says.

    Attributes:
        stop: Probability that the expert would stop; a network that tells no causes says this alone.
        red, yellow, green: Of the light that governs the ego.
        sign: That a stop sign is ahead.
        others: That somebody in the way stops it.
        distance: From the ego's front to the line of that light or sign [m].
    """

    stop: float
    red: float = 0.0
    yellow: float = 0.0
    sign: float = 0.0
    others: float = 0.0
    distance: float = 0.0
    green: float = 0.0
    tells_causes: bool = False


class Line:
    """How far the line ahead is: the mean of what was told over the last metres, carried along as the ego drives.

    Far lines are told too near, near ones too far, by some metres each. So looks from afar do not count on, and looks
    from the same place add nothing: an ego that stands would creep over the line.
    """

    def __init__(self) -> None:
        self._distance: float | None = None
        self._driven = 0.0  # [m] since it is told

    def update(self, distance: float, is_told: bool, moved: float) -> float:
        """The distance [m] now, of that told now, if it is, and the way since the last tick [m]."""
        if self._distance is None or (is_told and distance > _FAR):
            self._distance, self._driven = distance, _FIRST_LOOKS
            return distance
        weight = max(moved, _FIRST_LOOKS / 25.0 if self._driven < 2.0 * _FIRST_LOOKS else 0.0)
        self._driven = min(self._driven + weight, _AVERAGED)
        self._distance -= moved
        self._distance += is_told * weight / self._driven * (distance - self._distance)
        return self._distance

    @property
    def distance(self) -> float:
        """[m] as it was last; infinite where there is none."""
        return math.inf if self._distance is None else self._distance

    def forget(self) -> None:
        """There is no line."""
        self._distance = None


class Signals:
    """Lights and stop signs: the speed that they allow."""

    def __init__(self, config: DriveConfig) -> None:
        self._config = config
        self._halts: deque[float] = deque([0.0] * _LOOKS, maxlen=_LOOKS)
        self._greens: deque[float] = deque([0.0] * _LOOKS, maxlen=_LOOKS)
        self._signs: deque[float] = deque([0.0] * _LOOKS, maxlen=_LOOKS)
        self._light, self._sign = Line(), Line()
        self._holds, self._unlit = False, 0  # ticks that no light is told
        self._has_waited = False
        self._passes = False  # a yellow light too near to stop, or a line that lies behind
        self._stood, self._unseen, self._is_done = 0, 0, False

    def step(self, told: Told, is_new: bool, speed: float) -> float:
        """The speed [m/s] that is allowed now.

        Args:
            told: The network's newest word.
            is_new: Whether it was said at this tick.
            speed: Of the ego [m/s].
        """
        if is_new:
            self._waits(told, speed)
            self._halts.append(told.red + told.yellow * (not self._has_waited))
            self._greens.append(told.green)
            self._signs.append(told.sign)
        return min(self._at_light(told, speed), self._at_sign(told, speed))

    def _at_light(self, told: Told, speed: float) -> float:
        config = self._config
        if not self._is_lit():
            self._light.forget()
            self._passes = False
            return FREE
        distance = self._light.update(told.distance, told.red + told.yellow > config.light_score, speed * DT)
        if told.yellow > told.red:
            self._passes |= speed * speed > 2.0 * _HARD * max(distance, 0.0)
        self._passes |= distance < -_OVER_LINE  # past it, lights told are those opposite
        if self._passes:
            return FREE
        return allowed_speed(distance - config.light_gap, config)

    def _waits(self, told: Told, speed: float) -> None:
        """Whether it has stood before this light: it is then held by red alone.

        Yellow does not last, and a green light that is taken for yellow would hold it for good.
        """
        is_another = told.distance > _FAR or told.red + told.yellow + told.green < _LIGHT_SEEN
        self._has_waited = (self._holds and speed < _STANDS) or (self._has_waited and not is_another)

    def _is_lit(self) -> bool:
        """Whether a light ahead is red or yellow: near the line, lamps leave the view, and yellow is often missed."""
        if np.median(self._halts) >= self._config.light_score:
            self._holds, self._unlit = True, 0
            return True
        self._unlit += 1
        is_far = self._light.distance > _LIGHT_NEAR
        self._holds &= not (is_far or np.median(self._greens) > 0.5 or self._unlit * DT >= _LIGHT_GONE)
        return self._holds

    def _at_sign(self, told: Told, speed: float) -> float:
        """Stands once before each sign."""
        config = self._config
        is_seen = float(np.median(self._signs)) > config.sign_score
        self._unseen = 0 if is_seen else self._unseen + 1
        if self._unseen * DT >= _SIGN_GONE:
            self._is_done = False
        if not is_seen or self._is_done or told.distance > _SIGN_NEAR:
            self._sign.forget()
            self._stood = 0
            return FREE
        self._stood = self._stood + 1 if speed < _STANDS else 0
        self._is_done = self._stood * DT >= _SIGN_STAND
        distance = self._sign.update(told.distance, told.sign > config.sign_score, speed * DT)
        return allowed_speed(distance - config.sign_gap, config)


def allowed_speed(room: float, config: DriveConfig) -> float:
    """The speed [m/s] from which gentle braking stops within `room` [m]; 0 where that is no room at all."""
    speed = math.sqrt(2.0 * config.comfort * max(room, 0.0))
    return speed if speed > config.stop_below else 0.0


def room_before(plan: Floats, touch: NDArray[np.bool_]) -> float:
    """Way [m] along a plan (T, 2) to the last waypoint before anybody is touched; (T,) where that is so."""
    if not touch.any():
        return math.inf
    steps = np.hypot(*np.diff(plan, axis=0, prepend=np.zeros((1, 2))).T)
    return float(steps[: int(np.argmax(touch))].sum())
