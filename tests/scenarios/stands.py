"""Drives over short routes with one hazard each, found as `lavsim routes make` finds them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import islice
from typing import Any

import numpy as np

from lavsim.map.town_files import load_town
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import ActorIds, Control, Role
from lavsim.world.snapshot import Snapshot
from leaderboard.hazard_maker import Stand, stands

FIRST = int(ActorIds.of_scenario(0))


@cache
def stand(kind: str, generation: str = "1.0", town: str = "eu_small_a", number: int = 0) -> Stand:
    """One of the places for a hazard in a town."""
    return list(islice(stands(load_town(town), kind, generation), number + 1))[number]


def drive(place: Stand, town: str = "eu_small_a", **changes: Any) -> DriveSpec:
    """A drive of it without background traffic; `changes` replaces fields."""
    generation = place.spec.generation
    fields = {"town": town, "route_id": "stand", "keypoints": place.route.keypoints, "traffic": "empty",
              "scenarios": (place.spec,), "generation": generation, "rules": generation}  # fmt: skip
    return DriveSpec(**{**fields, **changes})


class Follower:
    """Keeps to the route at `speed` [m/s], slower in bends; `looks` makes it stop for what a hazard puts ahead."""

    def __init__(self, speed: float = 8.0, looks: bool = False) -> None:
        self.speed, self.looks, self._index = speed, looks, 0

    def __call__(self, simulation: Simulation) -> Control:
        snapshot, route = simulation.snapshot, simulation.route
        window = route.xy[self._index : self._index + 12]
        self._index += int(np.argmin(np.hypot(*(window - snapshot.ego.xy).T)))
        aim = route.xy[min(self._index + 5, len(route) - 1)] - snapshot.ego.xy
        angle = np.arctan2(aim[1], aim[0]) - snapshot.ego.yaw
        angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
        speed = min(self.speed, 5.5) if abs(angle) > 0.15 else self.speed
        if self.looks and self._is_blocked(snapshot):
            return Control(brake=1.0)
        excess = snapshot.ego.speed - speed
        brake = 0.5 if excess > 1.0 else 0.0
        steer = float(np.clip(1.5 * angle, -1.0, 1.0))
        return Control(throttle=0.7 if excess < 0.0 else 0.0, steer=steer, brake=brake)

    @staticmethod
    def _is_blocked(snapshot: Snapshot) -> bool:
        ego = snapshot.ego
        acting = np.flatnonzero(np.isin(snapshot.roles, (Role.SCENARIO,)))
        delta = snapshot.xy[acting] - ego.xy
        ahead = delta @ [np.cos(ego.yaw), np.sin(ego.yaw)]
        aside = np.abs(delta @ [-np.sin(ego.yaw), np.cos(ego.yaw)])
        aside[snapshot.speeds[acting] < 0.3] += 4.0  # what stands beside the lane may stay there
        reach = 6.0 + 2.5 * ego.speed if ego.speed > 1.0 else 14.0
        return bool(((ahead > 0.0) & (ahead < reach) & (aside < 6.0)).any())


def run(spec: DriveSpec, ticks: int, driver: Callable[[Simulation], Control] | None = None) -> list[Snapshot]:
    """Snapshots of the first `ticks` ticks, driven blindly by default."""
    driver = driver or Follower()
    simulation = Simulation(spec)
    return [simulation.snapshot] + [simulation.tick(driver(simulation)) for _ in range(ticks)]


def hits(snapshots: list[Snapshot]) -> set[int]:
    """Numbers of the hazard's actors that the ego touched."""
    pairs = {(int(c["a"]), int(c["b"])) for s in snapshots for c in s.contacts}
    return {max(pair) - FIRST for pair in pairs if min(pair) == int(ActorIds.EGO) and max(pair) >= FIRST}


def left_over(snapshot: Snapshot) -> int:
    """Actors of hazards that are still there."""
    return int(np.count_nonzero(snapshot.ids >= FIRST))


def active(snapshots: list[Snapshot]) -> tuple[int, int]:
    """First tick at which the hazard is shown, and the first after it; (-1, -1) if it never was."""
    shown = [len(s.hazards) > 0 for s in snapshots]
    if not any(shown):
        return -1, -1
    first = shown.index(True)
    return first, first + shown[first:].index(False) if False in shown[first:] else len(shown)
