"""A hazard with drawn values, where they can stand on its route; a route file of such variations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lavsim.errors import ConfigError, ScenarioError
from lavsim.random import Draws
from leaderboard.routes import RouteEntry
from leaderboard.search.cross_entropy import Belief
from leaderboard.search.ground import Ground
from leaderboard.search.ranges import Range, values_at

ATTEMPTS = 50  # draws until one can stand on the route


@dataclass(frozen=True)
class Variation:
    """A hazard with drawn values.

    Attributes:
        number: Names its route.
        attempts: Draws before it that could not stand on the route.
        point: In the unit cube.
        values: That it stands for.
        entry: The route with them.
    """

    number: int
    attempts: int
    point: tuple[float, ...]
    values: dict[str, float | str]
    entry: RouteEntry


def draw_variation(ground: Ground, ranges: Sequence[Range], belief: Belief, draws: Draws, number: int) -> Variation:
    """Variation `number`: the first of its draws that can stand on the route.

    Raises:
        ScenarioError: none of `ATTEMPTS` draws can.
    """
    reason: str | None = None
    for attempt in range(ATTEMPTS):
        point = tuple(belief.draw(draws, number, attempt).tolist())
        values = values_at(ranges, point)
        entry = ground.with_values(values, str(number))
        reason = ground.refusal(entry)
        if reason is None:
            return Variation(number, attempt, point, values, entry)
    told = ", ".join(map(str, ranges))
    raise ScenarioError(f"no values of {told} can stand on {ground.entry.source}: {reason}")


def variations(ground: Ground, ranges: Sequence[Range], count: int, seed: int) -> Iterator[Variation]:
    """`count` variations drawn evenly from `ranges`; a larger count begins with those of a smaller one.

    Raises:
        ConfigError: `count` is not positive.
        ScenarioError: no values can stand on the route.
    """
    if count < 1:
        raise ConfigError(f"count must be at least 1, got {count}.")
    belief, draws = Belief.at_first(len(ranges)), Draws.of_seed(seed).stream("variations")
    return (draw_variation(ground, ranges, belief, draws, number) for number in range(count))
