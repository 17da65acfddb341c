"""What is in a dataset, counted: speeds, commands, turns, brake causes, actors, distances and what was seen of them.

Statistics of episodes add up, so a dataset of any size is counted table by table.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.columns import WEATHER
from lavsim.dataset.schema import TICKS_PER_FRAME
from lavsim.dataset.tables import Column, Table
from lavsim.types import ActorClass, RoadOption, Role

_TURN_FRAMES = 10  # a turn is how far the heading goes in LAV's horizon of 2.5 s
_REACH = 50.0  # [m]
_STANDING = 0.1  # [m/s] slower is standing, as for the recorder
_RING = 10.0  # [m] of distance that "seen" is told for

COMMANDS: dict[int, str] = {
    RoadOption.LEFT: "left", RoadOption.RIGHT: "right", RoadOption.STRAIGHT: "straight",
    RoadOption.LANEFOLLOW: "follow", RoadOption.CHANGELANELEFT: "change left",
    RoadOption.CHANGELANERIGHT: "change right",
}  # fmt: skip


@dataclass(frozen=True)
class Histogram:
    """Counted numbers.

    Attributes:
        edges: (B + 1,) of the bins; what lies outside is counted in the first or last.
        counts: (B,).
        sum: Of the numbers.
        least, most: inf and -inf while there is none.
    """

    edges: NDArray[np.float64]
    counts: NDArray[np.int64]
    sum: float
    least: float
    most: float

    @staticmethod
    def of(values: NDArray[Any], edges: NDArray[np.float64]) -> Histogram:
        """That of `values`; what is not finite does not count."""
        values = np.asarray(values, np.float64)
        values = values[np.isfinite(values)]
        counts = np.histogram(np.clip(values, edges[0], edges[-1]), edges)[0].astype(np.int64)
        least, most = (float(values.min()), float(values.max())) if len(values) else (np.inf, -np.inf)
        return Histogram(edges, counts, float(values.sum()), least, most)

    def __add__(self, other: Histogram) -> Histogram:
        return Histogram(
            self.edges, self.counts + other.counts, self.sum + other.sum, min(self.least, other.least),
            max(self.most, other.most),
        )  # fmt: skip

    @property
    def total(self) -> int:
        """How many numbers."""
        return int(self.counts.sum())

    @property
    def mean(self) -> float:
        return self.sum / self.total if self.total else float("nan")

    def quantile(self, share: float) -> float:
        """The number that `share` of all lie below, to within a bin."""
        if not self.total:
            return float("nan")
        wanted, below = share * self.total, np.cumsum(self.counts)
        bin_ = int(np.searchsorted(below, wanted, side="left").clip(0, len(self.counts) - 1))
        inside = (wanted - (below[bin_] - self.counts[bin_])) / max(int(self.counts[bin_]), 1)
        value = self.edges[bin_] + inside * (self.edges[bin_ + 1] - self.edges[bin_])
        return float(np.clip(value, self.least, self.most))

    def to_json(self) -> dict[str, Any]:
        """Numbers of a table; empty when nothing was counted."""
        if not self.total:
            return {}
        named = {f"q{q:02d}": self.quantile(q / 100.0) for q in (5, 25, 50, 75, 95)}
        found = {"mean": self.mean, "least": self.least, **named, "most": self.most}
        return {"count": self.total, **{name: round(value, 4) + 0.0 for name, value in found.items()}}


@dataclass(frozen=True)
class Statistics:
    """Of an episode or many.

    Attributes:
        frames: How many.
        histograms: By name of `QUANTITIES`.
        shares: Counts by name, then by kind: command, motion, brake_cause, actor_class, weather.
        seen: (R, 2) of vehicles by rings of distance: how many any sensor saw, how many there were.
    """

    frames: int
    histograms: Mapping[str, Histogram]
    shares: Mapping[str, Mapping[str, int]]
    seen: NDArray[np.int64]

    def __add__(self, other: Statistics) -> Statistics:
        return Statistics(
            self.frames + other.frames,
            {name: histogram + other.histograms[name] for name, histogram in self.histograms.items()},
            {name: _added(counts, other.shares[name]) for name, counts in self.shares.items()},
            self.seen + other.seen,
        )

    def to_json(self) -> dict[str, Any]:
        """In JSON types."""
        return {
            "frames": self.frames,
            "quantities": {
                name: {"unit": QUANTITIES[name].unit, **histogram.to_json()}
                for name, histogram in self.histograms.items()
            },
            "shares": {name: dict(counts) for name, counts in self.shares.items()},
            "vehicles_seen": [
                {"from_m": ring * _RING, "to_m": (ring + 1) * _RING, "vehicles": int(there), "seen": int(seen)}
                for ring, (seen, there) in enumerate(self.seen)
            ],
        }


@dataclass(frozen=True)
class Quantity:
    """A number that is counted: what it is, its unit, its bins."""

    about: str
    unit: str
    edges: NDArray[np.float64]


def _bins(low: float, high: float, count: int) -> NDArray[np.float64]:
    return np.linspace(low, high, count + 1)


QUANTITIES: dict[str, Quantity] = {
    "speed": Quantity("of the ego", "km/h", _bins(0.0, 130.0, 260)),
    "steer": Quantity("as applied", "", _bins(-1.0, 1.0, 200)),
    "throttle": Quantity("as applied", "", _bins(0.0, 1.0, 100)),
    "turn": Quantity("of the heading in 2.5 s, to the right positive", "deg", _bins(-120.0, 120.0, 240)),
    "vehicles": Quantity("in a frame within the radius", "", _bins(-0.5, 120.5, 121)),
    "walkers": Quantity("in a frame within the radius", "", _bins(-0.5, 120.5, 121)),
    "vehicle_distance": Quantity("from the ego", "m", _bins(0.0, _REACH, 100)),
    "walker_distance": Quantity("from the ego", "m", _bins(0.0, _REACH, 100)),
    "vehicle_speed": Quantity("of others", "km/h", _bins(0.0, 130.0, 260)),
    "lidar_hits": Quantity("on a vehicle that is hit", "points", np.geomspace(1.0, 10_000.0, 81)),
    "sun_altitude": Quantity("", "deg", _bins(-90.0, 90.0, 180)),
}


def statistics_of(table: Table) -> Statistics:
    """Those of an episode's table; fields that it lacks count nothing."""
    numbers: dict[str, NDArray[Any]] = {name: np.zeros(0) for name in QUANTITIES}
    if "speed" in table.columns:
        numbers["speed"] = table["speed"] * 3.6
    if "control" in table.columns:
        numbers["throttle"], numbers["steer"] = table["control"][:, 0], table["control"][:, 1]
    if "yaw" in table.columns and "tick" in table.columns:
        numbers["turn"] = np.degrees(_turns(table["tick"], table["yaw"]))
    weather: dict[str, int] = {}
    if "weather" in table.columns:
        numbers["sun_altitude"] = table["weather"][:, WEATHER.index("sun_altitude_angle")]
        weather = _weathers(table["weather"])
    seen, classes = np.zeros((round(_REACH / _RING), 2), np.int64), {}
    if "actor_class" in table.columns:
        actors = _Actors(table)
        numbers |= actors.numbers()
        seen, classes = actors.seen(), actors.classes()
    commands = _counted([COMMANDS.get(int(c), "none") for c in _column(table, "command")])
    causes = _counted([str(cause) for cause in _column(table, "brake_cause")])
    return Statistics(
        len(table),
        {name: Histogram.of(numbers[name], quantity.edges) for name, quantity in QUANTITIES.items()},
        {
            "command": commands,
            "motion": _motion(table),
            "brake_cause": causes,
            "actor_class": classes,
            "weather": weather,
        },
        seen,
    )


