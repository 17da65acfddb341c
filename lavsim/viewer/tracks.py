"""A whole drive as columns, actor by actor: what replay, report and film strips are made from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.types import DT
from lavsim.world.snapshot import ANGLE_UNIT, LENGTH_UNIT, SPEED_UNIT, ActorTable, Snapshot

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CONTACT_GAP = 20  # ticks without touching after which the same two count as touching anew


@dataclass(frozen=True, eq=False)
class Tracks:
    """All ticks of a drive, T of them; P poses in S tracks, each an actor present without a break.

    Tracks lie one behind the other in the pose columns, the ego's first.

    Attributes:
        ticks: (T,) numbers of the ticks, rising by one.
        table: The actors.
        row: (S,) row of each track's actor in `table`.
        start: (S,) index of its first tick in `ticks`.
        first: (S+1,) its poses are rows first[s] … first[s+1]-1.
        pose: (P, 3) x, y [mm], yaw [2^-16 turn], the log's own integers.
        velocity: (P, 2) [cm/s] in the world.
        state: (P, 2) `VehicleLight` bits, open doors.
        motion: (T, 6) the ego's accelerations and rotation rates, as in `Snapshot.ego_motion`.
        control: (T, 5) as in `Snapshot.control`.
        lights: (T, L) `LightState` of the town's lights.
        contacts: (C, 6) index of the tick, ids of both sides, impulse [N s], x, y [m]; one row for each tick in touch.
        hazards: (H, 3) number of the hazard, index of the first tick it was active, index after the last.
        weather: (T, 10) as in `Snapshot.weather_values`.
    """

    ticks: Ints
    table: ActorTable
    row: Ints
    start: Ints
    first: Ints
    pose: NDArray[np.int32]
    velocity: NDArray[np.int32]
    state: NDArray[np.int32]
    motion: NDArray[np.float32]
    control: NDArray[np.float32]
    lights: NDArray[np.uint8]
    contacts: Floats
    hazards: Ints
    weather: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.ticks)

    @cached_property
    def times(self) -> Floats:
        """(T,) simulation time [s]."""
        return np.asarray(self.ticks * DT)

    @cached_property
    def ego(self) -> NDArray[np.int64]:
        """(T,) rows of the ego's poses: it is there at every tick, so its track is the first and only one."""
        return np.arange(len(self.ticks))

    @cached_property
    def tick_of(self) -> Ints:
        """(P,) index of the tick of each pose."""
        length = np.diff(self.first)
        return np.arange(len(self.pose)) - np.repeat(self.first[:-1] - self.start, length)

    @cached_property
    def xy(self) -> Floats:
        """(P, 2) positions [m]."""
        return self.pose[:, :2] * LENGTH_UNIT

    @cached_property
    def yaw(self) -> Floats:
        """(P,) headings [rad]."""
        return self.pose[:, 2] * ANGLE_UNIT

    @cached_property
    def speed(self) -> Floats:
        """(P,) speeds in plan [m/s]."""
        return np.asarray(np.hypot(self.velocity[:, 0], self.velocity[:, 1]) * SPEED_UNIT)

    @cached_property
    def forward_speed(self) -> Floats:
        """(T,) the ego's speed ahead [m/s], negative backward."""
        yaw, velocity = self.yaw[self.ego], self.velocity[self.ego] * SPEED_UNIT
        return velocity[:, 0] * np.cos(yaw) + velocity[:, 1] * np.sin(yaw)

    @cached_property
    def touches(self) -> Floats:
        """(K, 6) contacts, each pair once for as long as it stays in touch; the impulse is the largest."""
        found: list[list[float]] = []
        last: dict[tuple[float, float], tuple[int, float]] = {}  # pair: place in `found`, newest tick
        for index, a, b, impulse, x, y in self.contacts.tolist():
            pair = (min(a, b), max(a, b))
            place, before = last.get(pair, (-1, -np.inf))
            if index - before > CONTACT_GAP:
                place = len(found)
                found.append([index, a, b, impulse, x, y])
            else:
                found[place][3] = max(found[place][3], impulse)
            last[pair] = (place, index)
        return np.array(found, np.float64).reshape(-1, 6)


