"""How critical a drive was: time to contact, required deceleration and time headway of every tick.

Everybody is expected to go straight on with the velocity of the moment, so all three are what a driver could know then,
not what became of it. Definitions:

- time to contact (TTC): until boxes touch; Hayward 1972, "Near-miss determination through use of a scale of danger".
- required deceleration: the least constant braking along the ego's way with which it touches nobody while it moves.
  For a leader in the same lane it is the deceleration rate to avoid a crash, DRAC; Cooper & Ferguson 1976, "Traffic
  studies at T-junctions 2: a conflict simulation record". In the plane it is `a_long,req` of Westhofen et al. 2023,
  "Criticality metrics for automated driving: a review and suitability analysis of the state of the art".
- time headway (THW): until the ego is where another is now; same review.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.types import Role
from lavsim.world.blueprints import find_blueprint
from lavsim.world.snapshot import Snapshot
from leaderboard.contact_time import nearest_contact, separation

if TYPE_CHECKING:
    from lavsim.episode import EpisodeResult
    from lavsim.simulation import Simulation

Floats = NDArray[np.float64]

HORIZON = 4.0  # [s] looked ahead
REACH = 80.0  # [m] within which others are looked at
LEVEL = 3.0  # [m] others farther above or below don't meet the ego
MOST_BRAKING = 10.0  # [m/s²]: what needs more can't be braked for
MOVES = 0.5  # [m/s] slower egos need not brake
_STEP = 0.05  # [s] between the moments that are tested
_HALVINGS = 8
_NEAR = np.array([REACH, REACH, LEVEL])


@dataclass(frozen=True)
class Criticality:
    """The worst moments of a drive.

    Attributes:
        contact_time: Least time to contact [s]; None: none within 4 s.
        deceleration: Largest required deceleration [m/s²], at most 10.
        headway: Least time headway [s]; None: never within 4 s of anybody's place.
    """

    contact_time: float | None = None
    deceleration: float = 0.0
    headway: float | None = None

    @property
    def margin(self) -> float:
        """1 where nobody came near, towards 0 as contact does: half by time to contact, half by braking."""
        time = HORIZON if self.contact_time is None else self.contact_time
        return 0.5 * time / HORIZON + 0.5 * (1.0 - self.deceleration / MOST_BRAKING)

    def to_json(self) -> dict[str, Any]:
        """The same with four decimals."""
        return {key: None if value is None else round(value, 4) for key, value in asdict(self).items()}


class CriticalityObserver:
    """Watches a drive, live or recorded.

    Args:
        from_hazard: Whether it begins to look when the first hazard is set off, instead of at once.

    Attributes:
        begun: Tick at which the first hazard was set off; -1: none was.
    """

    def __init__(self, from_hazard: bool = True) -> None:
        self._from_hazard = from_hazard
        self._rows: list[tuple[float, float, float]] = []
        self._nearby = Nearby()
        self.begun = -1

    def start(self, simulation: Simulation) -> None:
        """Nothing to prepare."""

    def finish(self, result: EpisodeResult) -> None:
        """Nothing more is to be done."""

    def observe(self, snapshot: Snapshot) -> str | None:
        """Sees a tick."""
        if self.begun < 0 and len(snapshot.hazards):
            self.begun = snapshot.tick
        if self.begun >= 0 or not self._from_hazard:
            self._rows.append(self._moment(snapshot))
        return None

    @property
    def series(self) -> Floats:
        """(T, 3) time to contact [s], required deceleration [m/s²], headway [s] of each tick looked at."""
        return np.array(self._rows, dtype=np.float64).reshape(-1, 3)

    @property
    def criticality(self) -> Criticality:
        """The worst so far."""
        series = self.series
        if not len(series):
            return Criticality()
        time, headway = float(series[:, 0].min()), float(series[:, 2].min())
        return Criticality(
            time if math.isfinite(time) else None,
            float(series[:, 1].max()),
            headway if math.isfinite(headway) else None,
        )

    def _moment(self, snapshot: Snapshot) -> tuple[float, float, float]:
        near = self._nearby.of(snapshot)
        if len(near.xy) < 2:
            return math.inf, 0.0, math.inf
        _, time = nearest_contact(near.xy, near.yaw, near.velocity, near.sizes, HORIZON)
        if float(np.hypot(*near.velocity[0])) < MOVES:
            return time, 0.0, math.inf
        near = near.before()
        deceleration = required_deceleration(near.xy, near.yaw, near.velocity, near.sizes, HORIZON)
        still = near.velocity * (np.arange(len(near.velocity)) == 0)[:, None]
        _, headway = nearest_contact(near.xy, near.yaw, still, near.sizes, HORIZON)
        return time, deceleration, headway


def criticality_of(snapshots: Iterable[Snapshot], from_hazard: bool = True) -> tuple[Criticality, int]:
    """How critical a drive was, and the tick at which its first hazard was set off; -1: none was.

    Args:
        snapshots: All ticks, a log's for example.
        from_hazard: Whether only ticks from then on count.
    """
    observer = CriticalityObserver(from_hazard)
    for snapshot in snapshots:
        observer.observe(snapshot)
    return observer.criticality, observer.begun


class Boxes(NamedTuple):
    """The ego (row 0) and others: centres (N, 2) [m], yaw (N,) [rad], velocities (N, 2) [m/s], sizes (N, 2) [m]."""

    xy: Floats
    yaw: Floats
    velocity: Floats
    sizes: NDArray[np.float32]

    def before(self) -> Boxes:
        """The ego and those whose middle is not behind its front axle: braking helps against these alone."""
        yaw = self.yaw[0]
        ahead = (self.xy - self.xy[0]) @ np.array([np.cos(yaw), np.sin(yaw)]) > 0.25 * self.sizes[0, 0]
        ahead[0] = True
        return Boxes(*(each[ahead] for each in self))


class Nearby:
    """Finds who is near the ego, can be touched, and is no car parked at the kerb: in a bend those stand ahead."""

    def __init__(self) -> None:
        self._counts = np.zeros(0, dtype=np.bool_)

    def of(self, snapshot: Snapshot) -> Boxes:
        """The ego and those within `REACH`."""
        table = snapshot.table
        if len(self._counts) < len(table.ids):
            solid = np.array([find_blueprint(name).is_solid for name in table.blueprints], dtype=np.bool_)
            self._counts = solid & (table.roles != Role.PARKED)
        near = (np.abs(snapshot.xyz - snapshot.xyz[0]) < _NEAR).all(axis=1) & self._counts[snapshot.rows]
        near[0] = True
        xyz, velocity, sizes = snapshot.xyz[near, :2], snapshot.velocities[near, :2], snapshot.sizes[near, :2]
        return Boxes(xyz, snapshot.yaw[near], velocity, sizes)


@kernel
def required_deceleration(
    xy: Floats, yaw: Floats, velocity: Floats, sizes: NDArray[np.float32], horizon: float
) -> float:
    """Least constant braking of the ego with which it touches nobody while it moves [m/s²], at most `MOST_BRAKING`.

    Args:
        xy: (N, 2) centres [m]; row 0 is the ego.
        yaw: (N,) [rad].
        velocity: (N, 2) [m/s]; all but the ego keep theirs.
        sizes: (N, 2) full length and width [m].
        horizon: Contact that comes later without braking is not looked for [s].
    """
    needed = 0.0
    for k in range(1, len(xy)):
        if not _touches(xy, yaw, velocity, sizes, k, 0.0, horizon):
            continue
        seen = 2.0 * horizon  # a leader who would be touched after t is touched after 2 t with just too little braking
        low, high = needed, MOST_BRAKING
        if not _touches(xy, yaw, velocity, sizes, k, low, seen):
            continue
        if _touches(xy, yaw, velocity, sizes, k, high, seen):
            return MOST_BRAKING
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if _touches(xy, yaw, velocity, sizes, k, middle, seen):
                low = middle
            else:
                high = middle
        needed = high
    return needed


@kernel
def _touches(
    xy: Floats, yaw: Floats, velocity: Floats, sizes: NDArray[np.float32], k: int, braking: float, horizon: float
) -> bool:
    """Whether the ego, braking, touches the box of row `k` before it stands."""
    dx, dy = xy[k, 0] - xy[0, 0], xy[k, 1] - xy[0, 1]
    speed = math.sqrt(velocity[0, 0] ** 2 + velocity[0, 1] ** 2)
    cos, sin = velocity[0, 0] / speed, velocity[0, 1] / speed
    reach = 0.5 * (math.sqrt(sizes[0, 0] ** 2 + sizes[0, 1] ** 2) + math.sqrt(sizes[k, 0] ** 2 + sizes[k, 1] ** 2))
    closing = speed + math.sqrt(velocity[k, 0] ** 2 + velocity[k, 1] ** 2)
    if math.sqrt(dx * dx + dy * dy) - reach > closing * horizon:
        return False
    stands = min(horizon, speed / braking) if braking > 0.0 else horizon
    steps = math.ceil(stands / _STEP)
    for step in range(steps + 1):
        time = min(step * _STEP, stands)
        gone = speed * time - 0.5 * braking * time * time
        x, y = dx + velocity[k, 0] * time - cos * gone, dy + velocity[k, 1] * time - sin * gone
        apart = max(
            separation(x, y, yaw[0], yaw[k], sizes[0], sizes[k]),
            separation(-x, -y, yaw[k], yaw[0], sizes[k], sizes[0]),
        )
        if apart <= 0.0:
            return True
    return False
