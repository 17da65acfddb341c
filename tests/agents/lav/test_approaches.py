"""Egos put before lights and stop signs: where they stand, what the lights show, and what the brake network is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.data.approaches import BEFORE, approaches_of, posed, relit
from agents.lav.data.signals import GREEN, NONE, OPEN, RED, lights_of, signs_of
from agents.lav.data.staged import StagedFrames, write_episode
from lavsim.dataset.reader import Dataset
from lavsim.dataset.schema import DatasetInfo, RecordConfig
from lavsim.errors import ConfigError, DatasetError
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.types import LightState
from lavsim.world.snapshot import Snapshot
from tests.dataset.made import info_of
from tests.dataset.recorded import SUITE, drive, record
from tests.snapshots import EGO, Body, snapshot_of
from tests.worlds import crossing, straight

NAMES = ("rgb_2", "tel_rgb")


def before(town: TownMap, *others: Body) -> Snapshot:
    """A moment of a town with the ego far from any light."""
    return snapshot_of((EGO, *others), lights=[LightState.RED] * len(town.lights))


@pytest.mark.parametrize("town", [crossing(), load_town("us_highway")], ids=["crossing", "us_highway"])
def test_ways_lead_to_their_lines(town: TownMap) -> None:
    lights, signs = approaches_of(town)
    assert sorted(way.light for way in lights) == sorted(k for k, x in enumerate(town.lights) for _ in x.stop_lines)
    lines = [line for light in town.lights for line in light.stop_lines]
    for way, line in zip(lights, lines, strict=True):
        at = [float(np.interp(0.0, way.along, column)) for column in way.path.T]
        assert np.hypot(at[0] - line.x, at[1] - line.y) < 0.3
        assert np.all(np.diff(way.along) > 0.0)
        assert way.along[0] < -10.0
        ahead = np.diff(way.path[:, :2], axis=0)
        turned = np.arctan2(ahead[:, 1], ahead[:, 0]) - way.path[1:, 3]
        assert np.abs(np.sin(turned)).max() < 0.2, "headings go along it"
    assert bool(signs) == any(sign.kind == "stop" for sign in town.signs)


def test_the_front_stands_where_it_is_told_and_the_light_shows_what_is_told() -> None:
    town = crossing()
    ways = approaches_of(town)
    moment, states = before(town), set()
    for number in range(200):
        found = posed(moment, town, ways, Draws(number))
        snapshot, ego = found.snapshot, found.snapshot.ego
        green = {k for k, state in enumerate(snapshot.lights) if state != LightState.RED}
        group = town.light_groups[0].phases
        assert sum(bool(green & set(phase)) for phase in group) <= 1, "one phase at a time"
        if np.isnan(found.light_distance):
            assert found.state == LightState.UNKNOWN
            continue
        front = ego.xy + 0.5 * ego.length * np.array([np.cos(ego.yaw), np.sin(ego.yaw)])
        off = [
            np.hypot(*(front - (line.x, line.y)))
            for k, light in enumerate(town.lights)
            for line in light.stop_lines
            if snapshot.lights[k] == found.state and np.cos(ego.yaw - line.yaw) > 0.9
        ]
        assert min(off) == pytest.approx(found.light_distance, abs=1.2)
        assert 0.0 < found.light_distance < BEFORE
        states.add(found.state)
    assert states == {LightState.RED, LightState.YELLOW, LightState.GREEN}


def test_a_pose_is_the_draws_alone_and_nobody_stands_in_it() -> None:
    town = crossing()
    ways = approaches_of(town)
    first = posed(before(town), town, ways, Draws(5)).snapshot
    where = Body(id=7, x=first.ego.x + 1.0, y=first.ego.y)
    aside = Body(id=8, x=first.ego.x + 30.0, y=first.ego.y + 30.0)
    again = posed(before(town, where, aside), town, ways, Draws(5)).snapshot
    assert again.pose[0].tolist() == first.pose[0].tolist()
    assert again.ids.tolist() == [EGO.id, 8]


def test_a_town_without_lights_stays_as_it_is() -> None:
    town = straight()
    moment = before(town)
    found = posed(moment, town, approaches_of(town), Draws(1))
    assert found.snapshot is moment
    assert (found.state, np.isnan(found.light_distance)) == (LightState.UNKNOWN, True)


@pytest.mark.parametrize("state", [LightState.RED, LightState.YELLOW, LightState.GREEN])
@pytest.mark.parametrize("choice", [0.0, 0.7, 0.9])
def test_lights_that_take_turns_go_together(state: LightState, choice: float) -> None:
    town = crossing()
    lights = np.full(len(town.lights), LightState.GREEN, np.uint8)
    phases = town.light_groups[0].phases
    light = phases[0][0]
    found = relit(lights, town, light, state, choice)
    assert all(found[k] == state for k in phases[0])
    others = {int(found[k]) for phase in phases[1:] for k in phase}
    assert others <= {LightState.RED, LightState.GREEN}
    assert (LightState.GREEN in others) == (state == LightState.RED and choice < 0.75)


def test_what_is_asked_of_lights_and_signs_by_distance() -> None:
    metres = np.array([np.nan, -5.0, -1.0, 0.5, 24.0, 30.0, 45.0, 70.0])
    red, green = (np.full(8, state) for state in (LightState.RED, LightState.GREEN))
    assert lights_of(red, metres).tolist() == [NONE, NONE, OPEN, RED, RED, RED, OPEN, NONE]
    assert lights_of(green, metres)[3:6].tolist() == [GREEN] * 3
    assert lights_of(np.full(8, LightState.OFF), metres)[3:6].tolist() == [NONE] * 3
    assert signs_of(metres).tolist() == [0, 0, OPEN, 1, 1, OPEN, 0, 0]


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Two short recorded drives."""
    root = tmp_path_factory.mktemp("drives")
    info = DatasetInfo.of(RecordConfig(SUITE), seed=3)
    info.write(root)
    for number in range(2):
        record(root, number, info, drive(number), ticks=22)
    return Dataset(root)


def test_frames_are_written_once_and_read_back(drives: Dataset, tmp_path: Path) -> None:
    for number in range(2):
        write_episode(tmp_path, drives, number, 3 + number, NAMES)
    files = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    write_episode(tmp_path, drives, 0, 3, NAMES)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == files
    staged = StagedFrames(tmp_path, drives)
    assert len(staged) == 7
    assert staged.told.episode.tolist() == [0] * 3 + [1] * 4
    read = staged.read(5, NAMES)
    assert {name: image.shape for name, image in read.items()} == {"rgb_2": (288, 256, 3), "tel_rgb": (288, 480, 3)}
    assert not np.array_equal(read["rgb_2"], staged.read(6, NAMES)["rgb_2"])
    (tmp_path / "ep_000000.json").unlink()
    write_episode(tmp_path, drives, 0, 3, NAMES)
    again = StagedFrames(tmp_path, drives)
    assert np.array_equal(again.told.light_distance, staged.told.light_distance, equal_nan=True)


def test_what_is_missing_gets_one_line(drives: Dataset, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="holds no approaches"):
        StagedFrames(tmp_path, drives)
    info_of().write(tmp_path)
    made = Dataset(tmp_path)
    made.episodes[0] = drives.episodes[0].__class__(**{**vars(drives.episodes[0]), "files": {}})
    with pytest.raises(ConfigError, match="has no log of episode 0"):
        write_episode(tmp_path, made, 0, 1, NAMES)
