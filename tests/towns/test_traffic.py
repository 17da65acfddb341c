"""The traffic that a bundled town is meant to hold flows in it."""

from __future__ import annotations

import numpy as np
import pytest

from lavsim.map.town_files import load_town
from lavsim.random import Draws
from lavsim.towns.draw import TOWNS
from lavsim.towns.facts import bundled_facts
from lavsim.traffic.population import Traffic
from lavsim.types import DT, Control, LaneType, Role
from lavsim.world.blueprints import BLUEPRINTS
from lavsim.world.lights import TrafficLights
from lavsim.world.snapshot import HAZARD_DTYPE
from lavsim.world.weather import Weather
from lavsim.world.world import World

MINUTES = 5
BLOCKED = 180.0  # [s] of standing after which the leaderboard calls an agent blocked


@pytest.mark.parametrize("name", sorted(TOWNS))
def test_the_count_and_the_density_of_a_town_agree(name: str) -> None:
    lanes, facts = load_town(name).lanes, bundled_facts()[name]
    outside = (lanes.type == LaneType.DRIVING) & (lanes.junction < 0)
    assert facts.vehicles == pytest.approx(facts.vehicles_per_lane_km * lanes.length[outside].sum() / 1000.0, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(TOWNS))
def test_five_minutes_of_a_town_s_own_traffic_without_a_contact_or_a_jam(name: str) -> None:
    town, facts = load_town(name), bundled_facts()[name]
    world = World()
    ego = BLUEPRINTS["vehicle.lincoln.mkz_2017"]
    x, y = town.bounds[:2] - 200.0  # out of everybody's way
    world.spawn(1, ego, np.array([x, y, 0.0]), 0.0, Role.EGO)
    lights = TrafficLights(len(town.lights), town.light_groups)
    traffic = Traffic(town, world, Draws.of_seed(0), facts.vehicles)
    assert len(traffic) == facts.vehicles
    driven, standing, longest = (np.zeros(facts.vehicles) for _ in range(3))
    for _ in range(int(MINUTES * 60.0 / DT)):
        states = lights.states(world.tick * DT)
        traffic.control(states)
        world.drive_ego(Control(brake=1.0))
        world.step()
        snapshot = world.publish(states, Weather(), np.zeros(0, HAZARD_DTYPE))
        assert not len(snapshot.contacts), snapshot.contacts
        speeds = snapshot.speeds[1:]
        driven += speeds * DT
        standing = np.where(speeds < 0.1, standing + DT, 0.0)
        longest = np.maximum(longest, standing)
    assert longest.max() < BLOCKED
    assert np.median(driven) > 600.0
    assert driven.min() > 20.0
