"""Debris on the road; under the corrected rules the ego's wheel and pedals drift after it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lavsim.scenarios import place
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import park, wait
from lavsim.scenarios.place import Site

_PLACES = (12.0, 46.0, 72.0)  # [m] of the debris after the trigger
_RANGE = 2.0  # [m] of the ego from a piece that changes the disturbance
_ABORT = 10.0  # [m] before a junction
_END = 30.0  # [m] that the ego drives after the last change
_MEAN_STEER, _MEAN_THROTTLE = 0.001, 0.045


@dataclass(frozen=True)
class ControlLossConfig:
    """What the original fixes.

    Attributes:
        noise: Standard deviation of what is drawn at each piece of debris.
        other_actors: Places of the scenario file; 1.0 does not use them here.
    """

    noise: float = 0.01
    other_actors: Mapping[str, Any] = field(default_factory=dict)


@SCENARIOS.register(("1.0", "Scenario1"))
class ControlLoss(Scenario):
    """NHTSA pre-crash type: control loss without prior vehicle action.

    Debris lies on the lane 12, 46 and 72 m after the trigger, no farther than the next junction. Where the ego comes
    within 2 m of a piece, x = |N(0, `noise`)| is drawn and from then on min(0, 0.001 - x) is added to its steer and
    min(x + 0.045, 1) to its throttle, until it is 10 m before a junction. It is over when the ego has driven 30 m
    after the last piece, or after that abort.

    The leaderboard 1.0 prepares this disturbance and never applies it: only the debris is there, and so it is here
    under the rules 1.0. Under the rules "corrected" it is applied. Debris lies flat: nothing collides with it.

    Source: leaderboard 1.0 (reference `leaderboard.md` 6.1).
    """

    Config = ControlLossConfig
    appears_at_trigger = True

    def fits(self, site: Site) -> str | None:
        return None

    def suits(self, site: Site) -> str | None:
        free = place.to_junction(site.anchor)
        if free < _PLACES[-1] + _END + _ABORT:
            return f"a junction lies {free:.0f} m after it"
        return "the route changes lanes or ends" if site.changes_lane(_PLACES[-1] + _END) else None

    def place(self, stage: Stage) -> None:
        park.debris(self, stage, [place.along_lane(stage.anchor, distance)[0] for distance in _PLACES])

    def script(self, stage: Stage) -> Script:
        is_applied = stage.rules == "corrected"
        near_junction = wait.until(lambda: stage.site.to_junction - (stage.progress() - stage.site.at) < _ABORT)
        yield from wait.first_of(near_junction, self._lose_control(stage, is_applied))
        yield from wait.driven(stage.world.ego, _END)

    def _lose_control(self, stage: Stage, is_applied: bool) -> Script:
        throttle = steer = 0.0
        for number, debris in enumerate(self.actors):
            while wait.gap_to(stage.world.ego, debris.xy) >= _RANGE:
                if is_applied:
                    stage.disturb(throttle, steer)
                yield
            drawn = float(np.abs(stage.draws.stream("noise").normal(number, 1, 0.0, self.config.noise)[0]))
            throttle, steer = min(drawn + _MEAN_THROTTLE, 1.0), min(0.0, _MEAN_STEER - drawn)
        for _ in wait.driven(stage.world.ego, _END):
            if is_applied:
                stage.disturb(throttle, steer)
            yield
