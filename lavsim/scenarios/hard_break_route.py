"""Traffic ahead brakes hard."""

from __future__ import annotations

from dataclasses import dataclass

from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.place import Site

_STOP = 10.0  # [s] that traffic stands
_REACH = 60.0  # [m] of route ahead on which traffic stops: two vehicles a lane of the original's rows
_END = 15.0  # [m] that the ego drives afterwards


@dataclass(frozen=True)
class HardBreakRouteConfig:
    """Nothing to choose."""


@SCENARIOS.register(("2.x", "HardBreakRoute"))
class HardBreakRoute(Scenario):
    """NHTSA pre-crash type: lead vehicle decelerating.

    Background vehicles on the 60 m of road ahead of the ego brake to standstill at once and stand for 10 s. It is over
    when the ego has driven 15 m after they were let go. It has no actors of its own: without background traffic nothing
    happens.

    Parameters: none.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = HardBreakRouteConfig

    def fits(self, site: Site) -> str | None:
        return None

    def place(self, stage: Stage) -> None:
        """It acts through background traffic."""

    def script(self, stage: Stage) -> Script:
        stage.traffic.hold(stage.traffic.ahead(_REACH), 0.0)
        yield from wait.seconds(_STOP)
        stage.traffic.release()
        yield from wait.driven(stage.world.ego, _END)
