"""The ten types of 1.0: set off where they should be, acting as the table says, and gone afterwards."""

import numpy as np
import pytest

from lavsim.errors import RouteError
from lavsim.map.town_files import load_town
from lavsim.scenarios.place import Site
from lavsim.simulation import Simulation
from lavsim.types import Control, LightState
from lavsim.world.snapshot import Snapshot
from leaderboard.hazard_maker import hazard_types, stands
from tests.scenarios.stands import FIRST, Follower, active, drive, hits, left_over, run, stand

TYPES = [kind for _, kind in hazard_types("1.0")]


def there(snapshots: list[Snapshot], number: int) -> list[tuple[np.ndarray, float]]:
    """Places and speeds of one of the hazard's actors while it is there."""
    rows = [(s, s.index_of(FIRST + number)) for s in snapshots]
    return [(s.xy[row], float(s.speeds[row])) for s, row in rows if row is not None]


def town_for(kind: str) -> str:
    return "us_large_a" if kind in ("Scenario5", "Scenario10") else "eu_small_a"


def test_there_are_ten() -> None:
    assert sorted(TYPES) == sorted(f"Scenario{number}" for number in range(1, 11))


@pytest.mark.parametrize("kind", TYPES)
def test_it_repeats_exactly_and_leaves_nobody(kind: str) -> None:
    town = town_for(kind)
    spec = drive(stand(kind, town=town), town)
    first, again = (run(spec, 900, Follower(looks=kind != "Scenario6")) for _ in range(2))
    assert all((a.pose == b.pose).all() and (a.lights == b.lights).all() for a, b in zip(first, again, strict=True))
    begin, end = active(first)
    assert 0 < begin < 400
    if end < len(first):
        assert left_over(first[-1]) == 0


def test_it_is_set_off_within_1_5_m_of_its_trigger() -> None:
    place = stand("Scenario3")
    snapshots = run(drive(place), 250)
    begin, _ = active(snapshots)
    gaps = [np.hypot(*(s.ego.xy - place.spec.trigger[:2])) for s in snapshots]
    assert gaps[begin - 1] < 2.2
    assert gaps[begin - 2] > 0.8
    assert left_over(snapshots[begin - 1]) == 0, "actors appear when it is set off"


def test_control_loss_lays_debris_that_nothing_touches_and_disturbs_nobody_under_the_rules_1_0() -> None:
    place = stand("Scenario1")
    snapshots, free = run(drive(place), 700), run(drive(place, scenarios=()), 700)
    assert hits(snapshots) == set()
    x, y = place.spec.trigger[:2]
    apart = [float(np.hypot(*(there(snapshots, k)[0][0] - (x, y)))) for k in range(3)]
    assert apart == pytest.approx([12.0, 46.0, 72.0], abs=0.6)
    assert all((a.ego.xy == b.ego.xy).all() for a, b in zip(snapshots, free, strict=True))
    assert active(snapshots)[1] < 700
    assert left_over(snapshots[-1]) == 0


def test_control_loss_is_applied_under_the_corrected_rules() -> None:
    place = stand("Scenario1")
    spec = drive(place, rules="corrected")
    snapshots, free = run(spec, 600), run(drive(place, scenarios=()), 600)
    begin, end = active(snapshots)
    deviation = [float(np.hypot(*(a.ego.xy - b.ego.xy))) for a, b in zip(snapshots, free, strict=True)]
    assert max(deviation[: begin + 5]) == 0.0
    assert max(deviation[begin:end]) > 0.1
    assert (snapshots[-1].control == run(spec, 600)[-1].control).all()


def test_the_lead_brakes_before_the_junction_and_is_taken_away_when_the_ego_has_stood() -> None:
    """Hurts who does not look, spares who does."""
    place = stand("Scenario2")
    assert hits(run(drive(place), 700)) == {0}
    snapshots = run(drive(place), 900, Follower(looks=True))
    assert hits(snapshots) == set()
    lead = there(snapshots, 0)
    assert max(speed for _, speed in lead) == pytest.approx(10.0, abs=0.1)
    assert lead[-1][1] < 0.02
    site = Site(load_town("eu_small_a"), place.route, place.index)
    assert site.junction is not None
    end = place.route.xy[site.junction[0]]
    assert np.hypot(*(lead[-1][0] - end)) == pytest.approx(14.0, abs=6.0)
    assert left_over(snapshots[-1]) == 0


