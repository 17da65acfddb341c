"""The cross-entropy method: draw, keep the worst for the agent, draw around them.

Source: Rubinstein & Kroese 2004, "The Cross-Entropy Method", section 5.1 (normal sampling with smoothing); for rare
failures of driving agents e.g. O'Kelly et al. 2018, "Scalable end-to-end autonomous vehicle testing via rare-event
simulation". Here a part of each generation stays uniform, so that a second kind of failure is found too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.random import Draws

Floats = NDArray[np.float64]

POPULATION = 8  # candidates of a generation
ELITE = 4  # of all so far
EXPLORING = 4  # every fourth candidate is drawn from everywhere
SMOOTHING = 0.7  # share of the elite's mean and deviation in the next ones
LEAST_DEVIATION = 0.05  # of the unit cube


@dataclass(frozen=True)
class Belief:
    """Where failures are looked for: a normal law in the unit cube.

    Attributes:
        mean: (D,).
        deviation: (D,).
        is_uniform: Whether nothing is known yet.
    """

    mean: Floats
    deviation: Floats
    is_uniform: bool = False

    @staticmethod
    def at_first(dimensions: int) -> Belief:
        """Nothing is known."""
        return Belief(np.full(dimensions, 0.5), np.full(dimensions, 0.5), is_uniform=True)

    def updated(self, points: Floats, margins: Sequence[float]) -> Belief:
        """What the elite of all candidates so far teaches.

        Args:
            points: (N, D) all candidates.
            margins: (N,) what is to be small; of equal ones the earlier counts.
        """
        if not len(points):
            return self
        elite = points[np.argsort(np.asarray(margins), kind="stable")[:ELITE]]
        mean = SMOOTHING * elite.mean(axis=0) + (1.0 - SMOOTHING) * self.mean
        deviation = SMOOTHING * elite.std(axis=0) + (1.0 - SMOOTHING) * self.deviation
        return Belief(mean, np.maximum(deviation, LEAST_DEVIATION))

    def draw(self, draws: Draws, number: int, attempt: int) -> Floats:
        """Candidate `number` (D,); `attempt` counts those that could not stand on the route."""
        stream = draws.stream("candidate", number, attempt)
        count = len(self.mean)
        if self.is_uniform or number % EXPLORING == EXPLORING - 1:
            return stream.uniform(0, count)
        return folded(stream.normal(0, count) * self.deviation + self.mean)


def folded(values: Floats) -> Floats:
    """`values` mirrored at 0 and 1 into the unit cube."""
    turned = np.mod(values, 2.0)
    return np.where(turned > 1.0, 2.0 - turned, turned)


def generation_of(number: int) -> int:
    """The generation of a candidate."""
    return number // POPULATION


def belief_before(generation: int, points: Floats, margins: Sequence[float]) -> Belief:
    """What is believed when `generation` is drawn, from all candidates of those before it.

    Args:
        generation: Its number.
        points: (N, D) candidates by number; N is `generation * POPULATION` or more.
        margins: (N,) of them.
    """
    belief = Belief.at_first(points.shape[1])
    for number in range(1, generation + 1):
        known = number * POPULATION
        belief = belief.updated(points[:known], margins[:known])
    return belief
