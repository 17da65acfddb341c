"""What a hazard is: frozen parameters, a place, and a script whose every `yield` gives the tick back to the world."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import ConfigError, ScenarioError, UnknownName
from lavsim.random import Draws
from lavsim.registry import Registry
from lavsim.scenarios.hands import EgoHand, FlagsHand, LightsHand, TrafficHand
from lavsim.scenarios.parameters import parse_parameters
from lavsim.scenarios.user_files import read_folders
from lavsim.types import DT, ActorIds, Role
from lavsim.world.blueprints import find_blueprint
from lavsim.world.world import Actor, World

if TYPE_CHECKING:
    from lavsim.map.route import Route
    from lavsim.map.town_map import TownMap
    from lavsim.map.waypoint import Waypoint
    from lavsim.scenarios.place import Site

__all__ = ["GENERATIONS", "SCENARIOS", "Actor", "Scenario", "ScenarioSpec", "Script", "Stage", "make_scenario"]

Script = Generator[None, None, None]
GENERATIONS = ("1.0", "2.x")


@dataclass(frozen=True)
class ScenarioSpec:
    """A hazard as a route file names it.

    Attributes:
        name: Unique within its route ("DynamicObjectCrossing_1").
        type: Key in the registry together with the generation.
        generation: "1.0" or "2.x"; some names differ between them.
        trigger: x, y, z [m] and yaw [rad] where the ego sets it off.
        parameters: As read from the file: numbers, texts, intervals, places.
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
        site: Where on the route the hazard is set off.
        instance: Number of the hazard in its route; sets the ids of its actors.
        progress: Reads how far the ego is along the route [m].
        draws: The hazard's own stream.
        lights: Its hand on traffic lights.
        flags: What snapshots show beside the hazard.
        traffic: Its hand on background vehicles.
        ego: What it adds to the ego's control.
        rules: Rule set of the drive.
    """

    world: World
    site: Site
    instance: int
    progress: Callable[[], float]
    draws: Draws
    lights: LightsHand
    flags: FlagsHand
    traffic: TrafficHand
    ego: EgoHand
    rules: str

    @property
    def town(self) -> TownMap:
        return self.site.town

    @property
    def route(self) -> Route:
        return self.site.route

    @property
    def anchor(self) -> Waypoint:
        """Lane centre at the trigger."""
        return self.site.anchor

    @property
    def index(self) -> int:
        """Point of the route at the trigger."""
        return self.site.index

    @property
    def time(self) -> float:
        """Simulation time [s]."""
        return self.world.tick * DT

    def disturb(self, throttle: float, steer: float) -> None:
        """Adds to the ego's throttle and steer in this tick."""
        self.ego.add(throttle, steer)

    def release(self) -> None:
        """Lets go of everything that is not an actor."""
        self.lights.release()
        self.traffic.release()
        self.flags.release()


class Scenario(ABC):
    """One hazard of a route.

    Attributes:
        Config: Frozen dataclass of its parameters.
        appears_at_trigger: Whether `place` is called when the ego sets it off instead of when it comes near.
        starts_route: Whether it has to be set off where the route starts.
        acts: Whether it scripts anything; types that only mark a piece of road don't.
    """

    Config: ClassVar[type[Any]]
    appears_at_trigger: ClassVar[bool] = False
    starts_route: ClassVar[bool] = False
    acts: ClassVar[bool] = True

    def __init__(self, config: Any) -> None:
        self.config = config
        self._actors: list[Actor] = []
        self.withdrawn = 0  # actors of attempts to place it that failed; their ids are gone

    @abstractmethod
    def fits(self, site: Site) -> str | None:
        """Why it can't stand at `site`; None when it can. Asked when the route loads."""

    def suits(self, site: Site) -> str | None:
        """Why a new route file should not put it at `site`; asks more than `fits` where old files ask too little."""
        return self.fits(site)

    @classmethod
    def suggest(cls, site: Site) -> Mapping[str, Any] | None:
        """Parameters, as a route file gives them, with which it stands well at `site`; None where it can't.

        By default none at all; types whose parameters have no defaults find some.
        """
        return {} if cls(cls.Config()).suits(site) is None else None

    @abstractmethod
    def place(self, stage: Stage) -> None:
        """Spawns its actors."""

    @abstractmethod
    def script(self, stage: Stage) -> Script:
        """Runs from the trigger on; every `yield` gives the tick back, returning ends the hazard."""

    @property
    def actors(self) -> tuple[Actor, ...]:
        """All that it has spawned, those that are gone included."""
        return tuple(self._actors)

    def spawn(self, stage: Stage, blueprint: str, position: NDArray[np.float64], yaw: float, role: Role) -> Actor:
        """Adds an actor with the next id of this hazard's range; `position` is (3,) x, y, z [m].

        Raises:
            ScenarioError: another actor stands there.
        """
        actor_id = ActorIds.of_scenario(stage.instance) + self.withdrawn + len(self._actors)
        kind = find_blueprint(blueprint)
        actor = stage.world.spawn(actor_id, kind, position, yaw, role, kind.colour(stage.draws, actor_id))
        self._actors.append(actor)
        return actor

    def clear(self) -> None:
        """Removes all its actors."""
        for actor in self._actors:
            actor.remove()

    def withdraw(self) -> None:
        """Removes and forgets the actors of an attempt to place it; the next attempt's are its first."""
        self.clear()
        self.withdrawn += len(self._actors)
        self._actors.clear()


SCENARIOS: Registry[type[Scenario]] = Registry("scenario", package="lavsim.scenarios", also=read_folders)


def make_scenario(spec: ScenarioSpec) -> Scenario:
    """The hazard that `spec` names, with its parameters checked.

    Raises:
        UnknownName: no hazard of that type in that generation.
        ScenarioError: an unknown or ill-typed parameter.
    """
    try:
        kind = SCENARIOS[spec.generation, spec.type]
    except UnknownName as error:
        error.args = (f"{spec.name} ({spec.type}): {error}",)
        raise
    try:
        return kind(kind.Config(**parse_parameters(kind.Config, spec.parameters)))
    except (ConfigError, ScenarioError) as error:
        raise ScenarioError(f"{spec.name} ({spec.type}): {error}") from None
