"""What a script may take hold of beside its own actors; everything is let go when the hazard ends."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from lavsim.map.route import Route
from lavsim.traffic.population import Traffic
from lavsim.types import DT, LightState
from lavsim.world.lights import TrafficLights
from lavsim.world.world import World

Rows = NDArray[np.int64]

_BESIDE_ROUTE = 8.0  # [m] of the route's line: the lanes of its direction
_SAME_WAY = np.radians(60.0)


class LightsHand:
    """Traffic lights as one hazard holds them; who held a light last is its owner.

    Args:
        lights: Of the town.
        world: Its clock.
        owners: Instance of the hazard that holds each light, shared by all hands.
        instance: Of this hazard.
    """

    def __init__(self, lights: TrafficLights, world: World, owners: dict[int, int], instance: int) -> None:
        self._lights, self._world, self._owners, self._instance = lights, world, owners, instance
        self._junctions: list[int] = []

    @property
    def states(self) -> NDArray[np.uint8]:
        """`LightState` of every light in this tick (L,)."""
        return self._lights.states(self._time)

    def state(self, light: int) -> LightState:
        return LightState(int(self.states[light]))

    def hold(self, light: int, state: LightState) -> None:
        """Keeps one light at `state`."""
        self._lights.hold(light, state)
        self._owners[light] = self._instance

    def hold_junction(self, light: int, greens: Iterable[int] = ()) -> None:
        """Stops the lights of the junction of `light`: red all but `greens`."""
        self._lights.hold_junction(light, self._time, tuple(greens))
        self._own_junction(light)

    def freeze_junction(self, light: int) -> None:
        """Stops the lights of the junction of `light` as they are."""
        self._lights.freeze_junction(light, self._time)
        self._own_junction(light)

    def release(self) -> None:
        """Lets everything it holds follow its cycle again."""
        for light in self._junctions:
            if self._owners.get(light) == self._instance:
                self._lights.release_junction(light, self._time)
        for light in [light for light, owner in self._owners.items() if owner == self._instance]:
            self._lights.release(light)
            del self._owners[light]
        self._junctions.clear()

    @property
    def _time(self) -> float:
        return self._world.tick * DT

    def _own_junction(self, light: int) -> None:
        for member in self._lights.group_of(light):
            self._owners[member] = self._instance
        if light not in self._junctions:
            self._junctions.append(light)


class FlagsHand:
    """`HAZARD_*` bits of `lavsim.world.snapshot` that snapshots show beside the hazard.

    Attributes:
        bits: Now.
        lasting: Those that stay when the hazard is over.
    """

    def __init__(self) -> None:
        self.bits = 0
        self.lasting = 0

    def set(self, bits: int, lasting: bool = False) -> None:
        """Shows `bits` until `unset` or the hazard's end; `lasting` keeps them to the end of the route."""
        self.bits |= bits
        if lasting:
            self.lasting |= bits

    def unset(self, bits: int) -> None:
        self.bits &= ~bits
        self.lasting &= ~bits

    def release(self) -> None:
        self.bits = self.lasting


class TrafficHand:
    """Background vehicles as a hazard slows them down.

    Args:
        traffic: All of them.
        world: Where they are.
        route: The ego's.
        progress: Reads how far the ego is along it [m].
    """

    def __init__(self, traffic: Traffic, world: World, route: Route, progress: Callable[[], float]) -> None:
        self._traffic, self._world, self._route, self._progress = traffic, world, route, progress
        self._held: list[int] = []

    @property
    def rows(self) -> Rows:
        """World rows of all background vehicles."""
        return self._traffic.rows

    def ahead(self, reach: float, beside: float = _BESIDE_ROUTE) -> Rows:
        """Rows of those within `reach` metres of route before the ego that go its way, nearest first.

        Args:
            reach: Along the route [m].
            beside: To either side of it [m].
        """
        rows, route, done = self.rows, self._route, self._progress()
        piece = np.flatnonzero((route.distance >= done) & (route.distance <= done + reach))
        if not len(rows) or not len(piece):
            return rows[:0]
        poses = self._world.pose[rows]
        gaps = np.hypot(*np.moveaxis(route.xy[piece][None] - poses[:, None, :2], -1, 0))
        nearest = np.argmin(gaps, axis=1)
        turn = np.abs(np.mod(poses[:, 2] - route.yaw[piece[nearest]] + np.pi, 2.0 * np.pi) - np.pi)
        found = (gaps[np.arange(len(rows)), nearest] < beside) & (turn < _SAME_WAY) & (nearest > 0)
        return rows[found][np.argsort(nearest[found], kind="stable")]

    def hold(self, rows: Sequence[int] | Rows, speed: float = 0.0, deceleration: float = 6.0) -> None:
        """Keeps vehicles from driving faster than `speed` [m/s]; they brake with `deceleration` [m/s²]."""
        for row in rows:
            self._traffic.hold(int(row), speed, deceleration)
            if int(row) not in self._held:
                self._held.append(int(row))

    def release(self, rows: Sequence[int] | Rows | None = None) -> None:
        """Lets them go, all that it holds if not told which."""
        for row in list(self._held) if rows is None else [int(row) for row in rows if int(row) in self._held]:
            self._traffic.let_go(row)
            self._held.remove(row)

    def make_room(self, xy: NDArray[np.float64], radius: float) -> int:
        """Takes out background vehicles whose middle is within `radius` of `xy` [m]; returns how many."""
        return self._traffic.take_out_near(xy, radius)


class EgoHand:
    """What hazards add to the ego's pedals and wheel, in one tick."""

    def __init__(self) -> None:
        self.throttle = 0.0
        self.steer = 0.0

    def add(self, throttle: float, steer: float) -> None:
        self.throttle += throttle
        self.steer += steer

    def take(self) -> tuple[float, float]:
        """What was added since the last time."""
        added = self.throttle, self.steer
        self.throttle = self.steer = 0.0
        return added
