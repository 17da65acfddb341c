"""The drive under way: ticks, what is asked of it between them, and its whole past.

One thread runs it. Wishes wait in a queue and are met between two ticks, so a drive is a function of its header (which
names hazards that were added, and when) and of the ego's controls: its log drives again to the same bytes.
"""

from __future__ import annotations

import logging
import queue
import tempfile
import threading
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lavsim.agent import AgentFailure
from lavsim.drawings import Drawing
from lavsim.errors import LavsimError, LogError, OutputError
from lavsim.live.commands import Command
from lavsim.live.drivers import Driver, KeyboardDriver
from lavsim.live.hazards import kinds, next_place
from lavsim.live.history import Event, History
from lavsim.live.wheel import Keys
from lavsim.log.reader import LogReader
from lavsim.log.replay import resume
from lavsim.map.route import RouteTracker
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import DT
from lavsim.viewer.inner import PERIOD
from lavsim.world.snapshot import Snapshot

MOST_TICKS = 36_000  # half an hour: its past is about 250 MB
_LATE = 0.25  # [s] behind real time after which no more is made up for
_TRACKED = 5  # route points ahead that may become the nearest one, as in the simulation
_LOG = logging.getLogger(__name__)

Reply = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class View:
    """What pages show now; a new one is made for each change.

    Attributes:
        epoch: Goes up when the past becomes another one: after a restart or a fork.
        history: The drive's past; its lists only grow.
        snapshot: The tick that is shown.
        drawings: What the driver showed, and at which tick.
        status: How the drive stands, in JSON types.
        events: How many events there were so far.
    """

    epoch: int
    history: History
    snapshot: Snapshot
    drawings: tuple[int, dict[str, Drawing]]
    status: dict[str, Any]
    events: int


