"""The score functions against the worked examples of the originals, and their properties."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from leaderboard.criteria.base import Infraction, charges_of
from leaderboard.rules import RULES, Rules
from leaderboard.score import RouteRecord, plain_rates, record_of, scores, status, summarise

KEYS = {
    "veh": "collisions_vehicle",
    "ped": "collisions_pedestrian",
    "static": "collisions_layout",
    "red": "red_light",
    "stop": "stop_infraction",
    "blocked": "vehicle_blocked",
    "timeout": "route_timeout",
    "dev": "route_dev",
    "off": "outside_route_lanes",
    "slow": "min_speed_infractions",
    "scen": "scenario_timeouts",
    "emergency": "yield_emergency_vehicle_infractions",
}


def event(text: str) -> Infraction:
    """ "veh", "off:8:96" (percent, metres), "slow:80" (percent)."""
    name, *numbers = text.split(":")
    values = [float(n) for n in numbers] + [None, None]
    return Infraction(KEYS[name], 0, (0.0, 0.0, 0.0), name, value=values[0], metres=values[1])


def record(row: tuple[float, float, str, str | None], rules: Rules, index: int = 0) -> RouteRecord:
    length, percent, events, failure = row
    return record_of(
        index=index,
        route_id=f"RouteScenario_{index}",
        completion=percent,
        reached=percent == 100.0,
        infractions=[event(e) for e in events.split()],
        failure=failure,
        route_length=length,
        duration_game=10.0,
        duration_system=1.0,
        rules=rules,
    )


# id: (length [m], completion, events, outside reason), (P, D) in 1.0, 2.0 and 2.1, status in 1.0 and 2.x
WORKED: dict[str, Any] = {
    "W1": ((1000, 100, "", None), (1, 100), (1, 100), (1, 100), "Completed", "Perfect"),
    "W2": ((1000, 100, "veh", None), (0.6, 60), (0.6, 60), (0.588235, 58.823529), "Completed", "Completed"),
    "W3": (
        (1000, 100, "ped veh static red stop", None),
        (0.1092, 10.92),
        (0.1092, 10.92),
        (0.253165, 25.316456),
        "Completed",
        "Completed",
    ),
    "W4": (
        (1500, 42.5, "ped blocked", None),
        (0.5, 21.25),
        (0.5, 21.25),
        (0.5, 21.25),
        *["Failed - Agent got blocked"] * 2,
    ),
    "W5": ((1200, 100, "off:8:96 stop", None), (0.736, 73.6), (0.736, 73.6), (0.736, 73.6), "Completed", "Completed"),
    "W6": (
        (2000, 61.37, "red red red timeout", None),
        (0.343, 21.04991),
        (0.343, 21.04991),
        (0.454545, 27.895455),
        *["Failed - Agent timed out"] * 2,
    ),
    "W7": (
        (800, 30, "static dev", None),
        (0.65, 19.5),
        (0.65, 19.5),
        (0.625, 18.75),
        *["Failed - Agent deviated from the route"] * 2,
    ),
    "W8": ((900, 0, "veh blocked", None), (0.6, 0), (0.6, 0), (0.588235, 0), *["Failed - Agent got blocked"] * 2),
    "W9b": (
        (1000, 50, "veh veh blocked", None),
        (0.36, 18),
        (0.36, 18),
        (0.416667, 20.833333),
        *["Failed - Agent got blocked"] * 2,
    ),
    "W10": (
        (3000, 100, "slow:80 slow:60 scen", None),
        (1, 100),
        (0.57904, 57.904),
        (0.609756, 60.97561),
        "Completed",
        "Completed",
    ),
    "W11": (
        (2500, 100, "emergency veh veh", None),
        (0.36, 36),
        (0.252, 25.2),
        (0.357143, 35.714286),
        "Completed",
        "Completed",
    ),
    "W12b": ((2000, 100, "red", None), (0.7, 70), (0.7, 70), (0.714286, 71.428571), "Completed", "Completed"),
    "W12c": ((500, 20, "", "Agent crashed"), (1, 20), (1, 20), (1, 20), *["Failed - Agent crashed"] * 2),
}

RUNS = {
    "W9": [(1000, 100, "", None), WORKED["W9b"][0]],
    "W12": [(1000, 100, "", None), WORKED["W12b"][0], WORKED["W12c"][0]],
} | {name: [WORKED[name][0]] for name in WORKED}

# normalised infractions that are not 0, in 1.0 and in 2.x
RATES: dict[str, tuple[dict[str, float], dict[str, float]]] = {
    "W1": ({}, {}),
    "W2": ({"veh": 1}, {"veh": 1}),
    "W3": (dict.fromkeys(("ped", "veh", "static", "red", "stop"), 1.0),) * 2,
    "W4": ({"ped": 1.568627, "blocked": 1.568627}, {"ped": 1.569, "blocked": 1.569}),
    "W5": ({"stop": 0.833333, "off": 0.833333}, {"stop": 0.833, "off": 0.096}),
    "W6": ({"red": 2.444191, "timeout": 0.81473}, {"red": 2.444, "timeout": 0.815}),
    "W7": ({"static": 4.166667, "dev": 4.166667}, {"static": 4.167, "dev": 4.167}),
    "W8": ({}, {"veh": 1000, "blocked": 1000}),
    "W9": ({"veh": 4, "blocked": 2}, {"veh": 1.333, "blocked": 0.667}),
    "W10": ({}, {"slow": 0.667, "scen": 0.333}),
    "W11": ({"veh": 0.8}, {"veh": 0.8, "emergency": 0.4}),
    "W12": ({"red": 0.5}, {"red": 0.323}),
}


@pytest.mark.parametrize("version", ["1.0", "2.0", "2.1"])
@pytest.mark.parametrize("name", WORKED)
def test_worked_example_of_one_route(name: str, version: str) -> None:
    row, *expected, status_1, status_2 = WORKED[name]
    made = record(row, RULES[version])
    penalty, composed = expected[("1.0", "2.0", "2.1").index(version)]
    assert round(made.scores.penalty, 6) == penalty
    assert round(made.scores.composed, 6) == composed
    assert made.status == (status_1 if version == "1.0" else status_2)


@pytest.mark.parametrize("version", ["1.0", "2.0", "2.1"])
@pytest.mark.parametrize("name", RATES)
def test_worked_example_of_rates(name: str, version: str) -> None:
    rules = RULES[version]
    summary = summarise([record(row, rules, k) for k, row in enumerate(RUNS[name])], len(RUNS[name]), rules)
    rates = {key: round(rate, 6) for key, rate in summary.rates.items() if rate}
    assert rates == {KEYS[key]: rate for key, rate in RATES[name][version != "1.0"].items()}


@pytest.mark.parametrize(
    ("name", "version", "mean", "deviation"),
    [
        ("W9", "1.0", 59.0, 57.982756),
        ("W9", "2.0", 59.0, 57.983),
        ("W9", "2.1", 60.416666, 55.979),
        ("W12", "1.0", 63.333333, 40.414519),
        ("W12", "2.0", 63.333333, 40.415),
        ("W12", "2.1", 63.809524, 40.541),
    ],
)
def test_worked_example_of_several_routes(name: str, version: str, mean: float, deviation: float) -> None:
    rules = RULES[version]
    summary = summarise([record(row, rules, k) for k, row in enumerate(RUNS[name])], len(RUNS[name]), rules)
    assert summary.deviation is not None
    assert (round(summary.mean.composed, 6), round(summary.deviation.composed, 6)) == (mean, deviation)
    assert round(summary.mean.route, 6) == {"W9": 75.0, "W12": 73.333333}[name]
    assert summary.status == "Failed"


def test_missing_routes_count_as_zero_in_the_mean_and_not_in_the_deviation() -> None:
    summary = summarise([record((1000, 100, "", None), RULES["1.0"])], 2, RULES["1.0"])
    assert summary.mean.composed == 50.0
    assert summary.deviation is not None
    assert summary.deviation.composed == 50.0


def test_plain_rate_is_total_count_over_total_distance() -> None:
    records = [record(row, RULES["1.0"], k) for k, row in enumerate(RUNS["W9"])]
    assert plain_rates(records, 1.5, RULES["1.0"])["collisions_vehicle"] == pytest.approx(2 / 1.5)


def test_min_speed_costs_nothing_on_bench2drive() -> None:
    assert scores(100.0, [event("slow:40")], RULES["bench2drive"]).composed == 100.0
    assert scores(100.0, [event("veh")], RULES["bench2drive"]).composed == 60.0


@pytest.mark.parametrize(
    ("reached", "events", "failure", "expected"),
    [
        (False, "", None, "Failed"),
        (False, "", "Agent crashed", "Failed - Agent crashed"),
        (False, "timeout", "Agent crashed", "Failed - Agent timed out"),
        (False, "dev blocked", "Agent crashed", "Failed - Agent got blocked"),
        (False, "blocked timeout dev", None, "Failed - Agent got blocked"),
        (True, "timeout", None, "Completed"),
        (True, "", "Agent crashed", "Completed"),
    ],
)
def test_last_known_reason_wins_and_a_reached_target_hides_all(
    reached: bool, events: str, failure: str | None, expected: str
) -> None:
    assert status(reached, [event(e) for e in events.split()], failure, RULES["1.0"]) == expected


anything = st.lists(
    st.sampled_from(["veh", "ped", "static", "red", "stop", "blocked", "dev", "timeout", "scen", "emergency"])
    | st.floats(0.0, 100.0).map(lambda p: f"slow:{p}"),
    max_size=12,
)
versions = st.sampled_from(sorted(RULES))


@given(events=anything, off=st.floats(0.0, 100.0), percent=st.floats(0.0, 100.0), version=versions)
def test_scores_stay_in_their_bounds(events: list[str], off: float, percent: float, version: str) -> None:
    made = scores(percent, [event(e) for e in [*events, f"off:{off}"]], RULES[version])
    assert 0.0 <= made.penalty <= 1.0
    assert 0.0 <= made.composed <= 100.0


@given(events=anything, extra=anything, percent=st.floats(0.0, 100.0), version=versions)
def test_one_more_infraction_never_raises_the_score(
    events: list[str], extra: list[str], percent: float, version: str
) -> None:
    fewer = scores(percent, [event(e) for e in events], RULES[version])
    more = scores(percent, [event(e) for e in events + extra], RULES[version])
    assert more.penalty <= fewer.penalty + 1e-12
    assert more.composed <= fewer.composed + 1e-9


@given(events=st.permutations(["veh", "off:3", "red", "ped", "slow:70", "stop", "veh"]), version=versions)
def test_order_of_events_does_not_matter(events: list[str], version: str) -> None:
    usual = scores(80.0, [event(e) for e in sorted(events)], RULES[version])
    assert scores(80.0, [event(e) for e in events], RULES[version]) == usual


@pytest.mark.parametrize("version", sorted(RULES))
def test_kinds_of_infraction_of_each_version(version: str) -> None:
    charges = charges_of(RULES[version])
    assert len(charges) == (9 if RULES[version].generation == "1.0" else 12)
    assert sorted(c.column for c in charges.values()) == list(range(4, 4 + len(charges)))
