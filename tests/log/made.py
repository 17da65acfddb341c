"""Snapshots of random numbers, and logs of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lavsim.log.codec import BLOCK_TICKS
from lavsim.log.writer import LogWriter
from lavsim.types import ActorClass, Role
from lavsim.world.snapshot import CONTACT_DTYPE, HAZARD_DTYPE, ActorTable, Snapshot

ARRAYS = (
    "rows",
    "pose",
    "velocity",
    "state",
    "ego_motion",
    "control",
    "lights",
    "contacts",
    "weather_values",
    "hazards",
)


def table_of(count: int) -> ActorTable:
    return ActorTable.empty().extended(
        [
            {"id": 1 + 7 * k, "class": ActorClass.CAR, "role": Role.TRAFFIC if k else Role.EGO,
             "size": (4.5 + 0.1 * k, 1.9, 1.5), "colour": (k, 2, 3), "blueprint": f"vehicle.{k}"}
            for k in range(count)
        ]
    )  # fmt: skip


def snapshot_at(tick: int, actors: int, rng: np.random.Generator) -> Snapshot:
    rows = np.concatenate([[0], 1 + np.flatnonzero(rng.random(actors - 1) < 0.8)]).astype(np.int32)
    n = len(rows)
    contacts = np.zeros(int(rng.integers(0, 3)), CONTACT_DTYPE)
    contacts["impulse"] = rng.random(len(contacts))
    return Snapshot(
        tick=tick,
        table=table_of(actors),
        rows=rows,
        pose=rng.integers(-(2**31), 2**31 - 1, (n, 5)).astype(np.int32),
        velocity=rng.integers(-4000, 4000, (n, 3)).astype(np.int32),
        state=rng.integers(0, 2000, (n, 3)).astype(np.int32),
        ego_motion=rng.normal(size=6).astype(np.float32),
        control=rng.random(5).astype(np.float32),
        lights=rng.integers(0, 5, 9).astype(np.uint8),
        contacts=contacts,
        weather_values=rng.random(10).astype(np.float32),
        hazards=np.zeros(int(rng.integers(0, 2)), HAZARD_DTYPE),
        agent_status=int(rng.integers(0, 3)),
    )


def assert_same(first: Snapshot, second: Snapshot) -> None:
    assert (first.tick, first.agent_status) == (second.tick, second.agent_status)
    for name in ARRAYS:
        a, b = getattr(first, name), getattr(second, name)
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()), name
    assert first.ids.tolist() == second.ids.tolist()


@dataclass
class FakeSimulation:
    def header(self) -> dict[str, Any]:
        return {"town": "nowhere", "seed": 3}


class FakeResult:
    def summary(self) -> dict[str, Any]:
        return {"ending": "completed"}


def write_log(path: Path, ticks: int = 250, block_ticks: int = BLOCK_TICKS) -> list[Snapshot]:
    """Records `ticks` random snapshots; actors join halfway."""
    rng = np.random.default_rng(1)
    snapshots = [snapshot_at(t, 5 if t < ticks // 2 else 8, rng) for t in range(ticks)]
    writer = LogWriter(path, {"look": "fast"}, block_ticks)
    writer.start(FakeSimulation())  # type: ignore[arg-type]
    for snapshot in snapshots:
        assert writer.observe(snapshot) is None
    writer.finish(FakeResult())  # type: ignore[arg-type]
    return snapshots
