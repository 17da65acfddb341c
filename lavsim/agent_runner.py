"""Runs an agent's code: construction by its rules' generation, its steps, and what it raised as a failure.

`AgentRunner` is what both handles share; `InProcessAgent` is the handle for agents of our own in this very process.
"""

from __future__ import annotations

import copy
import inspect
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from lavsim.agent import Agent, AgentFailure, AgentPlan, AgentSpec, AgentStatus, Readings, Track, parse_control
from lavsim.agent_source import load_agent_class
from lavsim.drawings import Drawing, checked_all
from lavsim.errors import AgentError
from lavsim.types import Control

_IMMUTABLE = (bool, int, float, str, bytes, type(None))


class AgentRunner:
    """One agent through one route, in the process that runs its code: what both handles share."""

    def __init__(self, spec: AgentSpec, agent_class: type[Any] | None = None) -> None:
        self.spec = spec
        self._class = agent_class
        self._agent: Any = None
        self._told = False
        self.track = Track.SENSORS
        self.sensors: list[dict[str, Any]] = []

    def start(self, plan: AgentPlan, spacing: float) -> None:
        """Loads, constructs, plans and sets up in the order of the spec's generation.

        Raises:
            AgentFailure: SETUP_FAILED, or SENSORS_INVALID for sensors that are no list of dictionaries.
        """
        try:
            agent_class = self._class or load_agent_class(self.spec.target)
            agent, waits_for_setup = _construct(agent_class, self.spec)
            self._agent = agent
            if hasattr(agent, "set_global_plan"):
                if isinstance(agent, Agent):
                    agent.plan_spacing = spacing
                agent.set_global_plan(plan.gps, plan.world)
            if waits_for_setup:
                agent.setup(self.spec.config_path)
            self.track = _track_of(getattr(agent, "track", Track.SENSORS))
            sensors = agent.sensors()
        except BaseException as error:
            raise _failure(AgentStatus.SETUP_FAILED, "set-up", error) from error
        if not isinstance(sensors, list | tuple) or not all(isinstance(s, Mapping) for s in sensors):
            raise AgentFailure(AgentStatus.SENSORS_INVALID, "sensors() returned no list of dictionaries")
        self.sensors = [dict(sensor) for sensor in sensors]

    def step(self, readings: dict[str, tuple[int, Any]], time: float) -> Control:
        agent = self._agent
        try:
            if isinstance(agent, Agent):
                agent.sensor_interface.feed(readings, time)
                control = agent()
            else:
                control = agent.run_step(readings, time)
        except BaseException as error:
            raise _failure(AgentStatus.CRASHED, "run_step", error) from error
        return parse_control(control)

    def drawings(self) -> dict[str, Drawing]:
        """What the agent shows after its step; nothing, and a word in its output, if that is no drawing."""
        if not self.spec.drawings or not hasattr(self._agent, "drawings"):
            return {}
        try:
            return checked_all(self._agent.drawings())
        except Exception as error:  # a picture that fails must not end a drive
            if not self._told:
                print(f"drawings() failed, nothing is shown: {type(error).__name__}: {error}", file=sys.stderr)
            self._told = True
            return {}

    def labels(self) -> Mapping[str, Any]:
        """What the agent says of its driving, of the last step; nothing if it has no `labels()`."""
        labels: Mapping[str, Any] = self._agent.labels() if hasattr(self._agent, "labels") else {}
        return labels

    def close(self) -> None:
        """Calls `destroy` of an agent that was constructed.

        Raises:
            AgentFailure: `destroy` raised.
        """
        agent, self._agent = self._agent, None
        if agent is not None and hasattr(agent, "destroy"):
            try:
                agent.destroy()
            except BaseException as error:
                raise _failure(AgentStatus.CRASHED, "destroy", error) from error


class InProcessAgent:
    """An agent of our own in this very process: for collection and tests. Foreign code goes into a `ChildAgent`."""

    def __init__(self, spec: AgentSpec | type[Any], config_path: str | None = None) -> None:
        if isinstance(spec, AgentSpec):
            self._runner = AgentRunner(spec)
        else:
            target = f"{spec.__module__}:{spec.__qualname__}"
            self._runner = AgentRunner(AgentSpec(target, config_path=config_path), spec)

    @property
    def track(self) -> Track:
        return self._runner.track

    def start(self, plan: AgentPlan, spacing: float | None = None) -> None:
        self._runner.start(plan, self._runner.spec.plan_spacing if spacing is None else spacing)

    def sensors(self) -> list[dict[str, Any]]:
        return copy.deepcopy(self._runner.sensors)

    def step(self, readings: Readings, time: float) -> Control:
        return self._runner.step({name: (frame, _copied(data)) for name, (frame, data) in readings.items()}, time)

    def drawings(self) -> dict[str, Drawing]:
        """What the agent shows after its last step."""
        return self._runner.drawings()

    def labels(self) -> Mapping[str, Any]:
        """What the agent says of its driving, of its last step: its `labels()`, for recorders."""
        return self._runner.labels()

    def close(self) -> None:
        self._runner.close()


def _copied(data: Any) -> Any:
    if isinstance(data, np.ndarray):
        return data.copy()
    if type(data) is dict:  # `deepcopy` of a dictionary of arrays takes five times as long
        return {key: _copied(value) for key, value in data.items()}
    return data if isinstance(data, _IMMUTABLE) else copy.deepcopy(data)


def _construct(agent_class: type[Any], spec: AgentSpec) -> tuple[Any, bool]:
    """A new agent, and whether `setup` is still to be called, after the plan.

    The rules' generation decides between the two constructors, unless the class's own fits only one of them.
    """
    accepted = required = 0
    for parameter in inspect.signature(agent_class).parameters.values():
        if parameter.kind is inspect.Parameter.VAR_POSITIONAL:
            accepted = 99
        elif parameter.kind in (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD):
            accepted += 1
            required += parameter.default is inspect.Parameter.empty
    if accepted == 0:
        return agent_class(), hasattr(agent_class, "setup")
    if required >= 2 or (accepted >= 2 and spec.generation == "2.x"):
        return agent_class(*("localhost", 2000, False)[:accepted]), True
    return agent_class(spec.config_path), False


def _track_of(value: Any) -> Track:
    text = getattr(value, "value", value)
    try:
        return Track(text)
    except ValueError:
        raise AgentError(f"track {text!r} is none of {', '.join(t.value for t in Track)}.") from None


def _failure(status: AgentStatus, where: str, error: BaseException) -> AgentFailure:
    if isinstance(error, AgentFailure):
        return error
    if isinstance(error, AgentError):
        return AgentFailure(status, str(error))
    text = str(error)
    return AgentFailure(status, f"{where} raised {type(error).__name__}{f': {text}' if text else ''}")
