"""Whatever an agent sends, the world stays finite and says so once."""

import logging
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lavsim.types import Control, Role, VehicleLight
from lavsim.world.actor import VehicleDoor
from lavsim.world.blueprints import BLUEPRINTS
from lavsim.world.controls import ControlFilter
from lavsim.world.snapshot import HAZARD_DTYPE, Snapshot
from lavsim.world.weather import Weather
from lavsim.world.world import World


def world_of(blueprint: str = "vehicle.lincoln.mkz_2017", walls: bool = False) -> World:
    wall = np.array([[40.0, -50.0], [41.0, -50.0], [41.0, 50.0], [40.0, 50.0]])
    world = World([wall] if walls else [])
    world.spawn(1, BLUEPRINTS[blueprint], np.zeros(3), 0.0, Role.EGO)
    return world


def publish(world: World, weather: Weather | None = None) -> Snapshot:
    return world.publish(np.zeros(0, np.uint8), weather or Weather(), np.zeros(0, HAZARD_DTYPE))


CONTROLS = st.builds(Control, st.floats(), st.floats(), st.floats(), st.booleans(), st.booleans())


@settings(max_examples=60, deadline=None)
@given(
    controls=st.lists(CONTROLS, min_size=1, max_size=60),
    blueprint=st.sampled_from(["vehicle.lincoln.mkz_2017", "vehicle.mitsubishi.fusorosa", "vehicle.bh.crossbike"]),
)
def test_any_control_leaves_the_world_finite_and_in_range(controls: list[Control], blueprint: str) -> None:
    world = world_of(blueprint, walls=True)
    for control in controls:
        world.drive_ego(control)
        world.step()
        snapshot = publish(world)
        throttle, steer, brake, *_ = snapshot.control.tolist()
        assert 0.0 <= throttle <= 1.0
        assert -1.0 <= steer <= 1.0
        assert 0.0 <= brake <= 1.0
        assert np.isfinite(world.pose[0]).all()
        assert np.isfinite(snapshot.ego_motion).all()
        assert snapshot.ego.speed < 60.0


def test_a_minute_of_random_extremes_stays_finite() -> None:
    rng = np.random.default_rng(0)
    extremes = [0.0, 1.0, -1.0, 1e30, -1e30, math.nan, math.inf, -math.inf, 0.5]
    world = world_of(walls=True)
    world.spawn(2, BLUEPRINTS["vehicle.audi.tt"], np.array([15.0, 0.5, 0.0]), 0.3, Role.PARKED)
    for _ in range(1200):
        throttle, steer, brake = rng.choice(extremes, 3)
        world.drive_ego(Control(throttle, steer, brake, bool(rng.random() < 0.1), bool(rng.random() < 0.3)))
        world.step()
        assert np.isfinite(world.pose[:2]).all()
        assert np.abs(world.velocity[0, :2]).max() < 60.0


def test_a_value_that_is_no_number_keeps_the_last_one_and_one_warning_is_given(
    caplog: pytest.LogCaptureFixture,
) -> None:
    controls = ControlFilter()
    with caplog.at_level(logging.WARNING):
        controls.clean(Control(throttle=0.5, steer=0.25))
        assert not caplog.records
        kept = controls.clean(Control(throttle=math.nan, steer=math.inf, brake=-math.inf))
        clamped = controls.clean(Control(throttle=3.0, steer=-7.0))
    assert kept == Control(throttle=0.5, steer=0.25)
    assert clamped == Control(throttle=1.0, steer=-1.0)
    assert [record.getMessage() for record in caplog.records] == [
        "throttle must lie in [0, 1], got nan: kept 0.5; further values out of range are treated alike, silently."
    ]


def test_what_is_applied_is_what_a_log_holds() -> None:
    clean = ControlFilter().clean(Control(throttle=0.1, steer=-0.3, brake=0.7))
    assert [clean.throttle, clean.steer, clean.brake] == [float(np.float32(v)) for v in (0.1, -0.3, 0.7)]


