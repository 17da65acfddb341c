"""The past of a live drive: its ticks, what happened in them, and how it becomes a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np

from lavsim.episode import EpisodeResult
from lavsim.errors import LogError
from lavsim.log.writer import LogWriter
from lavsim.simulation import Simulation
from lavsim.types import ActorClass, ActorIds
from lavsim.viewer.tracks import CONTACT_GAP
from lavsim.world.snapshot import LENGTH_UNIT, Snapshot


@dataclass(frozen=True)
class Event:
    """Something worth a mark.

    Attributes:
        tick: When.
        kind: "contact", "hazard" (one begins) or "set" (somebody set one).
        text: In a few words.
        x, y: Where [m].
    """

    tick: int
    kind: str
    text: str
    x: float
    y: float


@dataclass
class History:
    """All ticks of a drive so far.

    Attributes:
        snapshots: One a tick.
        events: In order.
    """

    snapshots: list[Snapshot] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    _touched: dict[int, int] = field(default_factory=dict)  # newest tick in touch by actor

    def __len__(self) -> int:
        return len(self.snapshots)

    @property
    def last(self) -> int:
        """Number of the newest tick."""
        return self.snapshots[-1].tick

    def index_of(self, tick: int) -> int:
        """Place of tick number `tick`.

        Raises:
            LogError: the drive has no such tick.
        """
        first, last = self.snapshots[0].tick, self.last
        if not first <= tick <= last:
            raise LogError(f"the drive holds ticks {first} to {last}, not {tick}")
        return tick - first

    def add(self, snapshot: Snapshot, hazards: Sequence[str]) -> None:
        """Takes in the next tick; `hazards` are the types of the drive's hazards by number."""
        self._note_hazards(snapshot, hazards)
        self._note_contacts(snapshot)
        self.snapshots.append(snapshot)

    def until(self, index: int) -> History:
        """The past up to the tick at `index`, that one included."""
        kept = self.snapshots[: index + 1]
        last = kept[-1].tick
        events = [event for event in self.events if event.tick < last or (event.tick == last and event.kind != "set")]
        return History(kept, events, {actor: min(tick, last) for actor, tick in self._touched.items()})

    def write(self, path: Path, header: Mapping[str, Any], sensors: list[dict[str, Any]], ending: str) -> None:
        """Writes the drive as a log."""
        writer = LogWriter(path, {"suite": sensors})
        writer.start(cast(Simulation, _Told(header)))
        for snapshot in self.snapshots:
            writer.observe(snapshot)
        writer.finish(EpisodeResult(len(self), ending))

    def _note_hazards(self, snapshot: Snapshot, hazards: Sequence[str]) -> None:
        before = set(self.snapshots[-1].hazards["index"].tolist()) if self.snapshots else set()
        for number in snapshot.hazards["index"].tolist():
            if number not in before:
                self.events.append(Event(snapshot.tick, "hazard", hazards[number], snapshot.ego.x, snapshot.ego.y))

    def _note_contacts(self, snapshot: Snapshot) -> None:
        for contact in snapshot.contacts:
            pair = (int(contact["a"]), int(contact["b"]))
            if int(ActorIds.EGO) not in pair:
                continue
            other = pair[1] if pair[0] == int(ActorIds.EGO) else pair[0]
            if snapshot.tick - self._touched.get(other, -CONTACT_GAP) >= CONTACT_GAP:
                text = f"contact with {_name(snapshot, other)}, {float(contact['impulse']):.0f} N s"
                x, y = (float(contact[axis] * LENGTH_UNIT) for axis in "xy")
                self.events.append(Event(snapshot.tick, "contact", text, x, y))
            self._touched[other] = snapshot.tick


@dataclass(frozen=True)
class _Told:
    """What a log writer asks of a simulation: its header."""

    told: Mapping[str, Any]

    def header(self) -> Mapping[str, Any]:
        return self.told


def _name(snapshot: Snapshot, actor: int) -> str:
    """What an actor is called in a text."""
    if actor == ActorIds.STATIC:
        return "the static world"
    rows = np.flatnonzero(snapshot.table.ids == actor)
    return f"{ActorClass(int(snapshot.table.classes[rows[0]])).name.lower()} {actor}"
