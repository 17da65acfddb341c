"""Totals, the card and the charts of a dataset."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from lavsim.dataset.card import card_text, write_card
from lavsim.dataset.charts import write_charts
from lavsim.dataset.files import write_sealed
from lavsim.dataset.info import summarise
from lavsim.dataset.plan import CollectPlan
from lavsim.dataset.reader import Dataset
from tests.dataset.made import info_of, write_dataset


def test_totals(tmp_path: Path) -> None:
    write_dataset(tmp_path, (4, 3, 5))
    found = summarise(Dataset(tmp_path)).to_json()
    assert (found["episodes"], found["frames"], found["km"]) == (3, 12, 0.024)
    assert found["towns"] == {
        "eu_small_a": {"episodes": 2, "frames": 9, "km": 0.018},
        "us_large_a": {"episodes": 1, "frames": 3, "km": 0.006},
    }
    assert found["weathers"] == {"lav": 12}
    assert found["endings"] == {"route completed": 3}
    on_disk = sum(p.stat().st_size for kind in ("logs", "tables", "blobs") for p in (tmp_path / kind).iterdir())
    assert found["bytes"] == sum(found["bytes_by_kind"].values()) == on_disk
    assert found["statistics"]["frames"] == 12
    json.dumps(found, allow_nan=False)


def test_a_dataset_of_logs_alone_has_totals_and_no_statistics(tmp_path: Path) -> None:
    from dataclasses import replace

    info = info_of()
    only_logs = replace(info, record=replace(info.record, tables=False, blobs=False), fields=info.blobs)
    only_logs.write(tmp_path)
    found = summarise(Dataset(tmp_path)).to_json()
    assert (found["frames"], found["statistics"], found["has_tables"]) == (0, None, False)
    assert "# Driving" in card_text(Dataset(tmp_path))


def test_the_card_depends_on_the_content_alone(tmp_path: Path) -> None:
    write_dataset(tmp_path / "a", (4, 3))
    shutil.copytree(tmp_path / "a", tmp_path / "elsewhere")
    for name in ("a", "elsewhere"):
        write_card(tmp_path / name)
    text = (tmp_path / "a" / "README.md").read_text()
    assert text == (tmp_path / "elsewhere" / "README.md").read_text()
    assert str(tmp_path) not in text
    front = text.split("---")[1]
    for line in ("license: mit", "size_categories:\n- n<1K", "data_files: tables/*.parquet"):
        assert line in front
    for field in info_of().fields:
        assert f"| `{field.name}` |" in text
    assert "| us_large_a | 1 | 3 | 0.0 |" in text


def test_the_card_tells_the_command(tmp_path: Path) -> None:
    write_dataset(tmp_path, (4, 3))
    plan = CollectPlan(towns=("eu_small_a", "us_large_a"), frames=7, seed=5, log_only=True)
    write_sealed(tmp_path / "meta/plan.json", {"plan_schema": 1, "plan": plan.to_json(), "town_digests": {}})
    text = card_text(Dataset(tmp_path))
    assert "\nlavsim collect " in text
    for option in ("--towns eu_small_a,us_large_a", "--frames 7", "--seed 5", "--log-only"):
        assert option in text


@pytest.mark.slow
def test_charts_are_a_picture_and_the_same_each_time(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    write_dataset(tmp_path / "d", (12,))
    statistics = summarise(Dataset(tmp_path / "d")).statistics
    assert statistics is not None
    for name in ("a.png", "b.png"):
        write_charts(statistics, "made by hand", tmp_path / name)
    data = (tmp_path / "a.png").read_bytes()
    assert data.startswith(b"\x89PNG")
    assert data == (tmp_path / "b.png").read_bytes()
