"""What happens when things touch."""

import numpy as np
import pytest

from lavsim.errors import ScenarioError
from lavsim.types import ActorIds, Control, Role
from lavsim.world.actor import Actor
from lavsim.world.blueprints import BLUEPRINTS
from lavsim.world.motion import RESTING, WALKING
from lavsim.world.snapshot import HAZARD_DTYPE, Snapshot
from lavsim.world.weather import Weather
from lavsim.world.world import World

EGO = BLUEPRINTS["vehicle.lincoln.mkz_2017"]


def world_with_ego(walls: list[np.ndarray] | None = None) -> World:
    world = World(walls or [])
    world.spawn(int(ActorIds.EGO), EGO, np.zeros(3), 0.0, Role.EGO)
    return world


def add(world: World, blueprint: str, x: float, y: float = 0.0, role: Role = Role.TRAFFIC) -> Actor:
    return world.spawn(1000 + world.count, BLUEPRINTS[blueprint], np.array([x, y, 0.0]), 0.0, role)


def drive(world: World, ticks: int, control: Control) -> list[Snapshot]:
    snapshots = []
    for _ in range(ticks):
        world.drive_ego(control)
        world.step()
        snapshots.append(world.publish(np.zeros(0, np.uint8), Weather(), np.zeros(0, HAZARD_DTYPE)))
    return snapshots


def contacts(snapshots: list[Snapshot]) -> list[tuple[int, int]]:
    return [(int(c["a"]), int(c["b"])) for s in snapshots for c in s.contacts]


def test_a_car_ahead_is_hit_and_pushed() -> None:
    world = world_with_ego()
    other = add(world, "vehicle.audi.tt", 20.0)
    snapshots = drive(world, 100, Control(throttle=0.75))
    assert (1, other.id) in contacts(snapshots)
    assert other.xy[0] > 20.5
    hit = next(s for s in snapshots if len(s.contacts))
    assert hit.contacts["impulse"][0] > 1000.0
    assert hit.contacts["x"][0] / 1000.0 == pytest.approx(hit.ego.x + EGO.size[0] / 2, abs=1.0)


def test_a_car_beside_the_path_is_spared() -> None:
    world = world_with_ego()
    add(world, "vehicle.audi.tt", 20.0, 2.2)
    assert not contacts(drive(world, 100, Control(throttle=0.75)))


def test_a_wall_stops_the_ego_as_the_static_world() -> None:
    wall = np.array([[20.0, -5.0], [21.0, -5.0], [21.0, 5.0], [20.0, 5.0]])
    world = world_with_ego([wall])
    snapshots = drive(world, 120, Control(throttle=0.75))
    assert set(contacts(snapshots)) == {(1, 0)}
    assert snapshots[-1].ego.x < 20.0 - EGO.size[0] / 2 + 0.5
    assert np.abs([s.ego.speed for s in snapshots]).max() < 15.0


def test_a_prop_of_infinite_mass_is_a_wall_with_an_id() -> None:
    world = world_with_ego()
    prop = add(world, "static.prop.vendingmachine", 15.0, role=Role.PROP)
    snapshots = drive(world, 120, Control(throttle=0.75))
    assert (1, prop.id) in contacts(snapshots)
    assert prop.xy.tolist() == [15.0, 0.0]


def test_a_walker_hit_at_speed_stays_down() -> None:
    world = world_with_ego()
    walker = add(world, "walker.pedestrian.0001", 15.0, 0.3, role=Role.SCENARIO)
    drive(world, 80, Control(throttle=0.75))
    assert world.motion[walker.row] == RESTING
    walker.walk(np.array([0.0, 2.0]))
    assert not world.command[walker.row].any()


def test_a_walking_walker_moves_as_told_and_its_gait_goes_on() -> None:
    world = world_with_ego()
    walker = add(world, "walker.pedestrian.0001", 15.0, 5.0, role=Role.SCENARIO)
    walker.walk(np.array([0.0, 2.0]))
    last = drive(world, 20, Control(brake=1.0))[-1]
    assert walker.xy[1] == pytest.approx(7.0)
    assert last.speeds[1] == pytest.approx(2.0)
    assert last.state[1, 2] != 0


