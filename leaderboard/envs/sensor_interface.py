"""The leaderboard's sensor interface that team code imports."""

from lavsim.agent import SensorInterface

__all__ = ["SensorConfigurationInvalid", "SensorInterface", "SensorReceivedNoData"]


class SensorReceivedNoData(Exception):  # noqa: N818 - CARLA's name
    """Exists so that team code can catch it; here all readings of a tick come with the tick."""


class SensorConfigurationInvalid(Exception):  # noqa: N818 - CARLA's name
    """Exists so that team code can catch it; sensors are checked by the evaluator."""
