"""Debris on the road makes the ego's wheel and pedals tremble."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.park import debris
from lavsim.scenarios.moves.roadside import lane_ahead, must_be_ahead
from lavsim.scenarios.place import Site

_PLACES = (14.0, 48.0, 74.0)  # [m] of the debris after the trigger
_RANGE = 2.0  # [m] of the ego from debris that disturbs it
_THROTTLE = (0.03, 0.01)  # mean and standard deviation
_STEER = (0.055, 0.015)
_END = 110.0  # [m] that the ego drives


@dataclass(frozen=True)
class ControlLossConfig:
    """Nothing to choose."""


@SCENARIOS.register(("2.x", "ControlLoss"))
class ControlLoss(Scenario):
    """NHTSA pre-crash type: control loss without prior vehicle action.

    Debris lies on the lane at 14, 48 and 74 m. While the ego is within 2 m of a piece its control is disturbed anew in
    every tick: throttle by a Gaussian number of mean +-0.03 and deviation 0.01, steer by one of +-0.055 and 0.015; the
    two signs are drawn for each piece. It is over when the ego has driven 110 m. Debris is driven over, nothing
    collides.

    Parameters: none.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = ControlLossConfig

    def fits(self, site: Site) -> str | None:
        if lane_ahead(site, _PLACES[-1]) is None:
            return f"the road ends within {_PLACES[-1]:g} m of the trigger"
        return None

    def place(self, stage: Stage) -> None:
        debris(self, stage, [must_be_ahead(stage.site, distance) for distance in _PLACES])

    def script(self, stage: Stage) -> Script:
        yield from wait.beside(wait.driven(stage.world.ego, _END), self._disturb(stage))

    def _disturb(self, stage: Stage) -> Script:
        signs = np.where(stage.draws.stream("sign").uniform(0, 2 * len(_PLACES)) < 0.5, -1.0, 1.0).reshape(-1, 2)
        noise = stage.draws.stream("noise")
        while True:
            for k, piece in enumerate(self.actors):
                if wait.gap_to(stage.world.ego, piece.xy) < _RANGE:
                    throttle, steer = noise.normal(stage.world.tick, 2)
                    stage.disturb(
                        signs[k, 0] * _THROTTLE[0] + _THROTTLE[1] * throttle,
                        signs[k, 1] * _STEER[0] + _STEER[1] * steer,
                    )
            yield
