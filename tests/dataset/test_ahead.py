"""What a frame says of the way ahead, against the map; and which ticks are frames."""

from pathlib import Path

import numpy as np
import pytest

from lavsim.dataset.ahead import SIGHT, RouteView
from lavsim.dataset.frames import FrameMaker, Keeper
from lavsim.dataset.plan import CollectPlan
from lavsim.dataset.reader import Dataset
from lavsim.dataset.schema import DatasetInfo, RecordConfig
from lavsim.dataset.writer import EpisodeWriter
from lavsim.episode import EpisodeResult
from lavsim.geometry import to_local, wrap_angle
from lavsim.map.planner import get_planner
from lavsim.map.route import Route
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.render.scene import get_scene
from lavsim.simulation import Simulation
from lavsim.types import Control, LightState
from lavsim.world.snapshot import Snapshot
from tests.drives import follow, straight_drive, straight_route
from tests.snapshots import EGO, Body, snapshot_of

TOWNS = ("eu_small_a", "us_large_a", "us_rural")


def town_and_route(number: int) -> tuple[TownMap, Route]:
    plan = CollectPlan(towns=TOWNS, seed=3, length=(400.0, 1500.0))
    town = load_town(TOWNS[number % len(TOWNS)])
    return town, get_planner(town).trace(plan.episode(number).spec.keypoints)


def at_point(route: Route, index: int, lights: list[int]) -> Snapshot:
    x, y, z = route.points[index].tolist()
    body = Body(EGO.id, x, y, z, float(route.yaw[index]), role=EGO.role, size=EGO.size, blueprint=EGO.blueprint)
    return snapshot_of([body], lights=lights)


def crossed(route: Route, lines: list[tuple[int, float, float, float]]) -> list[tuple[float, int]]:
    """Places [m] where a route goes over stop lines (whose, x, y, yaw), found from the points alone."""
    found = []
    for whose, x, y, yaw in lines:
        local = to_local(route.xy, (x, y), yaw)
        if np.abs(local).sum(axis=1).min() > 5.0:
            continue
        aligned = np.abs(wrap_angle(route.yaw - yaw)) < 0.5
        over = (local[:-1, 0] < 0.0) & (local[1:, 0] >= 0.0) & (np.abs(local[:-1, 1]) < 1.0) & aligned[:-1]
        found += [(float(route.distance[k] - local[k, 0]), whose) for k in np.flatnonzero(over)]
    return sorted(found)


@pytest.mark.parametrize("number", range(3))
def test_lights_and_stop_signs_are_those_whose_lines_the_route_crosses(number: int) -> None:
    town, route = town_and_route(number)
    view = RouteView(route, town)
    lights = [(light.index, line.x, line.y, line.yaw) for light in town.lights for line in light.stop_lines]
    signs = [(s.index, p.x, p.y, p.yaw) for s in town.signs if s.kind == "stop" for p in s.stop_lines]
    for expected, (places, whose) in ((crossed(route, lights), view.lights), (crossed(route, signs), view.stop_signs)):
        assert whose.tolist() == [number for _, number in expected]
        assert places == pytest.approx([place for place, _ in expected], abs=0.8)


@pytest.mark.parametrize(
    ("before", "is_told"), [(30.0, True), (SIGHT - 2.0, True), (SIGHT + 2.0, False), (-0.8, True), (-3.5, False)]
)
def test_the_next_light_is_told_from_the_front_of_the_ego(before: float, is_told: bool) -> None:
    town, route = town_and_route(1)
    places, whose = RouteView(route, town).lights
    number = int(np.argmax(np.diff(places, prepend=0.0) > SIGHT + 10.0))  # one with none shortly before it
    states = [int(LightState.RED)] * len(town.lights)
    states[int(whose[number])] = int(LightState.GREEN)
    index = int(np.searchsorted(route.distance, places[number] - before - EGO.size[0] / 2.0))
    view = RouteView(route, town)
    for k in range(index + 1):
        view.update(at_point(route, k, states))
    columns = view.columns(at_point(route, index, states))
    assert (columns["light"] == whose[number]) == is_told
    if is_told:
        assert columns["light_distance"] == pytest.approx(before, abs=1.0)
        assert columns["light_state"] == LightState.GREEN
    assert columns["route_index"] == index
    assert columns["route"][0] == pytest.approx((0.0, 0.0), abs=1e-3)


def test_the_end_of_the_route_repeats() -> None:
    route = straight_route()
    town = load_town("eu_small_a")
    view = RouteView(route, town)
    for k in range(len(route)):
        view.update(at_point(route, k, [0] * len(town.lights)))
    columns = view.columns(at_point(route, len(route) - 1, [0] * len(town.lights)))
    assert np.allclose(columns["route"], 0.0, atol=1e-3)
    assert columns["light"] == -1
    assert np.isnan(columns["light_distance"])
    assert columns["light_state"] == LightState.UNKNOWN


def test_every_fifth_tick_is_kept_until_the_ego_has_stood_too_long() -> None:
    keeper = Keeper(stand_ticks=12)
    kept = [tick for tick in range(1, 41) if keeper.keeps(moving(tick, 0.0 if 10 <= tick < 31 else 3.0))]
    assert kept == [5, 10, 15, 20, 35, 40]


def moving(tick: int, speed: float) -> Snapshot:
    return snapshot_of([Body(EGO.id, 0.0, 0.0, 0.0, 0.0, speed=speed, role=EGO.role)], tick=tick)


def test_time_may_jump_and_all_ticks_are_still_told(tmp_path: Path) -> None:
    info = DatasetInfo.of(RecordConfig((), blobs=False, stand_ticks=10))
    info.write(tmp_path)
    simulation = Simulation(straight_drive())
    writer = EpisodeWriter(tmp_path, 0, info)
    writer.start(simulation)
    for tick in range(60):
        writer.observe(simulation.snapshot)
        drives = tick >= 33
        simulation.tick(follow(simulation.route, simulation.snapshot) if drives else Control(brake=1.0))
    writer.finish(EpisodeResult(60, "tick limit"))
    data = Dataset(tmp_path)
    table = data.table(0)
    ticks = table["tick"].tolist()
    jump = next(k for k in range(1, len(ticks)) if ticks[k] != ticks[k - 1] + 5)
    assert data.episodes[0].breaks == (jump,)
    assert [len(table.columns["tick_speed"].row(k)) for k in range(len(ticks))] == np.diff([0, *ticks]).tolist()
    assert np.isnan(table["wish"]).all()
    assert set(table["brake_cause"]) == {"none"}


def test_the_ego_hears_of_whom_it_touched() -> None:
    simulation = Simulation(straight_drive())
    maker = FrameMaker(RecordConfig(()), simulation.route, get_scene(simulation.town), simulation.draws)
    contacts = [(1, 0), (1005, 1), (1005, 1006)]
    for tick in range(1, 6):
        body = Body(EGO.id, 0.0, 0.0, 0.0, 0.0, role=EGO.role)
        snapshot = snapshot_of([body], tick=tick, lights=[0] * len(simulation.town.lights))
        if tick == 3:
            touched = np.zeros(3, snapshot.contacts.dtype)
            touched["a"], touched["b"] = np.array(contacts).T
            object.__setattr__(snapshot, "contacts", touched)
        kept = maker.see(snapshot)
    assert kept
    assert maker.row({}, None, None)["contacts"].tolist() == [0, 1005]
