"""CARLA's `RoadOption` under the path published agents import it from."""

from lavsim.types import RoadOption

__all__ = ["RoadOption"]
