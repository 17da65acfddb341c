"""Certificates: what a driver who knows what will come gets past, and what who drives on blindly does not."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lavsim.agent import plan_of
from lavsim.errors import LavsimError, OutputError
from lavsim.map.town_files import load_town
from lavsim.scenarios.base import ScenarioSpec
from lavsim.types import ActorClass, Control, Role
from leaderboard.route_writer import write_routes
from leaderboard.routes import RouteEntry
from leaderboard.search import certificate as module
from leaderboard.search.certificate import Certificate, CertifyConfig, certify
from leaderboard.search.manoeuvres import Guard, Pedals, Plan, Shift, Slow, Wait, children, merged, shifted_plan
from leaderboard.search.privileged import PlanDrive
from leaderboard.search.store import LINES
from tests.drives import TOWN, hazard, straight_route
from tests.snapshots import EGO, Body, snapshot_of

GO = Control(throttle=0.5)


def routes_with(folder: Path, *specs: ScenarioSpec, end: int = 130) -> Path:
    """A route file: a straight street once for each hazard."""
    ends = straight_route().points[[0, end]]
    entries = [
        RouteEntry(str(k), TOWN, ends, (), (spec,), "2.x", "empty", "straight.xml", 1) for k, spec in enumerate(specs)
    ]
    path = folder / "straight.xml"
    path.write_bytes(write_routes(entries, "empty"))
    return path


def config(what: Path | str, out: Path, **changes: Any) -> CertifyConfig:
    return replace(CertifyConfig(str(what), out), **changes)


def at(metres: float, speed: float, *others: Body) -> Any:
    """A snapshot of an ego so far along the straight route."""
    route = straight_route()
    k = int(np.searchsorted(route.distance, metres))
    ego = Body(
        id=1, x=float(route.xy[k, 0]), y=float(route.xy[k, 1]), yaw=float(route.yaw[k]), speed=speed, role=Role.EGO,
        size=EGO.size, blueprint=EGO.blueprint,
    )  # fmt: skip
    return snapshot_of([ego, *others])


def moved_to(pedals: Pedals, metres: float, speed: float) -> Control:
    """What the pedals make of full speed ahead once the ego has come so far."""
    control = GO
    for here in np.linspace(pedals.metres, metres, 12):
        control = pedals.apply(GO, at(float(here), speed))
    return control


def test_a_wait_brakes_in_time_holds_and_lets_go() -> None:
    pedals = Pedals(straight_route(), (Wait(60.0, 1.0),))
    assert moved_to(pedals, 30.0, 8.0) == GO  # 27.5 m are left: 1.2 m/s² would do
    assert moved_to(pedals, 50.0, 8.0).brake > 0.4
    rest = at(57.0, 0.0)
    held = [pedals.apply(GO, rest).brake for _ in range(25)]
    assert held[:19] == [1.0] * 19
    assert held[-1] == 0.0


def test_a_wait_that_lies_behind_is_dropped() -> None:
    assert moved_to(Pedals(straight_route(), (Wait(20.0, 1.0),)), 40.0, 8.0) == GO


def test_slow_stretches_are_driven_slowly_and_others_are_not() -> None:
    slow = (Slow(40.0, 60.0, 3.0),)
    assert moved_to(Pedals(straight_route(), slow), 10.0, 8.0) == GO
    assert moved_to(Pedals(straight_route(), slow), 50.0, 8.0).brake == 1.0
    assert moved_to(Pedals(straight_route(), slow), 50.0, 2.9) == GO
    assert moved_to(Pedals(straight_route(), slow), 70.0, 8.0) == GO


def test_a_guard_brakes_for_who_stands_ahead_and_not_for_who_stands_beside() -> None:
    route = straight_route()
    k = int(np.searchsorted(route.distance, 40.0))
    ahead = Body(id=2, x=float(route.xy[k, 0]), y=float(route.xy[k, 1]), yaw=float(route.yaw[k]))
    beside = replace(
        ahead, x=ahead.x - 4.0 * math.sin(ahead.yaw), y=ahead.y + 4.0 * math.cos(ahead.yaw), kind=ActorClass.CAR
    )
    pedals = Pedals(route, (Guard(2.0),))
    assert pedals.apply(GO, at(5.0, 4.0, ahead)) == GO
    assert pedals.apply(GO, at(25.0, 8.0, ahead)).brake > 0.4
    assert pedals.apply(GO, at(25.0, 8.0, beside)) == GO
    assert Pedals(route, ()).apply(GO, at(25.0, 8.0, ahead)) == GO


def test_a_shift_moves_the_plan_between_its_ends_and_leaves_the_rest() -> None:
    route, town = straight_route(), load_town(TOWN)
    plan = plan_of(route, town)
    assert shifted_plan(plan, route, town, (Wait(5.0, 1.0),)) is plan
    moved = shifted_plan(plan, route, town, (Shift(40.0, 60.0, -2.0),))
    right = np.stack([-np.sin(route.yaw), np.cos(route.yaw)], axis=1)
    offset = ((moved.points[:, :2] - plan.points[:, :2]) * right).sum(axis=1)
    inside = (route.distance > 41.0) & (route.distance < 59.0)
    np.testing.assert_allclose(offset[inside], -2.0, atol=1e-6)
    outside = (route.distance < 20.0) | (route.distance > 80.0)
    np.testing.assert_allclose(offset[outside], 0.0, atol=1e-6)
    np.testing.assert_allclose(moved.points[outside], plan.points[outside])


def test_a_new_step_replaces_one_like_it_nearby() -> None:
    plan: Plan = (Wait(50.0, 5.0), Slow(10.0, 40.0, 4.0))
    assert merged(plan, (Wait(52.0, 9.0),)) == (Slow(10.0, 40.0, 4.0), Wait(52.0, 9.0))
    assert merged(plan, (Wait(90.0, 9.0),)) == (Slow(10.0, 40.0, 4.0), Wait(50.0, 5.0), Wait(90.0, 9.0))
    assert merged(plan, (Guard(2.0),))[0] == Guard(2.0)


def test_nobody_goes_round_a_red_light_and_no_shift_lies_on_another() -> None:
    assert not any(isinstance(step, Shift) for plan in children((), 80.0, 3.5, True, 10.0, True) for step in plan)
    shifted: Plan = (Shift(70.0, 100.0, -3.5),)
    for plan in children(shifted, 90.0, 3.5, True):
        assert sum(isinstance(step, Shift) for step in plan) == 1


def test_a_walker_is_passed_by_braking_and_not_by_driving_on(tmp_path: Path) -> None:
    path = routes_with(tmp_path, hazard("DynamicObjectCrossing", 30, distance=25.0))
    (found,) = certify(config(path, tmp_path / "out"))
    assert (found.ignored, found.clean_without, found.set_off) == ("collisions_pedestrian", True, True)
    assert found.passed is not None
    assert found.passed != "plain route"
    assert found.verdict == "certified"
    assert found.row()["passed by"] == found.passed


def test_the_noise_of_a_control_loss_can_be_ignored_on_a_straight_street(tmp_path: Path) -> None:
    path = routes_with(tmp_path, hazard("ControlLoss", 30), end=100)
    (found,) = certify(config(path, tmp_path / "out"))
    assert (found.verdict, found.ignored, found.passed, found.drives) == ("can be ignored", None, "plain route", 2)


def test_a_support_type_is_said_to_be_one_without_a_drive(tmp_path: Path) -> None:
    path = routes_with(tmp_path, hazard("Scenario10", 30, "1.0"))
    (found,) = certify(config(path, tmp_path / "out"))
    assert (found.verdict, found.drives) == ("support type", 0)


def pretended(
    ground: Any, seed: int, rules: Any, plan: Plan = (), agent: str = "", with_hazard: bool = True,
    from_hazard: bool = False, town_path: Any = (),
) -> PlanDrive:  # fmt: skip
    """Passes without the hazard, with a wait of 15 s before it, or by the agent called saviour."""
    passes = not with_hazard or any(isinstance(s, Wait) and s.seconds == 15.0 for s in plan) or agent == "agents.idle"
    return PlanDrive(plan, None if passes else "collisions_vehicle", 60.0, False, 10, 20.0, 99)


def test_the_search_ends_at_the_first_plan_that_passes_and_at_its_budget(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = routes_with(tmp_path, hazard("DynamicObjectCrossing", 30, distance=25.0))
    monkeypatch.setattr(module, "drive_plan", pretended)
    (found,) = certify(config(path, tmp_path / "a"))
    assert str(found.passed).startswith("waits 15 s")
    assert 2 < found.drives < 20
    (found,) = certify(config(path, tmp_path / "b", budget=4))
    assert (found.verdict, found.drives) == ("no way past found", 4)
    (found,) = certify(config(path, tmp_path / "c", budget=4, agent="agents.idle"))
    assert (found.verdict, found.passed, found.drives) == ("certified", "agents.idle", 5)


def test_a_killed_run_goes_on_and_ends_as_one_that_was_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    walkers = [hazard("DynamicObjectCrossing", 30, distance=d) for d in (20.0, 30.0, 40.0)]
    path = routes_with(tmp_path, *walkers)
    monkeypatch.setattr(module, "drive_plan", pretended)
    whole = certify(config(path, tmp_path / "whole", seeds=2))
    assert [(found.route, found.seed) for found in whole] == [(str(k // 2), k % 2) for k in range(6)]
    told: list[Certificate] = []

    def cut(done: int, total: int, certificate: Certificate) -> None:
        assert total == 6
        told.append(certificate)
        if done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        certify(config(path, tmp_path / "cut", seeds=2), cut)
    assert certify(config(path, tmp_path / "cut", seeds=2), lambda *told_now: told.append(told_now[2])) == whole
    assert len(told) == 6
    assert (tmp_path / "cut" / LINES).read_bytes() == (tmp_path / "whole" / LINES).read_bytes()
    with pytest.raises(OutputError, match="begun with budget"):
        certify(config(path, tmp_path / "cut", seeds=2, budget=7))


def test_a_file_without_the_type_is_told(tmp_path: Path) -> None:
    path = routes_with(tmp_path, hazard("DynamicObjectCrossing", 30, distance=25.0))
    with pytest.raises(LavsimError, match=r"Accident: no hazard of it in straight\.xml"):
        certify(config("Accident", tmp_path / "out", routes=str(path)))


def test_a_hazard_that_cannot_stand_where_the_file_puts_it_is_told_before_any_drive(tmp_path: Path) -> None:
    path = routes_with(tmp_path, hazard("DynamicObjectCrossing", 30, distance=-3.0))
    with pytest.raises(LavsimError, match=r"straight\.xml, route 0: .* distance must be positive"):
        certify(config(path, tmp_path / "out"))


def test_one_route_of_each_type_is_enough_if_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    walkers = [hazard("DynamicObjectCrossing", 30, distance=d) for d in (20.0, 30.0)]
    path = routes_with(tmp_path, *walkers, hazard("ControlLoss", 30))
    monkeypatch.setattr(module, "drive_plan", pretended)
    found = certify(config(path, tmp_path / "out", one_each=True))
    assert [each.kind for each in found] == ["DynamicObjectCrossing", "ControlLoss"]
