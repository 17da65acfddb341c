"""Who holds the wheel in a live drive: a person at the keys, or an agent in a process of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from lavsim.agent import AgentSpec, plan_of
from lavsim.drawings import Drawing
from lavsim.isolation import ChildAgent
from lavsim.live.wheel import Wheel
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import Simulation
from lavsim.types import Control


class Driver(Protocol):
    """Gives the control of each tick."""

    name: str

    def start(self, simulation: Simulation) -> None:
        """Takes the wheel at the simulation's newest tick; also after a fork or a restart."""

    def control(self, simulation: Simulation) -> Control:
        """The control for the next tick; may raise `AgentFailure`."""

    def drawings(self) -> dict[str, Drawing]:
        """What it shows of its inner view after its last step."""

    def sensors(self) -> list[dict[str, Any]]:
        """The sensors it reads, for the log."""

    def close(self) -> None:
        """Leaves nothing running."""


class KeyboardDriver:
    """A person; `wheel` gets what is pressed."""

    name = "keyboard"

    def __init__(self) -> None:
        self.wheel = Wheel()

    def start(self, simulation: Simulation) -> None:
        throttle, steer, brake, _, reverse = (float(value) for value in simulation.snapshot.control)
        keys, self.wheel = self.wheel.keys, Wheel()
        self.wheel.keys, self.wheel.wants_reverse = keys, bool(reverse)
        self.wheel.control = Control(throttle, steer, brake, reverse=bool(reverse))

    def control(self, simulation: Simulation) -> Control:
        return self.wheel.turn(simulation.snapshot.ego.forward_speed)

    def drawings(self) -> dict[str, Drawing]:
        return {}

    def sensors(self) -> list[dict[str, Any]]:
        return []

    def close(self) -> None:
        pass


class AgentDriver:
    """An agent; a new one for each start, with the plan of the whole route and no memory of what was before.

    Args:
        spec: Which agent; its drawings are asked for.
        output: File for what it prints.
        environment: Variables of its process.
    """

    def __init__(self, spec: AgentSpec, output: Path | None = None, environment: dict[str, str] | None = None) -> None:
        self.name = spec.target
        self._make = lambda: ChildAgent(spec, output, environment)
        self._agent = self._make()
        self._suite: SensorSuite | None = None

    def start(self, simulation: Simulation) -> None:
        self._agent.close()
        self._agent = self._make()
        self._agent.start(plan_of(simulation.route, simulation.town))
        self._suite = SensorSuite(get_scene(simulation.town), self._agent.sensors(), simulation.draws)

    def control(self, simulation: Simulation) -> Control:
        assert self._suite is not None, "it was started"
        readings = self._suite.read(simulation.recent(self._suite.history + 1))
        return self._agent.step(readings, simulation.snapshot.time)

    def drawings(self) -> dict[str, Drawing]:
        return self._agent.drawings()

    def sensors(self) -> list[dict[str, Any]]:
        return self._agent.sensors()

    def close(self) -> None:
        self._agent.close()