def test_the_walker_runs_out_from_behind_its_machine() -> None:
    place = stand("Scenario3")
    assert hits(run(drive(place), 300)) == {1}
    snapshots = run(drive(place), 500, Follower(5.0, looks=True))
    assert hits(snapshots) == set()
    walker = there(snapshots, 1)
    assert max(speed for _, speed in walker) == pytest.approx(3.4, abs=0.05)
    assert np.hypot(*(walker[-1][0] - walker[0][0])) > 6.0
    begin, end = active(snapshots)
    gone = sum(len(there([s], 1)) == 0 for s in snapshots[begin:end])
    assert gone > 20, "it is over 40 m after both have gone"
    assert left_over(snapshots[-1]) == 0


def test_the_cyclist_crosses_behind_the_turn() -> None:
    place = stand("Scenario4")
    assert hits(run(drive(place), 500)) == {0}
    snapshots = run(drive(place), 700, Follower(looks=True))
    assert hits(snapshots) == set()
    bicycle = there(snapshots, 0)
    assert np.hypot(*(bicycle[-1][0] - bicycle[0][0])) > 6.5
    assert left_over(snapshots[-1]) == 0


@pytest.mark.parametrize(("rules", "speed", "is_hit"), [("1.0", 17.19, False), ("corrected", 4.77, True)])
def test_the_lead_slows_down_to_what_its_number_means(rules: str, speed: float, is_hit: bool) -> None:
    place = stand("Scenario5", town="us_large_a")
    snapshots = run(drive(place, "us_large_a", rules=rules), 800)
    assert there(snapshots, 0)[100][1] == pytest.approx(speed, abs=0.05)
    assert (hits(snapshots) == {0}) is is_hit


def test_barriers_block_the_lane_and_eight_cars_at_most_come_towards_the_ego() -> None:
    place = stand("Scenario6")
    snapshots = run(drive(place), 800)
    assert 0 in hits(snapshots)
    x, y = place.spec.trigger[:2]
    apart = [float(np.hypot(*(there(snapshots, k)[0][0] - (x, y)))) for k in range(2)]
    assert apart == pytest.approx([50.0, 52.0], abs=1.5)
    cars = {int(k) - FIRST for s in snapshots for k in s.ids if k >= FIRST + 2}
    assert 3 <= len(cars) <= 8
    assert max(speed for _, speed in there(snapshots, 2)) == pytest.approx(5.56, abs=0.02)


@pytest.mark.parametrize("kind", ["Scenario7", "Scenario8", "Scenario9"])
def test_ego_and_opponents_get_green_together(kind: str) -> None:
    place = stand(kind)
    simulation = Simulation(drive(place))
    site = Site(simulation.town, place.route, place.index)
    assert site.junction is not None
    own, line = site.light, place.route.xy[site.junction[0]]
    driver, states, seen = Follower(), list[int](), list[np.ndarray]()
    for _ in range(900):
        near = np.hypot(*(simulation.snapshot.ego.xy - line)) < 9.0
        waits = near and simulation.snapshot.lights[own] != LightState.GREEN
        snapshot = simulation.tick(Control(brake=1.0) if waits else driver(simulation))
        if len(snapshot.hazards):
            states.append(int(snapshot.lights[own]))
            seen.append(snapshot.lights.copy())
    order = [state for k, state in enumerate(states) if k == 0 or state != states[k - 1]]
    assert order[:4] == [LightState.GREEN, LightState.YELLOW, LightState.RED, LightState.GREEN]
    assert states.count(LightState.YELLOW) >= 40
    group = next(g for g in simulation.town.light_groups if any(own in phase for phase in g.phases))
    members = [k for phase in group.phases for k in phase]
    assert max(int(np.sum(lights[members] == LightState.GREEN)) for lights in seen) >= 2
    assert simulation._lights._held == {}


def test_lights_are_left_alone_where_nobody_can_come() -> None:
    """At a junction without lights Scenario7 ends at once."""
    place = next(stands(load_town("us_large_a"), "Scenario10", "1.0"))
    spec = type(place.spec)("S", "Scenario7", "1.0", place.spec.trigger, {})
    snapshots = run(drive(place, "us_large_a", scenarios=(spec,)), 200)
    assert active(snapshots) == (-1, -1)


def test_a_junction_without_lights_is_only_marked() -> None:
    place = stand("Scenario10", town="us_large_a")
    snapshots = run(drive(place, "us_large_a"), 900)
    begin, end = active(snapshots)
    assert 0 < begin < end < 900
    assert left_over(snapshots[begin]) == 0


def test_no_second_lane_no_scenario5() -> None:
    place = stand("Scenario3")
    spec = type(place.spec)("Scenario5_1", "Scenario5", "1.0", place.spec.trigger, {})
    with pytest.raises(RouteError, match="there is no lane to the left"):
        Simulation(drive(place, scenarios=(spec,)))
