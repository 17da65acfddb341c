"""Which rules hold: one row for each version of the leaderboard, and what a version says about a value.

A criterion keeps its own numbers in its own file, keyed by version or generation; `Rules.pick` reads them. So this
table says only what belongs to no criterion: how penalties combine, how rates and roundings are made, what an agent
is given.

Source: `carla-simulator/leaderboard`, branches `leaderboard-1.0`, `leaderboard-2.0`, `leaderboard-2.1`, and
`Thinklab-SJTU/Bench2Drive`. The branch `master` carries the score of 2.0, not of 2.1.

`corrected` is ours: 1.0 with its mistakes mended, as we see them. `docs/scoring.md` lists each; the criteria
that differ lie in `leaderboard/criteria/corrected_*.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal, TypeVar

from lavsim.errors import UnknownName

T = TypeVar("T")

_SENSORS_1: Mapping[str, int] = MappingProxyType(
    {
        "sensor.camera.rgb": 4,
        "sensor.lidar.ray_cast": 1,
        "sensor.other.radar": 2,
        "sensor.other.gnss": 1,
        "sensor.other.imu": 1,
        "sensor.speedometer": 1,
        "sensor.opendrive_map": 1,
    }
)
_SENSORS_2: Mapping[str, int] = MappingProxyType(
    {**_SENSORS_1, "sensor.camera.rgb": 8, "sensor.lidar.ray_cast": 2, "sensor.other.radar": 4}
)


@dataclass(frozen=True)
class Rules:
    """One version of the leaderboard's rules.

    Attributes:
        version: Its name, as users give it.
        lineage: Keys under which values of this version are found, the most specific first; the last is the generation.
        penalties: How events combine: a product of factors, or the reciprocal of one plus their coefficients.
        rounds: Whether scores are rounded to 6 digits, lengths, times and rates to 3 (the 2.x generation).
        rates: Infractions per km: the sum of each route's own rate; one rate of the whole run, but kilometres for
            off-road; or plainly count by distance for all kinds.
        route_length: Length of a route in the record: of the line through its waypoints, or of the dense route.
        perfect: Whether a route without any entry is called Perfect.
        missing_deviate: Whether drives that are missing count as 0 in standard deviations, as they do in means.
        failure_first: Whether the agent's own failure stands in the status, whatever criteria ended the drive with.
        blames_agent: Whether a status that only names the agent ("Agent got blocked") is an error of the agent.
        repetition_in_id: Whether a record's route id names the repetition.
        plan_spacing: Distance after which the agent's thinned plan keeps a point [m].
        plan_keeps_first: Whether the first point is kept by a rule of its own.
        sensor_limits: How many sensors of each type an agent may have.
        qualifier_limits: The same on the qualifier tracks.
        mount_radius: Farthest mount from the ego's origin [m].
    """

    version: str
    lineage: tuple[str, ...]
    penalties: Literal["product", "reciprocal"]
    rounds: bool
    rates: Literal["sum of routes", "whole run", "plain"]
    route_length: Literal["waypoints", "dense"]
    perfect: bool
    repetition_in_id: bool
    plan_spacing: float
    plan_keeps_first: bool
    sensor_limits: Mapping[str, int] = field(repr=False)
    qualifier_limits: Mapping[str, int] = field(repr=False)
    mount_radius: float = 3.0
    missing_deviate: bool = False
    failure_first: bool = False
    blames_agent: bool = True

    @property
    def generation(self) -> str:
        """ "1.0" or "2.x": which shape of agent, route and record holds."""
        return self.lineage[-1]

    def __reduce__(self) -> tuple[Callable[[str], Rules], tuple[str]]:
        """Crosses to another process by its name."""
        return get_rules, (self.version,)

    def pick(self, values: Mapping[str, T]) -> T | None:
        """What `values` (keyed by version or generation) says for this version; None where it says nothing."""
        for key in self.lineage:
            if key in values:
                return values[key]
        return None

    def require(self, values: Mapping[str, T]) -> T:
        """`pick` for values that every version has.

        Raises:
            KeyError: `values` has no entry for this version: a mistake in a criterion.
        """
        for key in self.lineage:
            if key in values:
                return values[key]
        raise KeyError(f"nothing for rules {self.version} in {dict(values)}")


_V1 = Rules(
    version="1.0",
    lineage=("1.0",),
    penalties="product",
    rounds=False,
    rates="sum of routes",
    route_length="waypoints",
    perfect=False,
    repetition_in_id=False,
    plan_spacing=50.0,
    plan_keeps_first=True,
    sensor_limits=_SENSORS_1,
    qualifier_limits=_SENSORS_1,
)


def _generation_2(
    version: str, lineage: tuple[str, ...], penalties: Literal["product", "reciprocal"] = "product"
) -> Rules:
    return Rules(
        version=version,
        lineage=lineage,
        penalties=penalties,
        rounds=True,
        rates="whole run",
        route_length="dense",
        perfect=True,
        repetition_in_id=True,
        plan_spacing=200.0,
        plan_keeps_first=True,
        sensor_limits=_SENSORS_2,
        qualifier_limits=_SENSORS_1,
    )


RULES: Mapping[str, Rules] = MappingProxyType(
    {
        rules.version: rules
        for rules in (
            _V1,
            _generation_2("2.0", ("2.0", "2.x")),
            _generation_2("2.1", ("2.1", "2.x"), "reciprocal"),
            _generation_2("bench2drive", ("bench2drive", "2.0", "2.x")),
            replace(
                _V1,
                version="corrected",
                lineage=("corrected", "1.0"),
                rates="plain",
                route_length="dense",
                missing_deviate=True,
                failure_first=True,
                blames_agent=False,
            ),
        )
    }
)


def get_rules(version: str) -> Rules:
    """The rules of `version`.

    Raises:
        UnknownName: there is no such version; the message lists those there are.
    """
    try:
        return RULES[version]
    except KeyError:
        raise UnknownName("rules", version, RULES) from None
