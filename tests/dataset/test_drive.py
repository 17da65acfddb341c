"""One episode: the same in this process and with its agent in another, with noise and without, and told to its end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lavsim.agent import AgentSpec
from lavsim.dataset import drive as driving
from lavsim.dataset.drive import EpisodeTask, Kept, collect_episode
from lavsim.dataset.noise import ControlNoise
from lavsim.dataset.redrive import RenderTask, drives_alike, render_episode
from lavsim.isolation import ChildAgent
from lavsim.log.reader import LogReader
from tests.dataset.collected import short_plan


def log_of(root: Path, **changes: Any) -> Path:
    """The log of episode 1 of a short plan."""
    (root / "logs").mkdir(parents=True, exist_ok=True)
    record = collect_episode(EpisodeTask(short_plan(**changes), 1, root), lambda kept: None)
    return root / next(name for name in record.files if name.startswith("logs"))


class Apart(ChildAgent):
    """The agent in a process of its own, with nothing to say of its driving."""

    def __init__(self, spec: AgentSpec) -> None:
        super().__init__(spec)

    def labels(self) -> dict[str, Any]:
        return {}


def test_an_agent_drives_alike_in_this_process_and_in_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = log_of(tmp_path / "here", episode_frames=24)
    monkeypatch.setattr(driving, "InProcessAgent", Apart)
    there = log_of(tmp_path / "there", episode_frames=24)
    assert here.read_bytes() == there.read_bytes()


def test_noise_steers_the_car_and_the_expert_steers_back(tmp_path: Path) -> None:
    noise = ControlNoise(every=2.0, share=1.0)
    calm = LogReader(log_of(tmp_path / "calm", episode_frames=40))
    shaken = LogReader(log_of(tmp_path / "shaken", episode_frames=40, noise=noise))
    assert shaken.header["noise"] == noise.model_dump()
    assert calm.header["noise"] is None
    assert not np.array_equal(calm.controls()[:, 1], shaken.controls()[:, 1])
    ends = np.array([[reader[-1].ego.x, reader[-1].ego.y] for reader in (calm, shaken)])
    assert np.hypot(*(ends[0] - ends[1])) < 12.0  # not thrown off its way


def test_frames_are_told_while_they_are_kept(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    told: list[Kept] = []
    collect_episode(EpisodeTask(short_plan(episode_frames=45), 0, tmp_path), told.append)
    assert told == [Kept(0, 20), Kept(0, 40)]


def test_rendering_tells_its_frames_too(tmp_path: Path) -> None:
    log = log_of(tmp_path / "source", episode_frames=24)
    driving.info_of(short_plan()).write(tmp_path)
    (tmp_path / "logs").mkdir()
    told: list[Kept] = []
    record = render_episode(RenderTask(log, 5, tmp_path, {"weather": "lav"}), told.append)
    assert told == [Kept(5, 20)]
    assert (record.frames, record.episode, record.facts) == (24, 5, {"weather": "lav"})
    assert (tmp_path / "logs/ep_000005.lavlog").read_bytes() == log.read_bytes()


def test_an_agent_is_held_to_its_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = log_of(tmp_path, episode_frames=24, noise=ControlNoise(share=1.0, every=2.0))
    assert drives_alike(log) is None
    monkeypatch.setattr(ControlNoise, "steer", lambda *_: 0.0)
    assert "drives differently" in str(drives_alike(log))
