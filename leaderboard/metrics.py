"""What a drive was like beside its score: Bench2Drive's efficiency and smoothness, and measures of our own.

None of it changes a score. Sources: reference `leaderboard.md` 6.5 for Bench2Drive's; time to contact, distances,
braking and speeding are ours.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.types import DT
from lavsim.world.snapshot import Snapshot
from leaderboard.contact_time import nearest_contact_around
from leaderboard.criteria.min_speed import MinSpeed
from leaderboard.rules import get_rules

if TYPE_CHECKING:
    from lavsim.episode import EpisodeResult
    from lavsim.simulation import Simulation

Floats = NDArray[np.float64]

RANGE = 40.0  # [m] within which others are looked at
HORIZON = 1.5  # [s] contact foreseen within it is critical
HARSH = 4.0  # [m/s²] of braking
SPEEDING = 1.0  # [m/s] above the limit that are let pass
LEVEL = 3.0  # [m] others farther above or below don't meet the ego
MOST_EFFICIENT = 1000.0  # [%] larger percentages are dropped

SAMPLE_EVERY = 2  # ticks: Bench2Drive samples at 10 Hz
PIECE = 20  # samples judged together
SMOOTH_WINDOW, SMOOTH_ORDER = 7, 2  # of the Savitzky-Golay filter
# Bounds of a comfortable piece, after nuPlan's.
LONGITUDINAL = (-4.05, 2.40)  # [m/s²]
LATERAL = 4.89  # [m/s²]
JERK, LONGITUDINAL_JERK = 8.37, 4.13  # [m/s³]
YAW_RATE, YAW_ACCELERATION = 0.95, 1.93  # [rad/s], [rad/s²]

JUNCTION_BEYOND = 8.0  # [m] past the start of the first junction


@dataclass(frozen=True)
class DriveMetrics:
    """Measures of one drive.

    Attributes:
        efficiency: Mean of the percentages of the surrounding traffic's speed (Bench2Drive) [%]; None without traffic.
        smoothness: Share of comfortable pieces of 2 s (Bench2Drive); None for a drive shorter than that.
        first_junction: Percent of the route that ends 8 m into its first junction; None without one.
        mean_speed: [m/s].
        speeding_seconds: Time spent faster than the limit and a little more [s].
        top_excess: Highest speed above the limit [m/s].
        critical_seconds: Time with a contact foreseen within 1.5 s [s].
        least_contact_time: Shortest time to contact [s]; None if nobody came that near.
        least_distance: To the nearest other actor's box [m]; None if nobody came within 40 m.
        harsh_brakings: Times that braking exceeded 4 m/s².
        mean_jerk: Mean of the absolute longitudinal jerk [m/s³].
    """

    efficiency: float | None = None
    smoothness: float | None = None
    first_junction: float | None = None
    mean_speed: float = 0.0
    speeding_seconds: float = 0.0
    top_excess: float = 0.0
    critical_seconds: float = 0.0
    least_contact_time: float | None = None
    least_distance: float | None = None
    harsh_brakings: int = 0
    mean_jerk: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """The measures with 4 decimals, which is more than they are good for."""
        return {key: round(value, 4) if isinstance(value, float) else value for key, value in asdict(self).items()}


@dataclass
class MetricsObserver:
    """Watches a drive for its measures; sees snapshots alone, live or recorded."""

    _motion: list[tuple[float, float, float, float]] = field(default_factory=list)
    _places: list[tuple[float, float, float]] = field(default_factory=list)
    _critical: int = 0
    _contact_time: float = math.inf
    _distance: float = math.inf

    def start(self, simulation: Simulation) -> None:
        self.watch(simulation.town, simulation.route)

    def finish(self, result: EpisodeResult) -> None:
        """Nothing more is to be done."""

    def watch(self, town: TownMap, route: Route) -> None:
        """Prepares for a drive of `route`."""
        self._town, self._route = town, route
        self._min_speed = MinSpeed(get_rules("bench2drive"))
        self._min_speed.start(town, route)

    def observe(self, snapshot: Snapshot) -> None:
        """Sees a tick."""
        ego, motion = snapshot.ego, snapshot.ego_motion
        self._motion.append((ego.speed, float(motion[0]), float(motion[1]), float(motion[5])))
        self._places.append((ego.x, ego.y, ego.z))
        self._min_speed.update(snapshot)
        distance, time = nearest_contact_around(
            snapshot.xyz, snapshot.yaw, snapshot.velocities, snapshot.sizes, RANGE, LEVEL, HORIZON
        )
        self._distance = min(self._distance, distance)
        self._contact_time = min(self._contact_time, time)
        self._critical += time < HORIZON

    def metrics(self) -> DriveMetrics:
        """The measures so far."""
        if not self._motion:
            return DriveMetrics(first_junction=_first_junction(self._town, self._route))
        self._min_speed.finish()
        speed, ahead, aside, yaw_rate = np.array(self._motion).T
        excess = speed - self._limits()
        braking = ahead < -HARSH
        percentages = [p for p in self._min_speed.percentages if p <= MOST_EFFICIENT]
        return DriveMetrics(
            efficiency=float(np.mean(percentages)) if percentages else None,
            smoothness=smoothness(ahead, aside, yaw_rate),
            first_junction=_first_junction(self._town, self._route),
            mean_speed=float(speed.mean()),
            speeding_seconds=float(np.count_nonzero(excess > SPEEDING) * DT),
            top_excess=max(float(excess.max()), 0.0),
            critical_seconds=self._critical * DT,
            least_contact_time=self._contact_time if math.isfinite(self._contact_time) else None,
            least_distance=self._distance if math.isfinite(self._distance) else None,
            harsh_brakings=int(np.count_nonzero(braking[1:] & ~braking[:-1])) + int(braking[0]),
            mean_jerk=float(np.abs(np.diff(ahead)).mean() / DT) if len(ahead) > 1 else 0.0,
        )

    def _limits(self) -> Floats:
        """Speed limit (T,) of the lane below the ego at each tick [m/s]."""
        lanes = self._town.nearest(np.array(self._places)).lane
        limits: Floats = self._town.lanes.speed_limit[lanes]
        return limits


def smoothness(ahead: Floats, aside: Floats, yaw_rate: Floats) -> float | None:
    """Share of comfortable pieces of 2 s, as Bench2Drive counts them; None without a whole piece.

    Its code holds the smoothed yaw RATE against the bound of the yaw acceleration; so do we.

    Args:
        ahead: (T,) longitudinal acceleration of every tick [m/s²].
        aside: (T,) lateral acceleration [m/s²].
        yaw_rate: (T,) [rad/s].
    """
    from scipy.signal import savgol_filter

    samples = np.stack([ahead, aside, yaw_rate])[:, ::SAMPLE_EVERY]
    count = samples.shape[1] // PIECE
    if count == 0:
        return None
    pieces = samples[:, : count * PIECE].reshape(3, count, PIECE)
    step = SAMPLE_EVERY * DT
    along, across, turn = savgol_filter(pieces, SMOOTH_WINDOW, SMOOTH_ORDER, axis=-1)
    magnitude = savgol_filter(np.hypot(pieces[0], pieces[1]), SMOOTH_WINDOW, SMOOTH_ORDER, deriv=1, delta=step, axis=-1)
    jerk = savgol_filter(pieces[0], SMOOTH_WINDOW, SMOOTH_ORDER, deriv=1, delta=step, axis=-1)
    fine = (
        (along > LONGITUDINAL[0]) & (along < LONGITUDINAL[1]) & (np.abs(across) < LATERAL)
        & (np.abs(magnitude) < JERK) & (np.abs(jerk) < LONGITUDINAL_JERK)
        & (np.abs(turn) < YAW_RATE) & (np.abs(turn) < YAW_ACCELERATION)
    )  # fmt: skip
    return float(fine.all(axis=-1).mean())


def _first_junction(town: TownMap, route: Route) -> float | None:
    """Percent of the route up to 8 m beyond the start of its first junction."""
    inside = np.flatnonzero(town.lanes.junction[route.lane] >= 0)
    if not len(inside):
        return None
    return min(100.0 * (float(route.distance[inside[0]]) + JUNCTION_BEYOND) / float(route.distance[-1]), 100.0)
