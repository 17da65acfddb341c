"""Small worlds with a few background drivers at chosen places, and others that do as they are told."""

from __future__ import annotations

from functools import cache

import numpy as np

from lavsim.map.town_files import build_town
from lavsim.map.town_map import TownMap
from lavsim.map.write import write_network
from lavsim.random import Draws
from lavsim.towns.layout import Layout
from lavsim.traffic.drivers import Driver
from lavsim.traffic.population import Traffic
from lavsim.types import DT, Control, LightState, Role
from lavsim.world.actor import Actor
from lavsim.world.blueprints import BLUEPRINTS
from lavsim.world.world import World

CAR = "vehicle.lincoln.mkz_2017"
FAR = (-5e3, -5e3)


@cache
def minor_crossing(control: str = "yield", arm: float = 120.0) -> TownMap:
    """A crossing around (0, 0) where the streets from the south and the north have to wait."""
    layout = Layout("minor")
    layout.junction("centre", 0.0, 0.0, control=control)
    layout.street("West Street", (-arm, 0.0), "centre", speed=50)
    layout.street("East Street", "centre", (arm, 0.0), speed=50)
    layout.street("South Street", (0.0, -arm), "centre", speed=30)
    layout.street("North Street", "centre", (0.0, arm), speed=30)
    return build_town(layout.name, write_network(layout.network()))


class Stage:
    """A world whose ego stands far away until it is put somewhere.

    Args:
        town: Where.
        places: Lane and travelled length [m] of each background vehicle.
        driver: Who drives them.
        seed: Of all draws.
    """

    def __init__(
        self, town: TownMap, places: list[tuple[int, float]], driver: Driver | None = None, seed: int = 0
    ) -> None:
        self.town = town
        self.world = World()
        self.ego = self.world.spawn(1, BLUEPRINTS[CAR], np.array([*FAR, 0.0]), 0.0, Role.EGO)
        self.traffic = Traffic(
            town, self.world, Draws.of_seed(seed), len(places), places=np.array(places, float).reshape(-1, 2),
            driver=driver or Driver(),
        )  # fmt: skip
        self.fleet = self.traffic._fleet
        self.lights = np.full(len(town.lights), LightState.GREEN, np.uint8)
        self.speeds: dict[int, float] = {}  # [m/s] of rows that do as they are told
        self.contacts = 0
        self._next = 1_000_000

    def put(self, lane: int, u: float, speed: float = 0.0, blueprint: str = CAR, role: Role = Role.SCENARIO) -> Actor:
        """Another actor on a lane's centre that keeps `speed`."""
        x, y, z, yaw = self.town.centre(np.array([lane]), np.array([u]))[0, :4]
        actor = self.world.spawn(self._next, BLUEPRINTS[blueprint], np.array([x, y, z]), float(yaw), role)
        self._next += 1
        self.world.body[actor.row, 0] = speed
        self.speeds[actor.row] = speed
        return actor

    def put_ego(self, lane: int, u: float, speed: float = 0.0) -> None:
        """Sets the ego on a lane's centre; it keeps `speed`."""
        x, y, z, yaw = self.town.centre(np.array([lane]), np.array([u]))[0, :4]
        self.world.pose[0], self.world.height[0] = (x, y, yaw), z
        self.world.body[0, 0] = speed
        self.speeds[0] = speed

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / DT)):
            self.tick()

    def tick(self) -> None:
        world = self.world
        self.traffic.control(self.lights)
        world.drive_ego(Control(brake=1.0))
        for row, speed in self.speeds.items():
            world.command[row] = (speed, 0.0)
        world.step()
        self.contacts += len(world._contact_events()) if hasattr(world, "_contact_events") else len(world._contacts)

    def speed(self, slot: int = 0) -> float:
        return float(self.world.body[self.fleet.row[slot], 0])

    def choose(self, slot: int, turn: int) -> None:
        """Lets a driver take the junction lane with this `RoadOption` next."""
        lanes, fleet = self.town.lanes, self.fleet
        options = [k for k in lanes.successors(int(fleet.lane[slot])) if lanes.turn[k] == turn]
        fleet.path[slot] = -1
        fleet.path[slot, :2] = options[0], lanes.successors(options[0])[0]

    def lane_from(self, x: float, y: float) -> int:
        """The lane into the junction whose centre passes nearest to (x, y)."""
        hits = self.town.nearest(np.array([[x, y]]))
        return int(hits.lane[0])
