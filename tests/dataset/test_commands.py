"""`lavsim dataset …`: what it prints, and mistakes in one line with exit code 2."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from lavsim.cli import main
from lavsim.dataset import collect
from lavsim.dataset.card import card_text
from lavsim.dataset.files import write_sealed
from lavsim.dataset.noise import ControlNoise
from lavsim.dataset.plan import CollectPlan
from lavsim.dataset.reader import Dataset
from tests.dataset.made import write_dataset
from tests.test_cli import refusal


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What a command prints; it succeeds and says nothing on stderr."""
    code = main(["dataset", *arguments])
    captured = capsys.readouterr()
    assert (code, captured.err) == (0, "")
    return captured.out


@pytest.fixture
def data(tmp_path: Path) -> str:
    write_dataset(tmp_path / "data", (4, 3))
    return str(tmp_path / "data")


def test_info_prints_one_array_of_objects(capsys: pytest.CaptureFixture[str], data: str) -> None:
    found: list[dict[str, Any]] = json.loads(run(capsys, "info", data, data, "--json"))
    assert [(one["dataset"], one["frames"]) for one in found] == [(data, 7), (data, 7)]
    assert found[0]["statistics"]["frames"] == 7
    assert json.loads(run(capsys, "info", data, "--no-statistics", "--json"))[0]["statistics"] is None
    text = run(capsys, "info", data)
    for word in ("7 frames in 2 episodes", "us_large_a", "tick_gnss", "vehicle distance", "follow"):
        assert word in text


def test_info_draws_statistics(capsys: pytest.CaptureFixture[str], data: str, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    assert str(tmp_path / "c.png") in run(capsys, "info", data, "--plot", str(tmp_path / "c.png"))
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")


def test_split_merge_and_export(capsys: pytest.CaptureFixture[str], data: str, tmp_path: Path) -> None:
    parts, whole, shards = (str(tmp_path / name) for name in ("parts", "whole", "shards"))
    assert "4 frames in 1 episodes" in run(capsys, "split", data, "--towns", "each", "--out", parts)
    assert "7 frames in 2 episodes" in run(
        capsys, "merge", f"{parts}/eu_small_a", f"{parts}/us_large_a", "--out", whole, "--copy"
    )
    assert "samples 7" in run(capsys, "export", whole, "--format", "webdataset", "--out", shards, "--fields", "bev")
    assert len(Dataset(whole)) == 7


def test_show_writes_a_picture(capsys: pytest.CaptureFixture[str], data: str, tmp_path: Path) -> None:
    picture = tmp_path / "new" / "p.png"
    assert run(capsys, "show", data, "--frames", "3", "--out", str(picture)).strip() == str(picture)
    sheet = picture.read_bytes()
    run(capsys, "show", data, "--frame", "1/2", "--out", str(picture))
    assert picture.read_bytes() != sheet


def test_show_takes_a_dataset_too(capsys: pytest.CaptureFixture[str], data: str, tmp_path: Path) -> None:
    assert main(["show", data, "--out", str(tmp_path / "pictures")]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "pictures" / "data.png")
    assert (tmp_path / "pictures" / "data.png").is_file()


def test_check_exits_2_with_findings(capsys: pytest.CaptureFixture[str], data: str) -> None:
    (Path(data) / "blobs" / "ep_000001.tar").unlink()
    assert main(["dataset", "check", data, "--json"]) == 2
    findings = json.loads(capsys.readouterr().out)
    assert any(one["file"] == "blobs/ep_000001.tar" and "missing" in one["finding"] for one in findings)
    assert main(["dataset", "check", data]) == 2
    assert "ep_000001.tar is missing" in capsys.readouterr().out


def test_mistakes_get_one_line(capsys: pytest.CaptureFixture[str], data: str, tmp_path: Path) -> None:
    out = str(tmp_path / "out")
    for arguments, words in (
        (("info", str(tmp_path)), "is no dataset: it has no meta/info.json"),
        (("merge", data, data, "--out", out), "is the same drive as episode 0"),
        (("merge", data, "--out", data), "exists already"),
        (("split", data, "--out", out), "give one of --towns, --shares and --episodes"),
        (("split", data, "--towns", "a=us_large", "--out", out), "Did you mean 'us_large_a'"),
        (("show", data, "--frame", "1"), "expected EPISODE/FRAME"),
        (("show", data, "--frame", "0/9"), "episode 0 holds 4 frames"),
        (("show", data, "--frame", "5/0"), "has no finished episode 5"),
        (("show", data, "--out", "p.gif"), "expected a file *.png"),
        (("info", data, "--plot", "p.gif"), "expected a file *.png"),
        (("export", data, "--format", "zarr", "--out", out), "'zarr' is not one of"),
        (("export", data, "--format", "lav", "--out", out), "has no field 'rgb_1'"),
        (("export", data, "--format", "lav", "--out", out, "--fields", "bev"), "--fields goes with"),
        (("import", data, "--out", out), "holds no trajectory of LAV's dataset"),
    ):
        assert words in refusal(capsys, "dataset", *arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


def test_the_cards_command_makes_the_same_plan(
    capsys: pytest.CaptureFixture[str], data: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = CollectPlan(
        towns=("eu_small_a", "us_large_a"), frames=7, seed=5, weathers=("ClearNoon", "lav"), vehicles=(5, 60),
        length=(120.0, 300.0), noise=ControlNoise(push=1.5), episode_frames=40, log_only=True, look="full",
        hazards_per_km=1.5,
    )  # fmt: skip
    write_sealed(Path(data) / "meta/plan.json", {"plan_schema": 1, "plan": plan.to_json(), "town_digests": {}})
    text = card_text(Dataset(data))
    command = text.split("```\n")[1].split()
    plans: list[CollectPlan] = []

    def catch(given: CollectPlan, *_: object, **__: object) -> collect.Collected:
        plans.append(given)
        return collect.Collected(Path(data), ())

    monkeypatch.setattr(collect, "collect", catch)
    assert main(command[1:]) == 0
    assert plans == [plan]
