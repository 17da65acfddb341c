"""What the page about datasets says holds."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from lavsim.dataset.columns import table_fields
from lavsim.dataset.reader import Dataset
from lavsim.dataset.schema import DatasetInfo

PAGE = Path(__file__).parents[2] / "docs" / "dataset.md"


def snippets() -> list[str]:
    return re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def test_a_dataset_can_be_read_without_this_library(recorded: Path) -> None:
    alone, ours = snippets()
    assert "lavsim" not in alone
    assert len([line for line in alone.splitlines() if line.strip()]) <= 18
    names: dict[str, Any] = {"root": str(recorded)}
    exec(alone, names)
    frame = Dataset(recorded).read(0, 7)
    assert np.array_equal(names["tags"], frame["sem_2"])
    assert np.array_equal(names["bev"], frame["bev"])
    assert np.array_equal(names["lidar"].astype(np.float32), frame["lidar"])
    assert names["row"]["position"] == frame["position"].tolist()
    assert names["row"]["actor_id"] == frame["actor_id"].tolist()
    assert names["blob"]["rgb_2"].startswith(b"\xff\xd8")
    exec(ours, {"root": str(recorded)})


def test_the_page_lists_every_field(recorded: Path) -> None:
    text = PAGE.read_text(encoding="utf-8")
    cameras = ("sem_0", "sem_1", "sem_2", "sem_3", "sem_4", "tel_sem")
    for item in table_fields(cameras, has_scan=True):
        shape = " x ".join(map(str, item.shape)) or "1"
        assert f"| `{item.name}` | {item.dtype} | {shape} | {item.unit} | {item.frame} | {item.about} |" in text
    for item in DatasetInfo.read(recorded).blobs:
        assert f"`{item.name}`" in text.replace("`rgb_0` … `rgb_4`", "`rgb_0` `rgb_1` `rgb_2` `rgb_3` `rgb_4`").replace(
            "`sem_0` … `sem_4`", "`sem_0` `sem_1` `sem_2` `sem_3` `sem_4`"
        )
        assert f"`{item.codec}`" in text