def test_who_was_removed_touches_nobody() -> None:
    world = world_with_ego()
    add(world, "vehicle.audi.tt", 20.0).remove()
    snapshots = drive(world, 100, Control(throttle=0.75))
    assert not contacts(snapshots)
    assert len(snapshots[-1].rows) == 1


def test_a_hazard_has_no_room_where_somebody_stands() -> None:
    world = world_with_ego()
    with pytest.raises(ScenarioError, match=r"would overlap actor 1 \(vehicle.lincoln.mkz_2017\)"):
        add(world, "static.prop.vendingmachine", 2.0, role=Role.PROP)


def test_after_a_side_hit_everything_stays_finite_and_comes_to_rest() -> None:
    world = world_with_ego()
    add(world, "vehicle.mercedes.sprinter", 12.0, 1.5)
    drive(world, 60, Control(throttle=1.0, steer=0.1))
    last = drive(world, 200, Control(brake=1.0))[-1]
    assert np.isfinite(last.velocities).all()
    assert last.speeds.max() < 0.05


def test_the_imu_feels_braking() -> None:
    world = world_with_ego()
    drive(world, 60, Control(throttle=0.75))
    braking = drive(world, 1, Control(brake=1.0))[-1]
    assert braking.ego_motion[0] < -5.0
    turning = drive(world, 1, Control(throttle=0.5, steer=0.4))[-1]
    assert turning.ego_motion[5] > 0.1


@pytest.mark.parametrize(("z", "meets"), [(5.0, False), (1.0, True)])
def test_cars_on_different_levels_pass_through_each_other(z: float, meets: bool) -> None:
    world = World(has_levels=True)
    world.spawn(int(ActorIds.EGO), EGO, np.zeros(3), 0.0, Role.EGO)
    world.spawn(1000, BLUEPRINTS["vehicle.audi.tt"], np.array([20.0, 0.0, z]), 0.0, Role.TRAFFIC)
    snapshots = drive(world, 100, Control(throttle=0.75))
    assert bool(contacts(snapshots)) == meets
    assert (snapshots[-1].ego.speed > 9.0) != meets


def test_debris_lies_under_cars_and_touches_nobody() -> None:
    world = world_with_ego()
    debris = add(world, "static.prop.dirtdebris01", 10.0, role=Role.PROP)
    add(world, "static.prop.dirtdebris02", 10.5, role=Role.PROP)  # over the other
    add(world, "vehicle.audi.tt", 10.0, 0.5, role=Role.SCENARIO).remove()  # there is room for a car above it
    snapshots = drive(world, 80, Control(throttle=0.75))
    assert not contacts(snapshots)
    assert snapshots[-1].ego.x > 20.0
    assert debris.xy.tolist() == [10.0, 0.0]


def test_a_cone_is_knocked_away_and_hardly_felt() -> None:
    world = world_with_ego()
    cone = add(world, "static.prop.trafficcone01", 12.0, role=Role.PROP)
    snapshots = drive(world, 80, Control(throttle=0.75))
    assert (1, cone.id) in contacts(snapshots)
    assert cone.xy[0] > 13.0
    assert snapshots[-1].ego.speed > 10.0


def test_a_walker_that_walks_into_a_parked_car_stays_on_its_feet() -> None:
    world = world_with_ego()
    add(world, "vehicle.audi.tt", 20.0, 20.0, role=Role.PARKED)
    walker = add(world, "walker.pedestrian.0001", 20.0, 17.0, role=Role.SCENARIO)
    walker.walk(np.array([0.0, 2.5]))
    snapshots = drive(world, 60, Control(brake=1.0))
    assert contacts(snapshots)
    assert world.motion[walker.row] == WALKING
    assert walker.xy[1] < 19.2


def test_walkers_pass_each_other() -> None:
    world = world_with_ego()
    pair = [add(world, "walker.pedestrian.0001", 20.0 + 4.0 * k, 20.0, role=Role.SCENARIO) for k in range(2)]
    pair[0].walk(np.array([1.5, 0.0]))
    pair[1].walk(np.array([-1.5, 0.0]))
    assert not contacts(drive(world, 60, Control(brake=1.0)))
    assert pair[0].xy[0] > pair[1].xy[0]
