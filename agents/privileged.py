"""What agents on privileged state share: the truth around the ego, and the dense plan beside the thinned one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from lavsim.agent import Agent, Track


class PrivilegedAgent(Agent):
    """Is told where everybody is, and drives by the dense plan.

    Class attributes:
        radius: How far around the ego it is told [m].

    Attributes:
        dense_plan: CARLA's dense plan, (transform, option) about a metre apart.
    """

    radius: ClassVar[float] = 100.0
    dense_plan: Sequence[tuple[Any, Any]] = ()  # in 2.x it is given before `setup`

    def setup(self, path_to_conf_file: str | None) -> None:
        self.track = Track.PRIVILEGED

    def sensors(self) -> list[dict[str, Any]]:
        return [{"type": "sensor.lavsim.truth", "id": "truth", "radius": self.radius}]

    def set_global_plan(
        self, global_plan_gps: list[tuple[dict[str, float], Any]], global_plan_world_coord: list[tuple[Any, Any]]
    ) -> None:
        """Keeps the thinned plan as every agent, and the dense one."""
        super().set_global_plan(global_plan_gps, global_plan_world_coord)
        self.dense_plan = global_plan_world_coord
