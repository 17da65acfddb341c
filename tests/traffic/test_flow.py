"""Background traffic flows as the theory of its following model says, on a ring road of one lane."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lavsim.random import Draws
from lavsim.traffic.audit import TrafficAudit
from lavsim.traffic.drivers import Driver, draw_driver
from lavsim.types import DT, ActorClass
from lavsim.world.blueprints import find_blueprint
from lavsim.world.snapshot import Snapshot
from tests.traffic.roads import Drive, circle, evenly

LENGTH = 400.0  # [m] of the ring
CAR = "vehicle.seat.leon"  # bicycles among them would set everybody's speed
LEON = find_blueprint(CAR).size[0]  # [m]


def drivers_of(snapshot: Snapshot, seed: int = 0) -> list[Driver]:
    """Who drives each vehicle, by its id."""
    draws = Draws.of_seed(seed).stream("traffic")
    return [
        draw_driver(draws, int(actor), ActorClass(int(kind)))
        for actor, kind in zip(snapshot.ids[1:], snapshot.classes[1:], strict=True)
    ]


def gaps_ahead(snapshot: Snapshot, around: float) -> NDArray[np.float64]:
    """Bumper to bumper distance of each vehicle to the next on a ring `around` metres round [m]."""
    x, y = snapshot.xy[1:].T
    way = -np.arctan2(y, x) / (2.0 * np.pi) * around  # travel is counter-clockwise seen from above, y points south
    order = np.argsort(way)
    half = snapshot.sizes[1:, 0].astype(float) / 2.0
    gaps = np.empty(len(way))
    for k, i in enumerate(order):
        ahead = order[(k + 1) % len(order)]
        gaps[i] = (way[ahead] - way[i]) % around - half[ahead] - half[i]
    return gaps


def settled(
    limit: int, count: int, ticks: int, watched: int = 600
) -> tuple[Snapshot, NDArray[np.float64], TrafficAudit]:
    """`count` cars on the ring: the last of `ticks` ticks, mean speed [m/s] and gap [m] of each (2, count) over the
    last `watched` ticks, and the audit of all."""
    town = circle(LENGTH, limit)
    around = float(town.lanes.length.sum())
    drive, audit = Drive(town, evenly(town, count), blueprint=CAR), TrafficAudit(town)
    sums = np.zeros((2, count))
    for tick in range(ticks):
        snapshot = drive.tick()
        audit.update(snapshot)
        if tick >= ticks - watched:
            sums += snapshot.speeds[1:], gaps_ahead(snapshot, around)
    return snapshot, sums / watched, audit


def equilibrium_gap(driver: Driver, speed: float) -> float:
    """What the improved intelligent driver model keeps below its wanted speed when nobody's speed changes [m]."""
    return driver.min_gap + speed * driver.headway


def test_vehicles_keep_the_gap_of_theory() -> None:
    """In equilibrium all drive alike, at the speed at which their gaps fill the ring."""
    limit, count = 50, 30
    snapshot, (speeds, gaps), audit = settled(limit, count, ticks=3000)
    drivers = drivers_of(snapshot)

    expected = float(gaps.sum() - sum(d.min_gap for d in drivers)) / sum(d.headway for d in drivers)
    assert expected < min(d.speed_factor for d in drivers) * limit / 3.6
    assert speeds.mean() == pytest.approx(expected, rel=0.03)
    assert np.ptp(speeds) < 0.3
    theory = np.array([equilibrium_gap(d, expected) for d in drivers])
    assert np.abs(gaps / theory - 1.0).max() < 0.05
    assert audit.report().contacts == 0


def test_a_lone_vehicle_drives_as_fast_as_its_driver_wants() -> None:
    snapshot, (speeds, _gaps), _audit = settled(limit=50, count=1, ticks=800, watched=100)
    assert speeds[0] == pytest.approx(drivers_of(snapshot)[0].speed_factor * 50.0 / 3.6, rel=0.02)


def test_a_lane_carries_as_much_as_real_ones() -> None:
    """The highest flow of a ring is 1,500 to 2,200 vehicles/h: the saturation flow of a real lane."""
    flows = []
    for count in (23, 27):
        _snapshot, (speeds, gaps), _audit = settled(limit=50, count=count, ticks=1800)
        flows.append(3600.0 * float(speeds.mean()) / (float(gaps.mean()) + LEON))
    assert 1500.0 < max(flows) < 2200.0, flows


def test_stop_and_go_waves_hit_nobody_and_dissolve_or_travel() -> None:
    """A queue on two thirds of the ring, the rest empty: it starts from its head, and its tail meets the head again."""
    town = circle(LENGTH, 50)
    places = evenly(town, 44)[:29]  # 9 m each
    drive, audit = Drive(town, places), TrafficAudit(town)
    least = np.inf
    for _ in range(3000):
        snapshot = drive.tick()
        audit.update(snapshot)
        if snapshot.tick % 20 == 0:
            least = min(least, float(gaps_ahead(snapshot, float(town.lanes.length.sum())).min()))
    report = audit.report()
    assert report.contacts == 0
    assert report.off_lane == 0
    assert report.emergency_brakes == 0
    assert least > 0.3
    assert snapshot.speeds[1:].mean() > 1.0
    assert report.longest_stop < 60.0
    assert snapshot.tick * DT == 150.0
