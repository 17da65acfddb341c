"""What the brake network learns of each frame beside the expert's full stop: light, stop sign, others, and how far."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.lav.data.staged import Told
from lavsim.dataset.reader import Dataset
from lavsim.types import LightState

Floats = NDArray[np.float64]

LIGHT_REACH, LIGHT_BEYOND = 40.0, 60.0  # [m] to the line: told until the first, none from the second on
SIGN_REACH, SIGN_BEYOND = 25.0, 40.0
_OVER = -2.0  # [m] nothing is asked of frames that stand on the line
NONE, RED, YELLOW, GREEN = range(4)  # kinds of light
OPEN = -1  # asked by nobody
_STANDS, _SLOW = 0.1, 3.0  # [m/s]
_WAITING_STRIDE = 5  # of frames in which the ego waits every fifth
_RARE = 3  # times
_KINDS = {LightState.RED: RED, LightState.YELLOW: YELLOW, LightState.GREEN: GREEN}
_ALONE = ("light", "stop_sign", "goal", "none")  # causes that are no road user's


class Signals(NamedTuple):
    """Truths of frames; all (N,), -1 or NaN where nothing is asked.

    Attributes:
        stop: Whether the expert made a full stop.
        light: `NONE`, `RED`, `YELLOW` or `GREEN`: the state of the light that governs the ego.
        sign: Whether a stop sign is ahead.
        others: Whether the expert stopped for somebody or something in the way.
        distance: From the ego's front to the line of that light or sign [m].
    """

    stop: NDArray[np.int64]
    light: NDArray[np.int64]
    sign: NDArray[np.int64]
    others: NDArray[np.int64]
    distance: Floats

    def at(self, chosen: NDArray[np.int64]) -> Signals:
        """Those of chosen frames."""
        return Signals(
            self.stop[chosen], self.light[chosen], self.sign[chosen], self.others[chosen], self.distance[chosen]
        )


def staged_signals(told: Told) -> Signals:
    """Truths of rendered approaches; what the expert would have done is not known."""
    light, sign = lights_of(told.state, told.light_distance), signs_of(told.sign_distance)
    distance = _nearer(light, told.light_distance, sign, told.sign_distance)
    unknown = np.full(len(light), OPEN)
    return Signals(unknown, light, sign, unknown, distance)


def recorded_signals(data: Dataset, frames: NDArray[np.int64]) -> Signals:
    """Truths of recorded frames (N, 2)."""
    state, to_light, to_sign = (
        column_of(data, frames, name) for name in ("light_state", "light_distance", "stop_sign_distance")
    )
    stop = column_of(data, frames, "brake").astype(np.int64)
    is_other = ~np.isin(column_of(data, frames, "brake_cause"), _ALONE)
    light, sign = lights_of(state, to_light), signs_of(to_sign)
    return Signals(stop, light, sign, stop * is_other, _nearer(light, to_light, sign, to_sign))


def repeats_of(data: Dataset, frames: NDArray[np.int64], truth: Signals) -> NDArray[np.int64]:
    """How often (N,) each recorded frame is learnt from: long waits seldom, what is rare several times."""
    speeds, causes = np.abs(column_of(data, frames, "speed")), column_of(data, frames, "brake_cause")
    repeats = np.ones(len(frames), np.int64)
    waits = (speeds < _STANDS) & (truth.stop == 1)
    repeats[waits] = frames[waits, 1] % _WAITING_STRIDE == 0
    rare = (truth.sign == 1) | np.isin(causes, ("walker", "prop")) | ((truth.light == GREEN) & (speeds < _SLOW))
    repeats[rare & ~waits] = _RARE
    return repeats


def column_of(data: Dataset, frames: NDArray[np.int64], name: str) -> NDArray[Any]:
    """(N, …) a column of the tables at frames (N, 2)."""
    parts = {episode: np.asarray(data.table(episode)[name]) for episode in dict.fromkeys(frames[:, 0].tolist())}
    found = [parts[episode][frame] for episode, frame in frames.tolist()]
    return np.array(found, str) if name == "brake_cause" else np.array(found)


def lights_of(state: NDArray[np.generic], distance: Floats) -> NDArray[np.int64]:
    """Kinds (N,) of lights in states (N,) ahead by (N,) metres, NaN where there is none."""
    kinds = np.array([_KINDS.get(LightState(int(value)), NONE) for value in state], np.int64)
    ahead = np.nan_to_num(distance, nan=np.inf)
    kinds[(ahead >= LIGHT_BEYOND) | (ahead <= _OVER)] = NONE
    kinds[((ahead > LIGHT_REACH) & (ahead < LIGHT_BEYOND)) | ((ahead > _OVER) & (ahead <= 0.0))] = OPEN
    return kinds


def signs_of(distance: Floats) -> NDArray[np.int64]:
    """Whether (N,) a stop sign is ahead by (N,) metres, NaN where there is none."""
    ahead = np.nan_to_num(distance, nan=np.inf)
    signs = ((ahead > 0.0) & (ahead <= SIGN_REACH)).astype(np.int64)
    signs[((ahead > SIGN_REACH) & (ahead < SIGN_BEYOND)) | ((ahead > _OVER) & (ahead <= 0.0))] = OPEN
    return signs


def joined(parts: tuple[Signals, ...]) -> Signals:
    """One after the other."""
    return Signals(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _nearer(light: NDArray[np.int64], to_light: Floats, sign: NDArray[np.int64], to_sign: Floats) -> Floats:
    lit = np.where(light > NONE, to_light, np.inf)
    signed = np.where(sign == 1, to_sign, np.inf)
    nearest = np.minimum(lit, signed)
    return np.where(np.isfinite(nearest), nearest, np.nan)