def add_up(parts: Iterable[Statistics]) -> Statistics:
    """Statistics of all parts together."""
    return reduce(lambda total, part: total + part, parts, statistics_of(Table({})))


class _Actors:
    """All actors of all frames in rows, but for the ego."""

    def __init__(self, table: Table) -> None:
        columns = table.columns
        ends = columns["actor_class"].ends
        assert ends is not None
        self._frames = len(table)
        frame = np.repeat(np.arange(self._frames), np.diff(ends))
        others = columns["actor_role"].values != Role.EGO
        self._frame, self._columns, self._others = frame[others], columns, others
        kind = columns["actor_class"].values[others]
        self._kind = kind
        self._is_vehicle = kind <= ActorClass.BICYCLE
        self._is_walker = kind == ActorClass.WALKER
        offset = columns["actor_position"].values[others, :2] - table["position"][self._frame, :2]
        self._distance = np.hypot(offset[:, 0], offset[:, 1])

    def numbers(self) -> dict[str, NDArray[Any]]:
        found: dict[str, NDArray[Any]] = {}
        for name, chosen in (("vehicle", self._is_vehicle), ("walker", self._is_walker)):
            found[f"{name}s"] = np.bincount(self._frame[chosen], minlength=self._frames)
            found[f"{name}_distance"] = self._distance[chosen]
        velocity = self._columns["actor_velocity"].values[self._others][self._is_vehicle]
        found["vehicle_speed"] = np.hypot(velocity[:, 0], velocity[:, 1]) * 3.6
        if "actor_lidar_hits" in self._columns:
            hits = self._columns["actor_lidar_hits"].values[self._others][self._is_vehicle]
            found["lidar_hits"] = hits[hits > 0]
        return found

    def seen(self) -> NDArray[np.int64]:
        rings = np.zeros((round(_REACH / _RING), 2), np.int64)
        counts = [self._columns[name] for name in ("actor_lidar_hits", "actor_pixels") if name in self._columns]
        if not counts:
            return rings
        was_seen = np.zeros(len(self._kind), bool)
        for column in counts:
            values = column.values[self._others]
            was_seen |= (values > 0).any(axis=1) if values.ndim > 1 else values > 0
        ring = np.minimum(self._distance / _RING, len(rings) - 1).astype(np.int64)
        for place, chosen in enumerate((self._is_vehicle & was_seen, self._is_vehicle)):
            rings[:, place] = np.bincount(ring[chosen], minlength=len(rings))
        return rings

    def classes(self) -> dict[str, int]:
        counts = np.bincount(self._kind, minlength=len(ActorClass))
        return {kind.name.lower(): int(counts[kind]) for kind in ActorClass if counts[kind]}