class Session:
    """A live drive; paused at first.

    Args:
        spec: What is driven.
        driver: Who drives.
        folder: Where saved logs go, under names made here.

    Attributes:
        simulation: The world as it stands; only the session's own thread may touch it.
        history: All ticks so far.
        view: What is to be shown; read from any thread.
        on_change: Called in the session's thread after each change of `view`.

    Raises:
        LavsimError: the route can't be driven.
        AgentFailure: the agent can't be set up.
    """

    def __init__(self, spec: DriveSpec, driver: Driver, folder: Path) -> None:
        self.driver, self._folder = driver, folder
        self.on_change: Callable[[], None] = lambda: None
        self._wishes: queue.SimpleQueue[tuple[Command, Reply] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._is_closing = False
        self._is_paused, self._speed, self._steps = True, 1.0, 0
        self._epoch, self._note, self._shown = 0, "", -1
        self._drawings: tuple[int, dict[str, Drawing]] = (0, {})
        self._begin(Simulation(spec), History())
        self._publish()

    # ---- from any thread

    def ask(self, command: Command, reply: Reply = lambda _: None) -> None:
        """Has `command` done before the next tick; `reply` is called in the session's thread if there is an answer."""
        self._wishes.put((command, reply))

    def start(self) -> None:
        """Runs the drive in a thread of its own until `close`."""
        self._thread = threading.Thread(target=self._run, name="live drive", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends the thread and the driver; may be called twice."""
        self._is_closing = True
        self._wishes.put(None)
        if self._thread is not None:
            self._thread.join()
        self.driver.close()

    def hazards_ahead(self) -> list[dict[str, Any]]:
        """Type, metres ahead and point of each hazard that can be set before the ego now."""
        view, simulation = self.view, self.simulation
        metres, found = view.status["metres"], []
        for kind in kinds():
            place = next_place(
                simulation.town, simulation.route, metres, view.snapshot.ego.forward_speed, kind, f"{kind}_live"
            )
            if place is not None:
                ahead = float(simulation.route.distance[place.index]) - metres
                found.append({"type": kind, "ahead": round(ahead)})
        return found

    # ---- in the session's thread

    def obey(self, command: Command, reply: Reply = lambda _: None) -> None:
        """Does what is asked; a mistake is answered, never raised."""
        try:
            getattr(self, f"_do_{command.name}")(command.values, reply)
        except (LavsimError, AgentFailure) as error:
            reply({"error": str(error)})
        except OSError as error:
            reply({"error": f"can't write: {error.strerror}"})
        self._publish()

    def advance(self, ticks: int = 1) -> None:
        """Drives on from the newest tick."""
        for _ in range(ticks):
            self._tick()
            self._publish()

    def _run(self) -> None:
        try:
            self._loop()
        except Exception as error:  # pages stay open and say so
            _LOG.exception("the live drive ended")
            self._note, self._is_paused = f"The simulation failed: {error}", True
            self._publish()

    def _loop(self) -> None:
        due = clock.monotonic()
        while not self._is_closing:
            if self._is_paused and not self._steps:
                self._await(None)
                due = clock.monotonic()
                continue
            if self._steps or not self._speed:
                self._steps = max(self._steps - 1, 0)
                due = clock.monotonic()
            else:
                due = max(due + DT / self._speed, clock.monotonic() - _LATE)
            self.advance()
            self._await(due)

    def _await(self, due: float | None) -> None:
        """Obeys until the moment `due` [s]; without one until something has been asked."""
        while not self._is_closing:
            wait = None if due is None else due - clock.monotonic()
            try:
                asked = self._wishes.get(timeout=wait) if wait is None or wait > 0.0 else self._wishes.get_nowait()
            except queue.Empty:
                return
            if asked is not None:
                self.obey(*asked)
            if due is None:
                return

    def _tick(self) -> None:
        if self._note:
            self._is_paused, self._steps = True, 0
            return
        self._shown = -1
        try:
            control = self.driver.control(self.simulation)
        except AgentFailure as failure:
            self._note = f"The agent failed: {failure.message}. Go on from an earlier tick, or restart."
            return
        drawings = self.driver.drawings()
        if drawings and (self._is_paused or self.simulation.snapshot.tick - self._drawings[0] >= PERIOD):
            self._drawings = (self.simulation.snapshot.tick, drawings)
        self._take(self.simulation.tick(control))

    def _take(self, snapshot: Snapshot) -> None:
        self.history.add(snapshot, self.simulation.hazard_types)
        self._tracker.update(snapshot.ego.xy)
        if len(self.history) >= MOST_TICKS:
            self._note = "Half an hour is all that a live drive keeps: save it, or restart."

    def _begin(self, simulation: Simulation, history: History) -> None:
        """Goes on with `simulation`, whose past is `history`, or just begins."""
        self.simulation, self.history = simulation, history
        self._tracker = RouteTracker(simulation.route, _TRACKED)
        for snapshot in history.snapshots:
            self._tracker.update(snapshot.ego.xy)
        self._epoch += 1
        self._note, self._shown, self._drawings = "", -1, (0, {})
        if not len(history):
            self._take(simulation.snapshot)
        self.driver.start(simulation)

    def _publish(self) -> None:
        index = self._shown if self._shown >= 0 else len(self.history) - 1
        reverse = isinstance(self.driver, KeyboardDriver) and self.driver.wheel.wants_reverse
        self.view = View(
            epoch=self._epoch,
            history=self.history,
            snapshot=self.history.snapshots[index],
            drawings=self._drawings if self._shown < 0 else (0, {}),
            status={
                "paused": self._is_paused,
                "speed": self._speed,
                "first": self.history.snapshots[0].tick,
                "last": self.history.snapshots[-1].tick,
                "seed": self.simulation.spec.seed,
                "reverse": reverse,
                "metres": self._tracker.metres(),
                "length": round(self.simulation.route.length, 1),
                "note": self._note,
            },
            events=len(self.history.events),
        )
        self.on_change()

    # ---- wishes

    def _do_drive(self, values: Mapping[str, Any], reply: Reply) -> None:
        self._keyboard().wheel.keys = Keys(**values)

    def _do_reverse(self, _: Mapping[str, Any], reply: Reply) -> None:
        wheel = self._keyboard().wheel
        wheel.wants_reverse = not wheel.wants_reverse

    def _keyboard(self) -> KeyboardDriver:
        if not isinstance(self.driver, KeyboardDriver):
            raise OutputError("an agent drives; start with --keyboard to drive yourself")
        return self.driver

    def _do_pause(self, values: Mapping[str, Any], reply: Reply) -> None:
        self._is_paused = values["on"]
        if not self._is_paused:
            self._shown = -1

    def _do_step(self, values: Mapping[str, Any], reply: Reply) -> None:
        self._is_paused, self._steps = True, values["ticks"]

    def _do_speed(self, values: Mapping[str, Any], reply: Reply) -> None:
        self._speed = values["value"]

    def _do_look(self, values: Mapping[str, Any], reply: Reply) -> None:
        index = self.history.index_of(values["tick"])
        self._is_paused, self._steps = True, 0
        self._shown = index if index < len(self.history) - 1 else -1

    def _do_hazard(self, values: Mapping[str, Any], reply: Reply) -> None:
        kind = values["type"]
        if kind not in kinds():
            raise LogError(f"no hazard {kind!r} can be set under way")
        simulation = self.simulation
        name = f"{kind}_{len(simulation.hazard_types) + 1}"
        speed, metres = simulation.snapshot.ego.forward_speed, self._tracker.metres()
        place = next_place(simulation.town, simulation.route, metres, speed, kind, name)
        if place is None:
            raise LogError(f"there is no room for {kind} in the next 150 m")
        simulation.add_hazard(place.spec)
        ahead = round(float(simulation.route.distance[place.index]) - metres)
        x, y = place.spec.trigger[:2]
        tick = simulation.snapshot.tick
        self.history.events.append(Event(tick, "set", f"{kind} set {ahead} m ahead", x, y))
        reply({"told": f"{kind}: {ahead} m ahead"})

    def _do_save(self, _: Mapping[str, Any], reply: Reply) -> None:
        path = self._free_name()
        ending = self._note or "saved while under way"
        self.history.write(path, self._header(self.history.last), self.driver.sensors(), ending)
        reply({"saved": path.name})

    def _free_name(self) -> Path:
        """A name in the folder that nothing has yet."""
        spec = self.simulation.spec
        plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in spec.route_id)[:40]
        for number in range(1, 10_000):
            path = self._folder / f"live_{plain}_seed{spec.seed}_{number:03d}.lavlog"
            if not path.exists():
                return path
        raise OutputError("the folder is full of saved drives")

    def _header(self, tick: int) -> dict[str, Any]:
        """The log's header of the drive up to `tick`."""
        header = self.simulation.header()
        met = [hazard for hazard in header["scenarios"] if hazard.get("tick", -1) < tick]
        return {**header, "scenarios": met}

    def _do_fork(self, values: Mapping[str, Any], reply: Reply) -> None:
        tick = values["tick"]
        past = self.history.until(self.history.index_of(tick))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "past.lavlog"
            past.write(path, self._header(tick), [], "forked")
            simulation = resume(LogReader(path), tick, self.simulation.spec.town_path)
        self._is_paused, self._steps = True, 0
        self._begin(simulation, past)
        reply({"told": f"on from {tick * DT:.2f} s"})

    def _do_restart(self, values: Mapping[str, Any], reply: Reply) -> None:
        simulation = Simulation(replace(self.simulation.spec, seed=values["seed"], later=()))
        self._is_paused, self._steps = True, 0
        self._begin(simulation, History())
        reply({"told": f"seed {values['seed']}"})
