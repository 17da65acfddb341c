"""How the expert drives, as numbers; CARLA's three sets of its behaviour agent by name."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import NamedTuple

from pydantic import Field

from lavsim.config import Config


class Pace(NamedTuple):
    """The part of a manner that kernels use; fields as in `Manner`."""

    acceleration: float
    comfort_braking: float
    headway: float
    standstill: float


class Manner(Config):
    """How the expert drives."""

    limit_share: float = Field(default=0.88, gt=0.0, description="part of the speed limit it drives at")
    limit_gap: float = Field(default=0.0, ge=0.0, description="speed it then stays below that [m/s]")
    top_speed: float = Field(default=45.0 / 3.6, gt=0.0, description="never faster [m/s]")
    lateral: float = Field(default=2.2, gt=0.0, description="largest lateral acceleration in bends [m/s²]")
    comfort_braking: float = Field(default=2.0, gt=0.0, description="deceleration of foreseeable braking [m/s²]")
    acceleration: float = Field(default=2.0, gt=0.0, description="largest acceleration [m/s²]")
    headway: float = Field(default=1.3, gt=0.0, description="time gap to a leader [s]")
    standstill: float = Field(default=2.5, gt=0.0, description="gap to a standing leader [m]")

    @cached_property
    def pace(self) -> Pace:
        """What kernels take."""
        return Pace(self.acceleration, self.comfort_braking, self.headway, self.standstill)

    def changed(self, **values: float) -> Manner:
        """Another manner with some fields changed; a copy would keep the pace that is known of this one."""
        return Manner(**{**self.model_dump(), **values})


# Top speeds and distances to the limit are CARLA's (reference `carla.md` 5.2); its braking distances of 6, 5 and 4 m,
# measured from the ego's centre less the larger half length, leave these gaps between bumpers. The rest it does not
# set: its following is by time to collision.
MANNERS: Mapping[str, Manner] = {
    "expert": Manner(),
    "cautious": Manner(
        limit_share=1.0, limit_gap=6.0 / 3.6, top_speed=40.0 / 3.6, lateral=1.8, comfort_braking=1.6,
        acceleration=1.6, headway=1.8, standstill=3.6,
    ),
    "normal": Manner(
        limit_share=1.0, limit_gap=3.0 / 3.6, top_speed=50.0 / 3.6, lateral=2.2, comfort_braking=2.0,
        acceleration=2.0, headway=1.3, standstill=2.6,
    ),
    "aggressive": Manner(
        limit_share=1.0, limit_gap=1.0 / 3.6, top_speed=70.0 / 3.6, lateral=3.0, comfort_braking=2.8,
        acceleration=2.8, headway=0.9, standstill=1.8,
    ),
}  # fmt: skip