def _turns(ticks: NDArray[np.int32], yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Change of heading [rad] over the next frames, where no time is left out."""
    if len(ticks) <= _TURN_FRAMES:
        return np.zeros(0)
    # Neighbouring frames turn by less than half a turn, so their differences add up past it.
    course = np.unwrap(yaw)
    joined = ticks[_TURN_FRAMES:] - ticks[:-_TURN_FRAMES] == _TURN_FRAMES * TICKS_PER_FRAME
    turned: NDArray[np.float64] = (course[_TURN_FRAMES:] - course[:-_TURN_FRAMES])[joined]
    return turned


def _motion(table: Table) -> dict[str, int]:
    """Frames in which the ego moves, stands, and, of either, those in which it is braked to a stop."""
    stands = np.abs(_column(table, "speed")) < _STANDING
    found = {
        "moves": int((~stands).sum()),
        "stands": int(stands.sum()),
        "full stop": int(_column(table, "brake").sum()),
    }
    return {name: count for name, count in found.items() if count}


def _weathers(weather: NDArray[np.float32]) -> dict[str, int]:
    """Frames by time of day and by what falls."""
    altitude = weather[:, WEATHER.index("sun_altitude_angle")]
    rain, fog = weather[:, WEATHER.index("precipitation")], weather[:, WEATHER.index("fog_density")]
    named = {
        "night": altitude < 0.0, "low sun": (altitude >= 0.0) & (altitude < 20.0), "day": altitude >= 20.0,
        "dry": rain < 1.0, "rain": rain >= 1.0, "fog": fog >= 20.0,
    }  # fmt: skip
    return {name: int(chosen.sum()) for name, chosen in named.items() if chosen.any()}


def _column(table: Table, name: str) -> NDArray[Any]:
    column: Column | None = table.columns.get(name)
    return column.values if column is not None else np.zeros(0)


def _counted(names: Sequence[str]) -> dict[str, int]:
    kinds, counts = np.unique(np.array(names, dtype=object).astype(str), return_counts=True)
    return {str(kind): int(count) for kind, count in zip(kinds, counts, strict=True)}


def _added(one: Mapping[str, int], other: Mapping[str, int]) -> dict[str, int]:
    return {name: one.get(name, 0) + other.get(name, 0) for name in sorted({*one, *other})}
