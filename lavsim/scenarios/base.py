"""What a hazard is: frozen parameters, a place, and a script whose every `yield` gives the tick back to the world."""

from __future__ import annotations

import difflib
import typing
from abc import ABC, abstractmethod
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import ConfigError, ScenarioError
from lavsim.random import Draws
from lavsim.registry import Registry
from lavsim.types import ActorIds, Role
from lavsim.world.blueprints import find_blueprint
from lavsim.world.world import Actor, World

if TYPE_CHECKING:
    from lavsim.map.route import Route
    from lavsim.map.town_map import Waypoint

Script = Generator[None, None, None]


@dataclass(frozen=True)
class ScenarioSpec:
    """A hazard as a route file names it.

    Attributes:
        name: Unique within its route ("DynamicObjectCrossing_1").
        type: Key in the registry together with the generation.
        generation: "1.0" or "2.x"; some names differ between them.
        trigger: x, y, z [m] and yaw [rad] where the ego sets it off.
        parameters: As read from the file: texts, or mappings of texts.
    """

    name: str
    type: str
    generation: str
    trigger: tuple[float, float, float, float]
    parameters: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Stage:
    """What a script acts on.

    Attributes:
        world: The world, for spawning and looking.
        route: The ego's route.
        anchor: Lane centre at the trigger.
        instance: Number of the hazard in its route; sets the ids of its actors.
        progress: Reads how far the ego is along the route [m].
        draws: The hazard's own stream.
    """

    world: World
    route: Route
    anchor: Waypoint
    instance: int
    progress: typing.Callable[[], float]
    draws: Draws


class Scenario(ABC):
    """One hazard of a route.

    Class attributes:
        Config: Frozen dataclass of its parameters.
        trigger_radius: Distance of the ego's route point from the trigger that sets it off [m]; 2.0 in 2.x, 1.5 in 1.0.
    """

    Config: ClassVar[type[Any]]
    trigger_radius: ClassVar[float] = 2.0

    def __init__(self, config: Any) -> None:
        self.config = config
        self._actors: list[Actor] = []

    @abstractmethod
    def fits(self, anchor: Waypoint) -> str | None:
        """Why it can't stand at `anchor`; None when it can. Asked when the route loads."""

    @abstractmethod
    def place(self, stage: Stage) -> None:
        """Spawns its actors."""

    @abstractmethod
    def script(self, stage: Stage) -> Script:
        """Runs from the trigger on; every `yield` gives the tick back, returning ends the hazard."""

    def spawn(self, stage: Stage, blueprint: str, position: NDArray[np.float64], yaw: float, role: Role) -> Actor:
        """Adds an actor with the next id of this hazard's range."""
        actor_id = ActorIds.of_scenario(stage.instance) + len(self._actors)
        kind = find_blueprint(blueprint)
        actor = stage.world.spawn(actor_id, kind, position, yaw, role, kind.colour(stage.draws, actor_id))
        self._actors.append(actor)
        return actor

    def clear(self) -> None:
        """Removes all its actors."""
        for actor in self._actors:
            actor.remove()


SCENARIOS: Registry[type[Scenario]] = Registry("scenario", package="lavsim.scenarios")


def make_scenario(spec: ScenarioSpec) -> Scenario:
    """The hazard that `spec` names, with its parameters checked.

    Raises:
        UnknownName: no hazard of that type in that generation.
        ScenarioError: an unknown or ill-typed parameter.
    """
    kind = SCENARIOS[spec.generation, spec.type]
    try:
        return kind(kind.Config(**_parameters(kind.Config, spec.parameters)))
    except (ConfigError, ScenarioError) as error:
        raise ScenarioError(f"{spec.name} ({spec.type}): {error}") from None


def _parameters(config: type[Any], given: Mapping[str, Any]) -> dict[str, Any]:
    types = typing.get_type_hints(config)
    known = {f.name: types[f.name] for f in fields(config)}
    result = {}
    for name, value in given.items():
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise ScenarioError(f"no parameter {name!r}.{hint} Known: {', '.join(known) or 'none'}.")
        try:
            result[name] = known[name](value)
        except (TypeError, ValueError):
            raise ScenarioError(f"{name} must be a {known[name].__name__}, got {value!r}.") from None
    return result
