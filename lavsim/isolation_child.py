"""The agent's side of `lavsim.isolation`: `python -m lavsim.isolation_child SOCKET SHARED`."""

from __future__ import annotations

import contextlib
import mmap
import os
import socket
import sys
import traceback
from dataclasses import asdict
from typing import Any

from lavsim import carla_standin, route_standin, srunner_standin
from lavsim.agent import AgentFailure, AgentPlan, AgentSpec, AgentStatus
from lavsim.agent_runner import AgentRunner
from lavsim.isolation_guard import stand_guard
from lavsim.messages import Channel


def main(arguments: list[str]) -> int:
    """Answers orders until the parent says `close` or is gone."""
    stand_guard()
    stream = socket.socket(fileno=int(arguments[0]))
    shared = mmap.mmap(int(arguments[1]), 0)
    os.close(int(arguments[1]))
    os.set_inheritable(stream.fileno(), False)
    channel = Channel(stream, shared)
    runner: AgentRunner | None = None
    while True:
        try:
            message = channel.receive()
        except EOFError:
            return 0
        try:
            if message["order"] == "start":
                runner, reply = _start(message)
            elif message["order"] == "step":
                assert runner is not None
                readings = {key: (frame, data) for key, (frame, data) in message["readings"].items()}
                srunner_standin.tell_time(message["time"])
                reply = asdict(runner.step(readings, message["time"]))
                if runner.spec.drawings:
                    reply["drawings"] = runner.drawings()
            else:
                if runner is not None:
                    runner.close()
                reply = {}
        except AgentFailure as failure:
            _print_cause(failure)
            reply = {"failure": [int(failure.status), failure.message]}
        _flush()
        with contextlib.suppress(BrokenPipeError):
            try:
                channel.send(reply)
            except TypeError as error:  # only the sensors can hold what JSON can't
                text = f"sensors() returned what is no plain data: {error}"
                channel.send({"failure": [int(AgentStatus.SENSORS_INVALID), text]})
        if message["order"] == "close":
            return 0


def _start(message: dict[str, Any]) -> tuple[AgentRunner, dict[str, Any]]:
    sys.path[:] = message["path"]
    if os.getcwd() not in sys.path and "" not in sys.path:
        sys.path.append(os.getcwd())  # "module:Class" of the user's own folder
    carla_standin.install()
    srunner_standin.install()
    runner = AgentRunner(AgentSpec.from_json(message["spec"]))
    plan = AgentPlan(**message["plan"])
    route_standin.tell_plan(plan)
    runner.start(plan, message["spacing"])
    return runner, {"track": runner.track.value, "sensors": runner.sensors}


def _print_cause(failure: AgentFailure) -> None:
    if failure.__cause__ is not None:
        traceback.print_exception(failure.__cause__)
    else:
        print(f"{failure.status.name}: {failure.message}", file=sys.stderr)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):  # agents replace and close these
            stream.flush()


if __name__ == "__main__":
    code = main(sys.argv[1:])
    _flush()
    os._exit(code)  # threads and exit handlers of foreign code don't get to hold the route up
