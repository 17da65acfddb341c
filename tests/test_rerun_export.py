"""Drives for Rerun: the frame's turn on paper; the file only where Rerun is installed."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from lavsim.cli import main
from lavsim.log.writer import LogWriter
from lavsim.rerun_export import boxes_of, flipped
from lavsim.simulation import Simulation
from lavsim.types import Control
from tests.drives import straight_drive
from tests.viewer import drives

HAS_RERUN = importlib.util.find_spec("rerun") is not None


def test_boxes_turn_with_the_frame() -> None:
    snapshot = drives.snapshots()[60]
    boxes = boxes_of(snapshot)
    x, y, z, w = boxes["quaternions"].T
    ahead = np.stack([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w)], axis=1)
    assert ahead == pytest.approx(flipped(np.column_stack([np.cos(snapshot.yaw), np.sin(snapshot.yaw), 0 * z]))[:, :2])
    assert boxes["centers"][0] == pytest.approx([snapshot.ego.x, -snapshot.ego.y, snapshot.ego.height / 2.0])
    assert boxes["half_sizes"] * 2.0 == pytest.approx(snapshot.sizes)
    assert boxes["labels"][0] == "car 1"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    simulation = Simulation(straight_drive())
    writer = LogWriter(tmp_path / "a.lavlog")
    writer.start(simulation)
    for _ in range(5):
        writer.observe(simulation.tick(Control(throttle=1.0)))
    writer._flush()
    writer.close()
    return tmp_path / "a.lavlog"


@pytest.mark.skipif(HAS_RERUN, reason="Rerun is installed")
def test_without_rerun_it_says_what_to_install(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", str(log), "--rerun", str(log.with_suffix(".rrd"))]) == 2
    assert "lavsim[rerun]" in capsys.readouterr().err


@pytest.mark.skipif(not HAS_RERUN, reason="Rerun is not installed: its wheel has 170 MB, so it is no part of 'dev'")
def test_recording_is_written(log: Path) -> None:
    path = log.with_suffix(".rrd")
    assert main(["show", str(log), "--rerun", str(path)]) == 0
    assert path.read_bytes().startswith(b"RRF")
    assert path.stat().st_size > 10_000
