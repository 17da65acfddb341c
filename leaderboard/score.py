"""Scores as pure functions: penalty, completion, status, means, deviations, rates.

Nothing here watches a drive or writes a file, so the worked examples of the originals are tests of these functions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from leaderboard.criteria.base import Infraction, charges_of, in_order
from leaderboard.rules import Rules

SIMULATION_CRASHED = "Simulation crashed"
SENSORS_INVALID = "Agent's sensors were invalid"
AGENT_FAILURES = ("Agent crashed", "Agent couldn't be set up")  # by the agent itself, not by how it drove

OUTSIDE = "outside_route_lanes"
SHORTEST = 0.001  # [km] taken for a run that came nowhere
_METRES = 8  # word of an off-road text that says how far, split at single spaces


@dataclass(frozen=True)
class Scores:
    """Percent of the route, penalty factor, and the driving score made of both."""

    route: float
    penalty: float
    composed: float

    def to_json(self) -> dict[str, float]:
        return {"score_composed": self.composed, "score_penalty": self.penalty, "score_route": self.route}


@dataclass(frozen=True)
class RouteRecord:
    """What is kept of one drive: the leaderboard's record, and what its texts would have to be read for.

    Attributes:
        index: Place in the run: route number times repetitions, plus the repetition.
        route_id: "RouteScenario_0", in 2.x "RouteScenario_0_rep0".
        status: "Completed", "Failed - Agent got blocked", …
        scores: Of this drive.
        infractions: Texts by kind, every kind present.
        route_length: As the rules measure it [m].
        duration_game: Simulated time [s].
        duration_system: Wall-clock time [s].
        metres_outside: Route metres driven outside the lanes [m].
        read_back: Whether it was read from a file (resumed, merged): 1.0 then takes it for failed, see `summarise`.
    """

    index: int
    route_id: str
    status: str
    scores: Scores
    infractions: Mapping[str, tuple[str, ...]]
    route_length: float
    duration_game: float = 0.0
    duration_system: float = 0.0
    metres_outside: float = 0.0
    read_back: bool = field(default=False, compare=False)

    @property
    def reached(self) -> bool:
        """Whether the target was reached."""
        return self.status in ("Completed", "Perfect")

    @property
    def count(self) -> int:
        """Infractions of all kinds, those that end a route included."""
        return sum(map(len, self.infractions.values()))


@dataclass(frozen=True)
class Summary:
    """What a whole run comes to.

    Attributes:
        status: "Completed" (2.x also "Perfect") or "Failed".
        mean: Scores over all planned drives; a missing one counts 0.
        deviation: Standard deviations over the drives there are; None where 1.0 has none (a single drive).
        rates: Infractions per km by kind, as the rules define them.
        total_length, duration_game, duration_system: Sums over the drives [m], [s], [s].
        exceptions: Route id, index and status of each drive that failed.
    """

    status: str
    mean: Scores
    deviation: Scores | None
    rates: Mapping[str, float]
    total_length: float
    duration_game: float
    duration_system: float
    exceptions: tuple[tuple[str, int, str], ...] = field(default=())


def penalty(infractions: Sequence[Infraction], rules: Rules) -> float:
    """The penalty factor of a drive: 1 without infractions; below 0 only if more than 100 % was driven outside.

    Kinds that `rules` does not know cost nothing.
    """
    charges = charges_of(rules)
    factor, coefficients, share = 1.0, 0.0, 1.0
    for infraction in in_order(infractions, rules):
        charge = charges[infraction.key]
        value = infraction.value if infraction.value is not None else 0.0
        if charge.by == "share":
            share *= 1.0 - value / 100.0
            factor *= 1.0 - value / 100.0
            continue
        cost = rules.pick(charge.cost)
        if cost is None:
            continue
        part = 1.0 - value / 100.0 if charge.by == "shortfall" else 1.0
        factor *= 1.0 - (1.0 - cost) * part if charge.by == "shortfall" else cost
        coefficients += cost * part
    return share / (1.0 + coefficients) if rules.penalties == "reciprocal" else factor


def scores(completion: float, infractions: Sequence[Infraction], rules: Rules) -> Scores:
    """Scores of a drive that completed `completion` percent of its route."""
    factor = penalty(infractions, rules)
    composed = max(completion * factor, 0.0)
    if rules.rounds:
        return Scores(round(completion, 6), round(factor, 6), round(composed, 6))
    return Scores(completion, factor, composed)


def status(reached: bool, infractions: Sequence[Infraction], failure: str | None, rules: Rules) -> str:
    """The status text of a drive.

    Args:
        reached: Whether the target was reached; then no reason counts, not even a timeout in the same tick.
        infractions: All of the drive.
        failure: A reason from outside the criteria ("Agent crashed"). The last reason known is kept: this one first,
            then the route's timeout, then the criteria in their order, so blocked overrides all.
        rules: Decide whether a clean drive is called Perfect, and whether `failure` comes before all.
    """
    charges = charges_of(rules)
    known = in_order(infractions, rules)
    if reached:
        return "Perfect" if rules.perfect and not known else "Completed"
    reasons = [failure, *(charges[i.key].reason for i in known)]
    if rules.failure_first and failure:
        reasons = [failure]
    last = next((reason for reason in reversed(reasons) if reason), None)
    return f"Failed - {last}" if last else "Failed"


def texts(infractions: Sequence[Infraction], rules: Rules) -> dict[str, tuple[str, ...]]:
    """The infractions' texts by kind, with every kind of `rules`."""
    known = in_order(infractions, rules)
    return {key: tuple(i.message for i in known if i.key == key) for key in charges_of(rules)}


