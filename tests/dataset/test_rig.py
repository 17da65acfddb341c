"""A dataset keeps the readings of any suite, and counts what its sensors saw of each actor."""

from pathlib import Path

import numpy as np
import pytest

from lavsim.dataset.reader import Dataset
from lavsim.dataset.rig import Rig
from lavsim.dataset.schema import DatasetInfo, RecordConfig
from lavsim.dataset.tables import Table, read_table, write_table
from lavsim.errors import SensorError
from lavsim.random import Draws
from lavsim.render.scene import get_scene
from lavsim.sensors.base import make_sensor
from lavsim.sensors.suites import SUITES
from lavsim.simulation import Simulation
from tests.dataset.recorded import drive, record

OTHERS = (
    {"type": "sensor.other.radar", "id": "radar", "x": 2.0, "z": 1.0},
    {"type": "sensor.lidar.ray_cast", "id": "whole", "z": 2.4, "attributes": {"full_sweep": True}},
    {"type": "sensor.lavsim.bev", "id": "limits", "attributes": {"layers": "road,limit", "width": 40, "height": 30}},
    {"type": "sensor.camera.depth", "id": "depth", "z": 2.0, "width": 20, "height": 10, "fov": 90},
)


@pytest.mark.parametrize("suite", [SUITES["lav"], OTHERS, ()])
def test_any_suite_is_kept(tmp_path: Path, suite: tuple[dict[str, object], ...]) -> None:
    info = DatasetInfo.of(RecordConfig(suite))
    info.write(tmp_path)
    record(tmp_path, 0, info, drive(0), ticks=11)
    data = Dataset(tmp_path)
    assert data.episodes[0].frames == 2
    frame = data.read(0, 1)
    assert "actor_pixels" not in frame
    assert ("actor_lidar_hits" in frame) == (suite == SUITES["lav"])
    for item in data.info.blobs:
        assert np.asarray(frame[item.name]).dtype == item.dtype


def test_a_sensor_that_gives_several_arrays_is_refused() -> None:
    with pytest.raises(SensorError, match=r"'truth' of type .* gives several"):
        Rig([{"type": "sensor.lavsim.truth", "id": "truth"}])


def test_pixels_and_points_are_counted_by_actor() -> None:
    simulation = Simulation(drive(1))
    rig, scene = Rig(SUITES["lav_data"]), get_scene(simulation.town)
    seen = rig.read(simulation.recent(2), scene, simulation.draws)
    snapshot = simulation.snapshot
    assert seen.pixels.shape == (len(snapshot.ids), 6)
    semantic = {name: seen.blobs[name] for name in rig.cameras}
    for column, (name, values) in enumerate(
        (v["id"].lower(), v) for v in SUITES["lav_data"] if v["type"] == "sensor.camera.semantic_segmentation"
    ):
        sensor = make_sensor(values)
        tags, instance = sensor.view.labels(snapshot, scene)  # type: ignore[attr-defined]
        assert np.array_equal(tags, semantic[name])
        assert seen.pixels[:, column].tolist() == [int((instance == actor).sum()) for actor in snapshot.ids]
    # The first tick has no sweep before it: a scan is half a turn then.
    first = rig.read([snapshot], scene, simulation.draws, ["lidar"])
    assert len(first.blobs["lidar"]) == first.lidar_now
    assert list(first.blobs) == ["lidar"]


def test_readings_do_not_depend_on_what_else_is_read() -> None:
    simulation = Simulation(drive(1))
    rig, scene = Rig(SUITES["lav_data"]), get_scene(simulation.town)
    whole = rig.read(simulation.recent(2), scene, Draws(5)).blobs
    for names in (["tel_rgb"], ["bev", "rgb_4"], ["lidar"]):
        some = rig.read(simulation.recent(2), scene, Draws(5), names).blobs
        assert set(some) == set(names)
        assert all(np.array_equal(some[name], whole[name]) for name in names)


def test_a_table_without_rows_comes_back(tmp_path: Path) -> None:
    fields = DatasetInfo.of(RecordConfig(SUITES["lav_data"])).columns
    write_table(tmp_path / "t.parquet", Table.of_rows([], fields), fields, {})
    table = read_table((tmp_path / "t.parquet").read_bytes(), "t.parquet", fields)
    assert len(table) == 0
    assert table.columns["actor_pixels"].values.shape == (0, 6)
