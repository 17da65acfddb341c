"""Random crashes keep the laws: energy falls, nothing jumps, overlaps are pushed apart, all come to rest."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from shapely import Polygon

from lavsim.geometry import box_corners
from lavsim.types import DT, ActorClass, Role
from lavsim.world.blueprints import BLUEPRINTS, Blueprint
from lavsim.world.motion import DRIVEN, WALKING
from lavsim.world.world import World

EGO = BLUEPRINTS["vehicle.lincoln.mkz_2017"]
KINDS = [
    "vehicle.tesla.model3", "vehicle.micro.microlino", "vehicle.mercedes.sprinter", "vehicle.carlamotors.firetruck",
    "vehicle.mitsubishi.fusorosa", "vehicle.yamaha.yzf", "vehicle.bh.crossbike", "walker.pedestrian.0001",
    "walker.pedestrian.0009", "static.prop.trafficcone01", "static.prop.haybale", "static.prop.vendingmachine",
    "static.prop.streetbarrier",
]  # fmt: skip
WALL = np.array([[-16.0, -20.0], [-15.0, -20.0], [-15.0, 20.0], [-16.0, 20.0]])


@dataclass(frozen=True)
class Crash:
    """A world in which bodies drive at each other."""

    world: World
    rows: NDArray[np.int64]
    kinds: list[Blueprint]

    @property
    def energy(self) -> float:
        """Kinetic energy of all that moves [J]."""
        total = 0.0
        for row, kind in zip(self.rows, self.kinds, strict=True):
            if np.isfinite(kind.mass):
                vx, vy, rate = self.world.velocity[row]
                moment = kind.mass * (kind.size[0] ** 2 + kind.size[1] ** 2) / 12.0
                total += 0.5 * kind.mass * (vx**2 + vy**2) + 0.5 * moment * rate**2
        return float(total)

    def polygons(self, shrink: float) -> list[Polygon]:
        pose = self.world.pose[self.rows]
        sizes = np.array([kind.size for kind in self.kinds])
        corners = box_corners(pose[:, 0], pose[:, 1], pose[:, 2], sizes[:, 0], sizes[:, 1])
        return [Polygon(c).buffer(-shrink) for c in corners]


def crash(names: list[str], seed: int, walls: bool = False, has_levels: bool = False, far: float = 9.0) -> Crash:
    """Bodies on a circle, each with up to 30 m/s towards its middle; the first two surely."""
    rng = np.random.default_rng(seed)
    world = World([WALL] if walls else [], has_levels)
    world.spawn(1, EGO, np.array([5e3, 5e3, 0.0]), 0.0, Role.EGO)
    kinds, rows = [BLUEPRINTS[name] for name in names], []
    for k, kind in enumerate(kinds):
        angle = 2.0 * np.pi * (k + 0.6 * rng.random()) / len(kinds)
        at = far * np.array([np.cos(angle), np.sin(angle)])
        role = Role.TRAFFIC if kind.actor_class != ActorClass.PROP and rng.random() < 0.8 else Role.PARKED
        yaw = angle + np.pi + rng.uniform(-0.3, 0.3)
        row = world.spawn(1000 + k, kind, np.array([*at, 0.0]), yaw, role).row
        rows.append(row)
        if world.motion[row] == DRIVEN:
            world.body[row, 0] = rng.uniform(10.0, 30.0)
        elif world.motion[row] == WALKING:
            world.command[row] = rng.uniform(0.0, 3.0) * np.array([np.cos(yaw), np.sin(yaw)])
    return Crash(world, np.array(rows), kinds)


@settings(max_examples=40, deadline=None)
@given(names=st.lists(st.sampled_from(KINDS), min_size=2, max_size=6), seed=st.integers(0, 10**6), walls=st.booleans())
def test_random_crashes_obey_the_laws(names: list[str], seed: int, walls: bool) -> None:
    run = crash(names, seed, walls)
    world = run.world
    energy = np.inf
    for tick in range(220):
        before, fast = world.pose[run.rows].copy(), np.hypot(*world.body[run.rows, :2].T)
        if tick == 40:
            world.command[run.rows] = 0.0  # walkers stop as well
        world.step()
        assert np.isfinite(world.pose[: world.count]).all()
        speeds = np.hypot(*world.velocity[run.rows, :2].T)
        moved = np.hypot(*(world.pose[run.rows, :2] - before[:, :2]).T)
        # A tick's way is what its speeds allow, and what pushes apart those that overlap.
        assert np.all(moved <= max(fast.max(), speeds.max()) * DT + 0.15)
        walking = world.motion[run.rows] == WALKING
        assert run.energy <= energy + 400.0 * walking.sum() + 1e-6 or tick == 0
        energy = run.energy
    assert np.hypot(*world.velocity[run.rows, :2].T).max() < 0.05
    shapes = run.polygons(shrink=0.03)
    for k, first in enumerate(shapes):
        for j in range(k):
            people = all(run.kinds[m].actor_class == ActorClass.WALKER for m in (j, k))
            assert people or not first.intersects(shapes[j]), (run.kinds[j].name, run.kinds[k].name)
        if walls and np.isfinite(run.kinds[k].mass):
            assert world.motion[run.rows[k]] == WALKING or not first.intersects(Polygon(WALL))


@pytest.mark.parametrize("second", KINDS)
@pytest.mark.parametrize("first", ["vehicle.tesla.model3", "vehicle.yamaha.yzf", "vehicle.mitsubishi.fusorosa"])
def test_head_on_at_30_everybody_is_found(first: str, second: str) -> None:
    world = World()
    world.spawn(1, EGO, np.array([5e3, 5e3, 0.0]), 0.0, Role.EGO)
    rows = [
        world.spawn(10 + k, BLUEPRINTS[name], np.array([x, 0.0, 0.0]), yaw, Role.TRAFFIC).row
        for k, (name, x, yaw) in enumerate(((first, 0.0, 0.0), (second, 20.0, np.pi)))
    ]
    for row in rows:
        if world.motion[row] == DRIVEN:
            world.body[row, 0] = world.command[row, 0] = 30.0
    touched = 0
    for _ in range(40):
        world.step()
        touched += len(world._contacts.rows)
    assert touched > 0
    assert world.pose[rows[0], 0] < world.pose[rows[1], 0]  # neither went through the other


def test_the_same_crash_runs_the_same() -> None:
    digests = []
    for _ in range(2):
        run = crash(KINDS[:6], 5, walls=True)
        for _ in range(120):
            run.world.step()
        digests.append(run.world.pose[run.rows].tobytes())
    assert digests[0] == digests[1]


@pytest.mark.parametrize("has_levels", [False, True])
def test_a_car_below_never_touches_one_on_the_bridge(has_levels: bool) -> None:
    run = crash(["vehicle.tesla.model3", "vehicle.audi.tt"] * 2, 11, has_levels=has_levels)
    world = run.world
    world.height[run.rows[::2]] = 6.0
    below, above = set(run.rows[::2].tolist()), set(run.rows[1::2].tolist())
    pairs = []
    for _ in range(100):
        world.step()
        pairs += [set(pair) for pair in world._contacts.rows.tolist()]
    assert not [pair for pair in pairs if pair & below and pair & above]


def test_two_crashes_on_two_levels_stay_apart() -> None:
    """Both pairs meet at one place, one pair 6 m above the other: each hits its own partner only."""
    world = World(has_levels=True)
    world.spawn(1, EGO, np.array([5e3, 5e3, 0.0]), 0.0, Role.EGO)
    rows: list[int] = []
    for k, z in enumerate((0.0, 6.0)):
        for x, yaw in ((-15.0, 0.0), (15.0, np.pi)):
            actor = world.spawn(
                10 + len(rows), BLUEPRINTS["vehicle.audi.tt"], np.array([x, 0.2 * k, z]), yaw, Role.TRAFFIC
            )
            world.body[actor.row, 0] = world.command[actor.row, 0] = 15.0
            rows.append(actor.row)
    pairs = set()
    for _ in range(60):
        world.step()
        pairs |= {tuple(pair) for pair in world._contacts.rows.tolist()}
    assert pairs == {(rows[0], rows[1]), (rows[2], rows[3])}


def test_a_contact_tells_who_where_and_how_hard() -> None:
    world = World([np.array([[20.0, -5.0], [21.0, -5.0], [21.0, 5.0], [20.0, 5.0]])])
    world.spawn(1, EGO, np.zeros(3), 0.0, Role.EGO)
    world.body[0, 0] = 20.0
    for _ in range(30):
        world.command[0, 0] = world.body[0, 0]
        world.step()
        if len(world._contacts.rows):
            break
    assert world._contacts.rows.tolist() == [[0, -1]]
    assert world._contacts.impulse[0] == pytest.approx(EGO.mass * 20.0, rel=0.03)
    assert world._contacts.point[0, 0] == pytest.approx(20.0, abs=0.3)
    assert world.touched[0] == world.tick


def test_what_stands_still_costs_and_says_nothing() -> None:
    world = World()
    world.spawn(1, EGO, np.zeros(3), 0.0, Role.EGO)
    world.spawn(2, BLUEPRINTS["vehicle.audi.tt"], np.array([4.6, 0.0, 0.0]), 0.0, Role.PARKED)
    world.body[0, 0] = world.command[0, 0] = 3.0
    seen = []
    for tick in range(100):
        world.command[0, 0] = 0.0 if tick else 3.0
        world.step()
        seen.append(len(world._contacts.rows))
    assert sum(seen) > 0
    assert sum(seen[60:]) == 0


@pytest.mark.parametrize(
    ("z", "wall", "hits"),
    [(0.0, (0.0, 3.0), True), (11.0, (0.0, 3.0), False), (11.0, (11.0, 11.8), True), (0.0, (5.0, 6.0), False),
     (0.0, (0.0, 0.2), False), (8.0, (7.9, 9.0), True)],
)  # fmt: skip
@pytest.mark.parametrize("pushed", [False, True])
def test_walls_stop_only_what_is_at_their_height(z: float, wall: tuple[float, float], hits: bool, pushed: bool) -> None:
    """Also in the engine's own hands: pushed by another car it meets only walls of its level."""
    polygon = np.array([[20.0, -5.0], [21.0, -5.0], [21.0, 5.0], [20.0, 5.0]])
    world = World([polygon], has_levels=True, wall_z=np.array([wall]))
    world.spawn(1, EGO, np.array([0.0, 0.0, z]), 0.0, Role.EGO)
    if pushed:
        world.spawn(2, BLUEPRINTS["vehicle.audi.tt"], np.array([12.0, 0.0, z]), 0.0, Role.PARKED)
    met = False
    for _ in range(60):
        world.body[0, 0] = world.command[0, 0] = 20.0
        world.step()
        met |= bool(np.any(world._contacts.rows[:, 1] < 0))
    assert met == hits
    assert (world.pose[0, 0] > 30.0) != hits


def test_the_towns_scenery_stops_a_car_that_leaves_the_road() -> None:
    """Static layout: what scenery calls solid. Driven straight on from any lane, a car ends at something."""
    from lavsim.map.town_files import load_town

    town = load_town("us_large_a")
    prisms = town.scenery.prisms
    solid = np.flatnonzero(prisms.solid)
    walls = [prisms.vertices[k, : prisms.count[k]] for k in solid]
    world = World(walls, wall_z=np.stack([prisms.z0[solid], prisms.z1[solid]], axis=1))
    house = int(np.argmax(np.ptp(prisms.vertices[solid, :, 0], axis=1)))
    middle = prisms.vertices[solid[house]].mean(axis=0)
    world.spawn(1, EGO, np.array([middle[0], middle[1] - 60.0, 0.0]), np.pi / 2.0, Role.EGO)
    for _ in range(120):
        world.command[0, 0] = 12.0
        world.step()
    assert world.touched[0] >= 0
    assert world.pose[0, 1] < middle[1]