def record_of(
    *,
    index: int,
    route_id: str,
    completion: float,
    reached: bool,
    infractions: Sequence[Infraction],
    failure: str | None,
    route_length: float,
    duration_game: float,
    duration_system: float,
    rules: Rules,
) -> RouteRecord:
    """The record of one drive; rounded as `rules` say."""

    def shown(value: float) -> float:
        return round(value, 3) if rules.rounds else value

    return RouteRecord(
        index=index,
        route_id=route_id,
        status=status(reached, infractions, failure, rules),
        scores=scores(completion, infractions, rules),
        infractions=texts(infractions, rules),
        route_length=shown(route_length),
        duration_game=shown(duration_game),
        duration_system=shown(duration_system),
        metres_outside=sum(i.metres or 0.0 for i in infractions if i.key == OUTSIDE),
    )


def metres_of_text(text: str) -> float:
    """The metres that an off-road text tells [m]: its ninth word, rounded to 3 digits.

    Raises:
        ValueError, IndexError: there is no number.
    """
    return float(text.split(" ")[_METRES])


def summarise(records: Sequence[RouteRecord], total: int, rules: Rules, strict: bool = False) -> Summary:
    """The summary of `records` out of `total` planned drives.

    Args:
        records: Of the drives there are.
        total: Planned drives.
        rules: What they are judged by.
        strict: Whether the originals' bookkeeping defects are kept. 1.0 compares statuses by identity, so each record
            that was read back from a file counts as failed; 2.x takes metres off the road from their text.
    """
    mean = Scores(*(_mean([_parts(r.scores)[k] for r in records], total, rules) for k in range(3)))
    by_identity = strict and rules.version == "1.0"
    failed = [r for r in records if not r.reached or (by_identity and r.read_back)]
    return Summary(
        status=_worst(records, failed, rules),
        mean=mean,
        deviation=_deviation(records, mean, total, rules),
        rates=_rates(records, rules, strict),
        total_length=_total([r.route_length for r in records], rules),
        duration_game=_total([r.duration_game for r in records], rules),
        duration_system=_total([r.duration_system for r in records], rules),
        exceptions=tuple((r.route_id, r.index, r.status) for r in failed),
    )


def _parts(of: Scores) -> tuple[float, float, float]:
    return of.route, of.penalty, of.composed


def _mean(values: Sequence[float], total: int, rules: Rules) -> float:
    mean = sum(values) / total if total else 0.0
    return round(mean, 6) if rules.rounds else mean


def _total(values: Sequence[float], rules: Rules) -> float:
    return round(sum(values), 3) if rules.rounds else sum(values)


def _deviation(records: Sequence[RouteRecord], mean: Scores, total: int, rules: Rules) -> Scores | None:
    if total <= 1:
        return Scores(0.0, 0.0, 0.0) if rules.rounds else None
    missing = total - len(records) if rules.missing_deviate else 0
    squares = [
        (sum((_parts(r.scores)[k] - _parts(mean)[k]) ** 2 for r in records) + missing * _parts(mean)[k] ** 2)
        / (total - 1)
        for k in range(3)
    ]
    return Scores(*(round(math.sqrt(s), 3) if rules.rounds else math.sqrt(s) for s in squares))


def _worst(records: Sequence[RouteRecord], failed: Sequence[RouteRecord], rules: Rules) -> str:
    if failed:
        return "Failed"
    return "Perfect" if rules.perfect and all(r.status == "Perfect" for r in records) else "Completed"


def _kilometres(record: RouteRecord) -> float:
    return record.scores.route / 100.0 * record.route_length / 1000.0


def _rates(records: Sequence[RouteRecord], rules: Rules, strict: bool) -> dict[str, float]:
    """1.0: the SUM of the routes' own rates, routes without progress left out. 2.x: one rate of the whole run, with
    the off-road entry in kilometres driven outside, not divided by anything."""
    keys = list(charges_of(rules))
    if rules.rates == "sum of routes":
        driven = [r for r in records if r.scores.route > 0.0]
        return {key: sum((len(r.infractions.get(key, ())) / _kilometres(r) for r in driven), 0.0) for key in keys}
    whole = plain_rates(records, max(sum(map(_kilometres, records)), SHORTEST), rules)
    if rules.rates == "plain":
        return whole
    rates = {key: round(rate, 3) for key, rate in whole.items()}
    rates[OUTSIDE] = round(sum(_metres_outside(r, strict) for r in records) / 1000.0, 3)
    return rates


def _metres_outside(record: RouteRecord, strict: bool) -> float:
    texts = record.infractions.get(OUTSIDE, ())
    return metres_of_text(texts[0]) if strict and texts else record.metres_outside


def plain_rates(records: Sequence[RouteRecord], kilometres: float, rules: Rules) -> dict[str, float]:
    """Infractions per km by kind, plainly: all of a kind over all `kilometres`, which are positive."""
    return {key: sum(len(r.infractions.get(key, ())) for r in records) / kilometres for key in charges_of(rules)}