class _Tick(NamedTuple):
    """What is taken of a snapshot."""

    tick: int
    rows: NDArray[np.int32]
    pose: NDArray[np.int32]
    velocity: NDArray[np.int32]
    state: NDArray[np.int32]
    ego_motion: NDArray[np.float32]
    control: NDArray[np.float32]
    lights: NDArray[np.uint8]
    contacts: NDArray[np.void]
    hazards: NDArray[np.void]
    weather_values: NDArray[np.float32]


_FIELDS = attrgetter(*_Tick._fields)


def read_tracks(snapshots: Iterable[Snapshot]) -> Tracks:
    """The tracks of a drive, from its log or from memory.

    Args:
        snapshots: In order; the table of the last one must hold all actors.
    """
    taken, table = [], ActorTable.empty()
    for snapshot in snapshots:  # what was derived from them takes twice the room, and isn't kept
        taken.append(_Tick(*_FIELDS(snapshot)))
        table = snapshot.table
    count = np.array([len(s.rows) for s in taken], np.int64)
    rows = _joined([s.rows for s in taken], (0,), np.int32).astype(np.int64)
    tick = np.repeat(np.arange(len(taken)), count)
    order = np.lexsort((tick, rows))
    rows, tick = rows[order], tick[order]
    begins = np.ones(len(rows), np.bool_)
    begins[1:] = (np.diff(rows) != 0) | (np.diff(tick) != 1)
    first = np.append(np.flatnonzero(begins), len(rows))
    return Tracks(
        ticks=np.array([s.tick for s in taken], np.int64),
        table=table,
        row=rows[first[:-1]],
        start=tick[first[:-1]],
        first=first,
        pose=_joined([s.pose for s in taken], (0, 5), np.int32)[order][:, [0, 1, 3]],
        velocity=_joined([s.velocity for s in taken], (0, 3), np.int32)[order][:, :2],
        state=_joined([s.state for s in taken], (0, 3), np.int32)[order][:, :2],
        motion=np.array([s.ego_motion for s in taken], np.float32).reshape(-1, 6),
        control=np.array([s.control for s in taken], np.float32).reshape(-1, 5),
        lights=np.array([s.lights for s in taken], np.uint8) if taken else np.zeros((0, 0), np.uint8),
        contacts=_contacts(taken),
        hazards=_hazard_spans(taken),
        weather=np.array([s.weather_values for s in taken], np.float32).reshape(-1, 10),
    )


def _joined(parts: list[NDArray[np.int32]], empty: tuple[int, ...], dtype: type[np.int32]) -> NDArray[np.int32]:
    return np.concatenate(parts) if parts else np.zeros(empty, dtype)


def _contacts(snapshots: list[_Tick]) -> Floats:
    rows = [
        (index, int(c["a"]), int(c["b"]), float(c["impulse"]), c["x"] * LENGTH_UNIT, c["y"] * LENGTH_UNIT)
        for index, snapshot in enumerate(snapshots)
        for c in snapshot.contacts
    ]
    return np.array(rows, np.float64).reshape(-1, 6)


def _hazard_spans(snapshots: list[_Tick]) -> Ints:
    """Spans in which each hazard was active, by their beginning."""
    spans: list[list[int]] = []
    open_spans: dict[int, list[int]] = {}
    for index, snapshot in enumerate(snapshots):
        active = [int(number) for number in snapshot.hazards["index"]]
        for number in active:
            if number not in open_spans:
                open_spans[number] = [number, index, index]
                spans.append(open_spans[number])
            open_spans[number][2] = index + 1
        for number in [n for n in open_spans if n not in active]:
            del open_spans[number]
    return np.array(spans, np.int64).reshape(-1, 3)
