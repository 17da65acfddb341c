"""The audit of traffic finds what is wrong in doctored snapshots, and spares what is right."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lavsim.map.town_files import build_town
from lavsim.map.town_map import TownMap
from lavsim.map.write import write_network
from lavsim.towns.layout import Layout
from lavsim.traffic.audit import TrafficAudit, TrafficReport
from lavsim.traffic.audit_geometry import boxes_about_to_meet, build_stop_lines
from lavsim.types import DT, ActorClass, LightState, Role
from lavsim.world.snapshot import CONTACT_DTYPE, Snapshot
from tests import worlds
from tests.snapshots import EGO, Body, snapshot_of

CAR = Body(id=1000, size=(4.0, 1.8, 1.5))
FAR_EGO = replace(EGO, x=-500.0, y=-500.0)
RED, YELLOW, GREEN = int(LightState.RED), int(LightState.YELLOW), int(LightState.GREEN)


def watched(town: TownMap, moments: list[list[Body]], lights: list[int] | None = None, every: int = 1) -> TrafficAudit:
    """The audit of a sequence of ticks with these bodies; `lights` gives the state of all lights in each tick."""
    audit = TrafficAudit(town, every)
    for tick, bodies in enumerate(moments):
        states = [lights[tick]] * len(town.lights) if lights else [GREEN] * len(town.lights)
        audit.update(snapshot_of([FAR_EGO, *bodies], tick, lights=states))
    return audit


def eastward(start: float, end: float, y: float = 1.75, speed: float = 10.0, body: Body = CAR) -> list[list[Body]]:
    """One car along y from x = `start` to `end`."""
    xs = np.arange(start, end, speed * DT)
    return [[replace(body, x=float(x), y=y, speed=speed)] for x in xs]


def line_x(town: TownMap) -> float:
    """x of the stop line of who comes from the west."""
    lines = build_stop_lines(town, 100.0)
    return float(lines.x[np.argmin(np.abs(np.mod(lines.yaw + math.pi, 2 * math.pi) - math.pi))])


def counts(report: TrafficReport) -> dict[str, int]:
    """Whatever was counted at all."""
    return {k: v for k, v in report.as_dict().items() if isinstance(v, int) and v and not k.endswith("_chances")}


def test_a_car_that_drives_along_its_lane_leaves_distance_and_speed_alone() -> None:
    audit = watched(worlds.straight(200.0, speed=50), eastward(20.0, 120.0))
    report = audit.report()
    assert counts(report) == {}
    assert report.vehicle_km == pytest.approx(0.1, rel=0.01)
    assert report.space_mean == pytest.approx(10.0 / (50.0 / 3.6), rel=0.01)
    assert report.jerk == pytest.approx(0.0, abs=1e-6)
    assert not audit.incidents


def test_time_mean_weighs_the_fast_and_space_mean_counts_all_alike() -> None:
    town = worlds.straight(200.0, speed=36)
    slow, fast = eastward(20.0, 40.0, speed=2.0), eastward(40.0, 120.0, speed=8.0, body=replace(CAR, id=1001))
    report = watched(town, [a + b for a, b in zip(slow, fast, strict=True)]).report()
    assert report.space_mean == pytest.approx((0.2 + 0.8) / 2.0)
    assert report.time_mean == pytest.approx((2.0 * 0.2 + 8.0 * 0.8) / 10.0)


@pytest.mark.parametrize(("states", "expected"), [((RED, RED), 1), ((GREEN, GREEN), 0), ((YELLOW, RED), 0)])
def test_a_red_light_run_is_found_and_who_came_at_yellow_is_spared(states: tuple[int, int], expected: int) -> None:
    """In the third case the light turns red in the tick in which the bumper crosses."""
    town = worlds.crossing()
    line = line_x(town)
    moments = eastward(line - 20.0, line + 6.0, body=CAR)
    crossing = next(k for k, (car,) in enumerate(moments) if car.x + 2.0 >= line)
    lights = [states[k >= crossing] for k in range(len(moments))]
    report = watched(town, moments, lights).report()
    assert (report.red_lights, report.red_chances) == (expected, 1)


def test_the_bumper_counts_and_not_the_middle() -> None:
    town = worlds.crossing()
    line = line_x(town)
    short = watched(town, eastward(line - 20.0, line - 2.1), [RED] * 1000).report()
    over = watched(town, eastward(line - 20.0, line - 1.4), [RED] * 1000).report()
    assert (short.red_lights, over.red_lights) == (0, 1)


def test_who_waits_over_the_line_runs_no_red_light() -> None:
    town = worlds.crossing()
    line = line_x(town)
    moments = [[replace(CAR, x=line - 1.0, y=1.75)]] * 50 + eastward(line - 1.0, line + 5.0)
    assert watched(town, moments, [RED] * len(moments)).report().red_lights == 0


@pytest.mark.parametrize(("queued", "flow"), [(True, 1800.0), (False, 0.0)])
def test_saturation_flow_is_that_of_queued_vehicles_within_one_green(queued: bool, flow: float) -> None:
    """Four cars, 2 s apart, start at green; the first, which reacts to the light, is left out."""
    town = worlds.crossing()
    line = line_x(town)
    moments = []
    for tick in range(300):
        cars = []
        for k in range(4):
            way = max(0.0, (tick - 40 - 40 * k) * 0.25)
            x = line - 4.0 - 6.0 * k + way * (1.0 + 0.6 * k)
            speed = 0.0 if way == 0.0 and queued else 5.0
            cars.append(replace(CAR, id=1000 + k, x=min(x, line + 10.0), y=1.75, speed=speed))
        moments.append(cars)
    report = watched(town, moments, [RED] * 20 + [GREEN] * 280).report()
    assert report.saturation_flow == pytest.approx(flow, rel=0.15)


def stop_town() -> TownMap:
    layout = Layout("stops")
    layout.junction("tee", 0.0, 0.0, control="all stop")
    layout.street("West Street", (-80.0, 0.0), "tee", speed=50)
    layout.street("East Street", "tee", (80.0, 0.0), speed=50)
    layout.street("South Street", (0.0, -80.0), "tee", speed=30)
    return build_town("stops", write_network(layout.network()))


def northward(town: TownMap, halt: bool) -> list[list[Body]]:
    """A car up the stopping street; with `halt` it stands 1 m before the line for a second."""
    lines = build_stop_lines(town, 100.0)
    x, y, yaw = float(lines.x[0]), float(lines.y[0]), float(lines.yaw[0])
    ahead = np.array([math.cos(yaw), math.sin(yaw)])
    moments = []
    for way in [*np.arange(-15.0, -3.0, 0.2), *([-3.0] * 20 if halt else []), *np.arange(-3.0, 2.0, 0.2)]:
        place = np.array([x, y]) + way * ahead
        still = halt and way == -3.0
        car = replace(CAR, x=float(place[0]), y=float(place[1]), yaw=yaw, speed=0.0 if still else 4.0)
        moments.append([car])
    return moments


def test_a_halt_between_two_looks_counts() -> None:
    town = stop_town()
    moments = [m for k, m in enumerate(northward(town, True)) if m[0].speed > 0.0 or k % 20 == 3]
    assert watched(town, moments, every=5).report().stop_signs == 0


@pytest.mark.parametrize("halt", [True, False])
def test_a_stop_sign_passed_without_a_halt_is_found(halt: bool) -> None:
    town = stop_town()
    report = watched(town, northward(town, halt)).report()
    assert (report.stop_signs, report.stop_chances) == (0 if halt else 1, 1)


def contact(bodies: list[Body], a: int, b: int, tick: int) -> Snapshot:
    event = np.array([(a, b, 500.0, 20_000, 1_750)], CONTACT_DTYPE)
    return replace(snapshot_of([FAR_EGO, *bodies], tick), contacts=event)


@pytest.mark.parametrize(
    ("other", "kind"),
    [
        (replace(CAR, id=1001), "contacts"),
        (replace(CAR, id=100_000, kind=ActorClass.WALKER, size=(0.4, 0.4, 1.8)), "walkers_hit"),
        (replace(CAR, id=200_000, role=Role.PARKED), "static_hit"),
        (replace(CAR, id=1_000_000, role=Role.SCENARIO), "other_contacts"),
        (None, "static_hit"),
    ],
)
def test_a_contact_is_counted_once_by_whom_it_hits(other: Body | None, kind: str) -> None:
    audit = TrafficAudit(worlds.straight())
    bodies = [replace(CAR, x=20.0, y=1.75), *([replace(other, x=30.0, y=1.75)] if other else [])]
    for tick in range(10):
        audit.update(contact(bodies, 1000, other.id if other else 0, tick))
    assert counts(audit.report()) == {kind: 1}
    assert audit.incidents[0].actors == (1000, other.id if other else 0)
    for tick in range(60, 62):  # two seconds later it is another event
        audit.update(contact(bodies, 1000, other.id if other else 0, tick))
    assert counts(audit.report()) == {kind: 2}


def test_contacts_of_the_ego_with_scenery_are_none_of_traffic() -> None:
    audit = TrafficAudit(worlds.straight())
    audit.update(contact([replace(CAR, x=20.0, y=1.75)], 1, 0, 0))
    assert counts(audit.report()) == {}


@pytest.mark.parametrize(("y", "expected"), [(1.75, 0), (3.4, 0), (3.5, 0), (4.0, 1)])
def test_a_centre_beyond_the_lane_is_off_it(y: float, expected: int) -> None:
    report = watched(worlds.straight(), eastward(20.0, 60.0, y=y)).report()
    assert report.off_lane == expected
    assert report.off_lane_share == expected
    assert report.off_lane_worst == pytest.approx(0.5 * expected, abs=0.01)


def test_a_lane_change_is_no_way_off_the_lane() -> None:
    town = worlds.two_lanes()
    xs = np.arange(20.0, 100.0, 0.5)
    ys = np.linspace(1.75, 5.25, len(xs))
    report = watched(town, [[replace(CAR, x=float(x), y=float(y), speed=10.0)] for x, y in zip(xs, ys, strict=True)])
    assert counts(report.report()) == {"lane_changes": 1}


def test_overtaking_on_the_other_side_is_told_apart() -> None:
    report = watched(worlds.straight(), eastward(20.0, 60.0, y=-1.75)).report()
    assert report.against == 1.0
    assert report.off_lane == 0


@pytest.mark.parametrize(("state", "long_stops"), [(RED, 0), (GREEN, 1)])
def test_a_long_stop_counts_without_a_red_light_ahead(state: int, long_stops: int) -> None:
    town = worlds.crossing()
    stood = [[replace(CAR, x=line_x(town) - 20.0, y=1.75)]] * 400
    report = watched(town, stood, [state] * 400, every=5).report()
    assert report.long_stops == 0  # 20 s so far
    audit = TrafficAudit(town, every=20)
    for tick in range(0, 3800, 20):
        audit.update(snapshot_of([FAR_EGO, *stood[0]], tick, lights=[state] * len(town.lights)))
    assert (audit.report().long_stops, audit.report().blocked) == (long_stops, 1)
    assert audit.report().longest_stop == pytest.approx(189.0, abs=1.1)


def test_a_hard_brake_counts_once_and_a_soft_one_not() -> None:
    for deceleration, expected in (
        (3.0, {}),
        (5.0, {"harsh_brakes": 1}),
        (8.0, {"harsh_brakes": 1, "emergency_brakes": 1}),
    ):
        speeds = [*[12.0] * 20, *np.arange(12.0, 4.0, -deceleration * DT), *[4.0] * 20]
        xs = 20.0 + np.cumsum(speeds) * DT
        moments = [[replace(CAR, x=float(x), y=1.75, speed=float(v))] for x, v in zip(xs, speeds, strict=True)]
        assert counts(watched(worlds.straight(), moments, every=2).report()) == expected


def test_a_vehicle_set_elsewhere_is_a_jump_and_drives_no_distance() -> None:
    moments = [*eastward(20.0, 40.0), *eastward(140.0, 160.0)]
    report = watched(worlds.straight(), moments).report()
    assert counts(report) == {"jumps": 1}
    assert report.vehicle_km == pytest.approx(0.04, rel=0.06)


@pytest.mark.parametrize(("x", "expected"), [(45.0, 1), (70.0, 0)])
def test_a_near_miss_is_who_would_touch_within_half_a_second(x: float, expected: int) -> None:
    """A car that comes to 35 … 40 m at 10 m/s, and one that stands 45 m or 70 m along."""
    ahead = replace(CAR, id=1001, x=x, y=1.75)
    report = watched(worlds.straight(), [[car, ahead] for (car,) in eastward(35.0, 40.0)]).report()
    assert report.near_misses == expected


def test_oncoming_cars_in_their_lanes_miss_each_other() -> None:
    pose = np.array([[0.0, 1.75, 0.0], [20.0, -1.75, math.pi]])
    velocity = np.array([[10.0, 0.0], [-10.0, 0.0]])
    half = np.tile([2.0, 0.9], (2, 1))
    pairs, _ = boxes_about_to_meet(pose, velocity, np.zeros(2), half, np.zeros(2), 1.0, 2.0)
    assert len(pairs) == 0
    pose[1, 1] = 1.0  # on the same side
    pairs, time = boxes_about_to_meet(pose, velocity, np.zeros(2), half, np.zeros(2), 1.0, 2.0)
    assert pairs.tolist() == [[0, 1]]
    assert time[0] == 1.0


def test_actors_may_come_and_go() -> None:
    audit = TrafficAudit(worlds.straight(), every=1)
    audit.update(snapshot_of([FAR_EGO], 0))
    audit.update(snapshot_of([FAR_EGO, replace(CAR, x=30.0, y=1.75)], 1))
    audit.update(snapshot_of([FAR_EGO], 2))
    assert counts(audit.report()) == {}
    assert audit.report().vehicles == pytest.approx(1.0 / 3.0)
