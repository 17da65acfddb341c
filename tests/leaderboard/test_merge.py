"""Runs that shared out the routes, joined."""

from __future__ import annotations

import atexit
import json
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from lavsim.errors import OutputError
from leaderboard.evaluator import evaluate
from leaderboard.merge import merge
from leaderboard.run import Run
from tests.leaderboard.test_evaluator import steady, without_clock


@cache
def driven(rules: str) -> Path:
    """A folder with a run of three routes (out), and the same routes driven in two runs (a, b)."""
    folder = Path(tempfile.mkdtemp(prefix="shares"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    evaluate(steady(folder, 3, rules=rules))
    for ids, out in (("1", folder / "b"), ("0,2", folder / "a")):
        evaluate(steady(folder, 3, rules=rules, route_ids=ids, out=out))
    return folder


def shared_out(folder: Path, rules: str = "1.0") -> tuple[Run, list[Path]]:
    """A copy of what was driven, for a test to change: the whole, and its shares."""
    shutil.copytree(driven(rules), folder, dirs_exist_ok=True)
    return Run.load(folder / "out"), [folder / "b", folder / "a"]


@pytest.mark.parametrize("rules", ["1.0", "2.1"])
def test_shares_give_the_file_of_the_whole(tmp_path: Path, rules: str) -> None:
    whole, shares = shared_out(tmp_path, rules)
    merge(shares, tmp_path / "joined")
    joined = Run.load(tmp_path / "joined")
    assert without_clock(joined) == without_clock(whole)
    assert [drive["route"] for drive in joined.run["drives"]] == ["0", "1", "2"]
    assert all((joined.folder / drive["log"]).is_file() for drive in joined.run["drives"])
    assert (joined.folder / "report.html").is_file()


def test_results_files_alone_are_joined_too(tmp_path: Path) -> None:
    whole, shares = shared_out(tmp_path)
    merge([share / "results.json" for share in shares], tmp_path / "joined", version="1.0")
    text = (tmp_path / "joined" / "results.json").read_text()
    joined = json.loads(text)
    assert joined["values"] == whole.results["values"]
    assert joined["_checkpoint"]["progress"] == [3, 3]


def test_a_share_that_is_not_done_leaves_the_whole_unfinished(tmp_path: Path) -> None:
    _, shares = shared_out(tmp_path)
    path = shares[0] / "results.json"
    content: dict[str, Any] = json.loads(path.read_text())
    content["_checkpoint"]["progress"] = [1, 2]
    path.write_text(json.dumps(content))
    results = merge(shares, tmp_path / "joined")
    assert results.entry_status() == "Started"
    assert results.to_json()["_checkpoint"]["global_record"] == {}


def test_what_does_not_belong_together_is_refused(tmp_path: Path) -> None:
    whole, shares = shared_out(tmp_path)
    with pytest.raises(OutputError, match="RouteScenario_1 is in more than one"):
        merge([whole.folder, shares[0]], tmp_path / "joined")
    with pytest.raises(OutputError, match="give --rules"):
        merge([whole.folder / "results.json"], tmp_path / "joined")
    with pytest.raises(OutputError, match=r"rules 1\.0 and 2\.1 can't be joined"):
        merge(shares, tmp_path / "joined", version="2.1")
    (tmp_path / "notes.json").write_text('{"a": 1}')
    with pytest.raises(OutputError, match=r"notes\.json is no results file"):
        merge([tmp_path / "notes.json"], tmp_path / "joined", version="1.0")
    assert not (tmp_path / "joined").exists()


def test_other_sensors_are_refused(tmp_path: Path) -> None:
    _, shares = shared_out(tmp_path)
    path = shares[0] / "results.json"
    path.write_text(path.read_text().replace("carla_speedometer", "carla_lidar"))
    with pytest.raises(OutputError, match="different sensors"):
        merge(shares, tmp_path / "joined")