def test_rounding_beyond_a_range_is_cut_without_a_word(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        assert ControlFilter().clean(Control(steer=1.0000001)).steer == 1.0
    assert not caplog.records


@pytest.mark.parametrize(
    ("control", "expected"),
    [
        (Control(), VehicleLight.NONE),
        (Control(brake=0.2), VehicleLight.BRAKE),
        (Control(hand_brake=True), VehicleLight.BRAKE),
        (Control(throttle=0.5, reverse=True), VehicleLight.REVERSE),
    ],
)
def test_brake_and_reverse_lights_follow_the_pedals_and_spare_the_others(
    control: Control, expected: VehicleLight
) -> None:
    world = world_of()
    world.ego.switch_on(VehicleLight.LEFT_BLINKER | VehicleLight.SPECIAL1)
    world.drive_ego(Control(brake=1.0, reverse=True))
    world.drive_ego(control)
    assert world.ego.lights == expected | VehicleLight.LEFT_BLINKER | VehicleLight.SPECIAL1
    world.ego.switch_off(VehicleLight.LEFT_BLINKER)
    assert not world.ego.lights & VehicleLight.LEFT_BLINKER


def test_doors_are_state_with_the_bits_of_the_table() -> None:
    world = world_of()
    world.ego.open_door(VehicleDoor.FRONT_LEFT)
    world.ego.open_door(VehicleDoor.REAR_RIGHT)
    assert publish(world).state[0, 1] == 1 + 8
    world.ego.close_door(VehicleDoor.FRONT_LEFT)
    assert publish(world).state[0, 1] == 8
    world.ego.open_door(VehicleDoor.ALL)
    assert world.ego.doors == VehicleDoor.ALL


@pytest.mark.parametrize(
    ("weather", "lit"),
    [
        (Weather(), False),
        (Weather(sun_altitude_angle=-10.0), True),
        (Weather(cloudiness=90.0), True),
        (Weather(fog_density=60.0), True),
        (Weather(sun_altitude_angle=20.0, cloudiness=75.0), True),  # two of them nearly so
        (Weather(sun_altitude_angle=20.0), False),
    ],
)
def test_low_beams_burn_when_it_is_dark_on_what_drives(weather: Weather, lit: bool) -> None:
    world = world_of()
    world.spawn(2, BLUEPRINTS["vehicle.audi.tt"], np.array([15.0, 0.0, 0.0]), 0.0, Role.TRAFFIC)
    world.spawn(3, BLUEPRINTS["vehicle.audi.tt"], np.array([30.0, 0.0, 0.0]), 0.0, Role.PARKED)
    beams = (publish(world, weather).state[:, 0] & VehicleLight.LOW_BEAM) != 0
    assert beams.tolist() == [lit, lit, False]


def test_the_hand_brake_stops_and_the_brake_wins_over_the_throttle() -> None:
    for control in (Control(throttle=1.0, brake=1.0), Control(throttle=1.0, hand_brake=True)):
        world = world_of()
        world.body[0, 0] = 15.0
        for _ in range(60):
            world.drive_ego(control)
            world.step()
        assert world.body[0, 0] == 0.0


def test_wet_roads_lengthen_the_way_to_stop_only_where_switched_on() -> None:
    ways = []
    for grip in (1.0, 0.6):
        world = world_of()
        world.grip, world.body[0, 0] = grip, 15.0
        for _ in range(120):
            world.drive_ego(Control(brake=1.0))
            world.step()
        ways.append(world.pose[0, 0])
    assert 1.4 < ways[1] / ways[0] < 2.0


@pytest.mark.parametrize(
    ("blueprint", "slower"), [("vehicle.mitsubishi.fusorosa", 0.45), ("vehicle.carlamotors.firetruck", 0.5)]
)
def test_the_ego_drives_as_its_class_does(blueprint: str, slower: float) -> None:
    speeds = []
    for name in ("vehicle.lincoln.mkz_2017", blueprint):
        world = world_of(name)
        for _ in range(20):
            world.drive_ego(Control(throttle=0.75))
            world.step()
        speeds.append(world.body[0, 0])
    assert speeds[1] / speeds[0] == pytest.approx(slower, abs=0.05)
