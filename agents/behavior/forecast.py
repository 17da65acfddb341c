"""Where others will be in the next seconds: along their lanes where they keep one, straight or turning otherwise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.behavior.road import TRACK_STEP, Track, TrackBook
from lavsim.geometry import wrap_angle
from lavsim.kernel import kernel
from lavsim.types import ActorClass, LightState, RoadOption, VehicleLight

Floats = NDArray[np.float64]

DT = 0.3  # [s] between forecast poses
COUNT = 21  # 0 to 6 s
TIMES: Floats = np.arange(COUNT, dtype=np.float64) * DT
ON_LANE = 1.3  # [m] off the centre, and …
ALONG_LANE = 0.6  # [rad] off the direction of a lane that a vehicle is taken to follow
MEMORY = 0.3  # [s] over which measured accelerations and turn rates are averaged


@dataclass
class Forecast:
    """Ways of all others that matter, H of them; one actor may have several.

    Attributes:
        poses: (H, COUNT, 3) x, y [m], yaw [rad] of the box centre.
        half: (H, 2) half length and width [m].
        speed: (H,) now [m/s].
        row: (H,) row of the actor in the readings.
        is_walker: (H,).
        is_prop: (H,) things that never move.
    """

    poses: Floats
    half: Floats
    speed: Floats
    row: NDArray[np.int64]
    is_walker: NDArray[np.bool_]
    is_prop: NDArray[np.bool_]


class Forecaster:
    """Keeps the last speeds and headings of actors by id, to tell who brakes and who turns."""

    def __init__(self, book: TrackBook | None) -> None:
        self._book = book
        self._past: dict[int, tuple[float, float, float, float]] = {}  # id: speed, yaw, acceleration, turn rate
        self._time = -math.inf

    def update(self, truth: Mapping[str, Any], rows: NDArray[np.int64]) -> Forecast:
        """Forecast of the actors in `rows` of the truth reading."""
        ids, classes = truth["ids"][rows], truth["classes"][rows]
        xy, yaw = truth["xyz"][rows, :2], truth["yaw"][rows]
        velocity = truth["velocities"][rows, :2]
        speed = np.hypot(velocity[:, 0], velocity[:, 1])
        half = truth["sizes"][rows, :2] / 2.0
        acceleration, turn = self._changes(ids.tolist(), speed.tolist(), yaw.tolist(), float(truth["time"]))
        is_walker = classes == ActorClass.WALKER
        is_prop = classes == ActorClass.PROP
        is_vehicle = ~(is_walker | is_prop)
        # Vehicles slow down as they do now; nobody is taken to speed up for long.
        travelled = _travelled(speed, np.clip(acceleration, -6.0, 1.5))
        lights = truth["lights"]
        signals = truth["vehicle_lights"][rows]
        chosen: list[tuple[int, Track | None, float, float]] = []  # actor, track, place on it, offset
        hits = None
        if self._book is not None and is_vehicle.any():
            hits = self._book.town.nearest(xy)
        for i in range(len(rows)):
            if hits is None or not is_vehicle[i] or speed[i] < 0.3:
                chosen.append((i, None, 0.0, 0.0))
                continue
            off = abs(float(wrap_angle(yaw[i] - hits.yaw[i])))
            if hits.lane[i] < 0 or abs(hits.offset[i]) > ON_LANE or off > ALONG_LANE:
                chosen.append((i, None, 0.0, 0.0))
                continue
            assert self._book is not None
            u = float(hits.u[i])
            ways = _intended(self._book.of_lane(int(hits.lane[i])), int(signals[i]))
            chosen += [(i, way, u, float(hits.offset[i])) for way in ways]
        poses = np.empty((len(chosen), COUNT, 3))
        index = np.array([c[0] for c in chosen], dtype=np.int64)
        for h, (i, track, u, offset) in enumerate(chosen):
            if track is None:
                rate = turn[i] if is_vehicle[i] and speed[i] > 1.0 else 0.0
                heading = math.atan2(velocity[i, 1], velocity[i, 0]) if is_walker[i] and speed[i] > 0.1 else yaw[i]
                _roll_free(xy[i, 0], xy[i, 1], heading, rate, travelled[i], TIMES, poses[h])
            else:
                limit = math.inf
                for gate, light in track.gates:
                    room = gate - half[i, 0] - u
                    if room > -0.5 and lights[light] == LightState.RED:
                        limit = max(room, 0.0)
                        break
                _roll_track(track.poses, u, offset, travelled[i], limit, TRACK_STEP, TIMES, poses[h])
        return Forecast(poses, half[index], speed[index], rows[index], is_walker[index], is_prop[index])

    def _changes(self, ids: list[int], speeds: list[float], yaws: list[float], time: float) -> tuple[Floats, Floats]:
        """Averaged accelerations [m/s²] and turn rates [rad/s] since the last calls."""
        dt = time - self._time
        self._time = time
        acceleration, turn = np.zeros(len(ids)), np.zeros(len(ids))
        share = min(max(dt, 0.0) / MEMORY, 1.0)
        past, self._past = self._past, {}
        for k, (actor, speed, yaw) in enumerate(zip(ids, speeds, yaws, strict=True)):
            before = past.get(actor)
            if before is not None and 0.0 < dt < 1.0:
                a = before[2] + share * ((speed - before[0]) / dt - before[2])
                w = before[3] + share * (math.remainder(yaw - before[1], 2.0 * math.pi) / dt - before[3])
                acceleration[k], turn[k] = a, w
            self._past[actor] = (speed, yaw, float(acceleration[k]), float(turn[k]))
        return acceleration, turn


def _intended(tracks: tuple[Track, ...], signals: int) -> tuple[Track, ...]:
    """Those of `tracks` that fit the indicators; all where none fits."""
    if len(tracks) == 1 or tracks[0].is_inside:
        return tracks
    if signals & VehicleLight.LEFT_BLINKER:
        fitting = tuple(t for t in tracks if t.turn == RoadOption.LEFT)
    elif signals & VehicleLight.RIGHT_BLINKER:
        fitting = tuple(t for t in tracks if t.turn == RoadOption.RIGHT)
    else:
        fitting = tuple(t for t in tracks if t.turn in (RoadOption.STRAIGHT, RoadOption.LANEFOLLOW))
    return fitting or tracks


def _travelled(speed: Floats, acceleration: Floats) -> Floats:
    """Distance (N, COUNT) [m] at the forecast times; changes of speed last 1.5 s, braking down to a stop."""
    v, a = speed[:, None], acceleration[:, None]
    span = np.minimum(TIMES[None], 1.5)
    braking = np.where(a < -0.3, v / np.maximum(-a, 0.3), np.inf)
    span = np.minimum(span, braking)
    level = np.maximum(v + a * span, 0.0)
    return np.maximum(v * span + 0.5 * a * span**2 + level * (TIMES[None] - span) * (TIMES[None] > span), 0.0)


@kernel
def _roll_free(x: float, y: float, yaw: float, rate: float, travelled: Floats, times: Floats, out: Floats) -> None:
    """Constant turn rate for 2 s, then straight."""
    px, py, heading = x, y, yaw
    out[0, 0], out[0, 1], out[0, 2] = px, py, heading
    for k in range(1, len(travelled)):
        step = travelled[k] - travelled[k - 1]
        turned = rate * (times[k] - times[k - 1]) if times[k] <= 2.0 else 0.0
        px += step * math.cos(heading + 0.5 * turned)
        py += step * math.sin(heading + 0.5 * turned)
        heading += turned
        out[k, 0], out[k, 1], out[k, 2] = px, py, heading


@kernel
def _roll_track(
    poses: Floats, u: float, offset: float, travelled: Floats, limit: float, step: float, times: Floats, out: Floats
) -> None:
    """Along a track from place `u`, not beyond `limit` metres; the offset from its centre fades."""
    last = len(poses) - 1
    for k in range(len(travelled)):
        at = min((u + min(travelled[k], limit)) / step, last - 1e-6)
        i = int(at)
        share = at - i
        a, b = poses[i], poses[i + 1]
        turned = b[2] - a[2]
        turned -= 2.0 * math.pi * math.floor(turned / (2.0 * math.pi) + 0.5)
        heading = a[2] + turned * share
        aside = offset * math.exp(-times[k] / 2.0)
        out[k, 0] = a[0] + (b[0] - a[0]) * share - aside * math.sin(heading)
        out[k, 1] = a[1] + (b[1] - a[1]) * share + aside * math.cos(heading)
        out[k, 2] = heading
