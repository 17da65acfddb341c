"""Roads on which the theory of traffic flow can be checked, and who drives on them."""

from __future__ import annotations

import math
from contextlib import ExitStack
from functools import cache
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from lavsim.map.records import (
    Geometry,
    LaneRecord,
    Network,
    Polynomial,
    RoadLink,
    RoadMark,
    RoadRecord,
    SectionRecord,
    SpeedRecord,
)
from lavsim.map.town_files import build_town
from lavsim.map.town_map import TownMap
from lavsim.map.write import write_network
from lavsim.random import Draws
from lavsim.traffic.population import Traffic
from lavsim.types import DT, Control, Role
from lavsim.world.blueprints import find_blueprint
from lavsim.world.lights import LightCycle, TrafficLights
from lavsim.world.snapshot import HAZARD_DTYPE, Snapshot
from lavsim.world.weather import Weather
from lavsim.world.world import World


@cache
def circle(length: float = 1000.0, speed: int = 50) -> TownMap:
    """One lane that closes upon itself, `length` [m] round, two half roads without a junction; limit in km/h."""
    half, radius = length / 2.0, length / (2.0 * math.pi)
    lane = LaneRecord(-1, "driving", (Polynomial(0.0, 3.5),), (RoadMark(),), -1, -1)
    roads = tuple(
        RoadRecord(
            number,
            half,
            (Geometry(0.0, x, 0.0, heading, half, 1.0 / radius),),
            (SectionRecord(0.0, (LaneRecord(0, "none", (), (RoadMark(),)), lane)),),
            predecessor=RoadLink("road", other, "end"),
            successor=RoadLink("road", other, "start"),
            speeds=(SpeedRecord(0.0, speed / 3.6),),
        )
        for number, other, x, heading in ((1, 2, radius, math.pi / 2.0), (2, 1, -radius, -math.pi / 2.0))
    )
    return build_town("circle", write_network(Network(roads, name="circle")))


def evenly(town: TownMap, count: int) -> NDArray[np.float64]:
    """Places (count, 2) evenly along all lanes of `town` in their order: lane and travelled length."""
    lengths = town.lanes.length
    way = (np.arange(count) + 0.5) * lengths.sum() / count
    ends = np.cumsum(lengths)
    lane = np.searchsorted(ends, way, side="right")
    return np.column_stack([lane, way - (ends - lengths)[lane]])


class Drive:
    """A town with vehicles of background traffic at given places; the ego stands far away.

    Args:
        town: Where.
        places: (V, 2) lane and travelled length of each.
        seed: Of the drivers and vehicles.
        cycle: Durations of the lights.
        blueprint: What all drive; drawn as for any traffic by default.
    """

    def __init__(
        self,
        town: TownMap,
        places: NDArray[np.float64],
        seed: int = 0,
        cycle: LightCycle | None = None,
        blueprint: str | None = None,
    ) -> None:
        self.town = town
        self.world = World()
        ego = find_blueprint("vehicle.lincoln.mkz_2017")
        self.world.spawn(1, ego, np.array([-5e3, -5e3, 0.0]), 0.0, Role.EGO)
        draws = Draws.of_seed(seed)
        with ExitStack() as patches:
            if blueprint:
                patches.enter_context(mock.patch.object(Traffic, "_blueprint", return_value=find_blueprint(blueprint)))
            self.traffic = Traffic(town, self.world, draws, len(places), places=places)
        self.lights = TrafficLights(len(town.lights), town.light_groups, cycle)

    def tick(self) -> Snapshot:
        """The next tick."""
        states = self.lights.states(self.world.tick * DT)
        self.traffic.control(states)
        self.world.drive_ego(Control(brake=1.0))
        self.world.step()
        return self.world.publish(states, Weather(), np.zeros(0, HAZARD_DTYPE))
