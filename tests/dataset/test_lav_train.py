# ruff: noqa: E402 - torch comes first
"""`lavsim train` on a recorded drive: the whole graph, what is skipped or shared, several processes, mistakes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.config import find_preset
from agents.lav.perceive import read_trained
from agents.lav.records import CURVE, PACE
from agents.lav.stages.base import STAGES
from agents.lav.train import DONE, TrainTask, stages_of, train
from agents.lav.weights import ELSEWHERE, read_weights
from lavsim.cli import main
from lavsim.dataset.schema import DatasetInfo, RecordConfig
from lavsim.errors import ConfigError, LavsimError
from lavsim.sensors.suites import SUITES

WHOLE = stages_of("all", find_preset("micro"))
ONE_STEP = ("train.epochs=0.01", "train.batch=4", 'train.precision="float32"')


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="module")
def trained(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> TrainTask:
    """Every stage at the size of tests, one step each."""
    torch.set_num_threads(1)
    task = TrainTask("all", recorded, tmp_path_factory.mktemp("weights"), "micro", sets=ONE_STEP)
    told: list[str] = []
    train(task, lambda name, pace: told.append(name))
    assert set(told) == set(WHOLE)
    return task


def test_all_stages_are_trained_parents_first_and_not_again(trained: TrainTask) -> None:
    markers = {name: _marker(trained.out, name) for name in WHOLE}
    before = {name: path.stat().st_mtime_ns for name, path in markers.items()}
    assert sorted(before, key=lambda name: before[name]) == WHOLE
    train(replace(trained, resume=True))
    assert {name: path.stat().st_mtime_ns for name, path in markers.items()} == before
    lineage = read_weights(markers["full"]).lineage
    assert set(lineage["parents"]) == {"painting", "perception", "bev"}
    assert lineage["data"] == trained.data.name
    pace = json.loads((trained.out / "full" / PACE).read_text())
    assert pace["samples_per_s"] > 0.0
    assert 0.0 <= pace["waiting"] <= 1.0


def test_a_variant_shares_what_does_not_differ(trained: TrainTask, tmp_path: Path) -> None:
    task = replace(trained, stage="all", out=tmp_path, variant="ego-only", shared=[trained.out])
    train(task)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bev", "full", ELSEWHERE]
    assert read_trained(tmp_path).brake.stage == "brake", "what was taken from others drives, too"
    weights = read_weights(_marker(tmp_path, "full"))
    assert weights.lineage["variant"] == "ego-only"
    assert not weights.config.training.others
    joint = replace(task, out=tmp_path / "joint", variant="perception-joint")
    train(joint)
    assert sorted(path.name for path in joint.out.iterdir()) == ["full", ELSEWHERE]
    assert "perception" not in stages_of("all", read_weights(_marker(joint.out, "full")).config)


def test_what_only_leads_to_finished_stages_is_not_made(trained: TrainTask, tmp_path: Path) -> None:
    eyes = tmp_path / "eyes"
    for name in ("brake", "segmentation"):
        eyes.mkdir(exist_ok=True)
        (eyes / name).symlink_to(trained.out / name)
    task = replace(trained, stage="all", out=tmp_path / "own", shared=[eyes], later=["full"])
    train(task)
    assert sorted(path.name for path in task.out.iterdir()) == ["bev", "painting", "perception", ELSEWHERE]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stage": "full", "variant": "refinement-1"}, "no variant 'refinement-1'. Did you mean 'refinements-1'"),
        ({"stage": "full", "out": Path("nowhere")}, "stage 'painting' comes first: there are no weights at"),
        ({"stage": "full", "sets": (*ONE_STEP, "lav.grid.cell=0.5")}, "was trained with another 'grid' than"),
        ({"stage": "bev", "preset": "tiny"}, "was trained with another 'grid' than"),
        ({"stage": "bev", "processes": 3, "device": "cuda"}, "3 GPUs are asked for"),
    ],
)
def test_what_does_not_fit_gets_one_line(
    trained: TrainTask, tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    task = replace(trained, resume=True, **changes)  # type: ignore[arg-type]
    if task.out == trained.out and task.stage == "full":
        task = replace(task, out=tmp_path, shared=())
        for name in ("painting", "perception", "bev"):
            (tmp_path / name).symlink_to(trained.out / name)
    if task.device == "cuda":
        task = replace(task, out=tmp_path)
    with pytest.raises(LavsimError, match=message):
        train(task)


def test_weights_of_another_stage_or_size_do_not_begin_one(trained: TrainTask, tmp_path: Path) -> None:
    start = _marker(trained.out, "bev")
    with pytest.raises(ConfigError, match="holds the weights of stage 'bev', not of 'brake'"):
        train(replace(trained, stage="brake", out=tmp_path / "a", start=start))
    with pytest.raises(ConfigError, match=r"has other sizes \(micro\)"):
        train(replace(trained, stage="bev", out=tmp_path / "b", start=start, preset="tiny"))
    train(replace(trained, stage="bev", out=tmp_path / "c", start=start))
    assert read_weights(_marker(tmp_path / "c", "bev")).lineage["start"] is not None


@pytest.mark.parametrize("stage", ["bev", "segmentation", "perception"])
def test_an_empty_or_mismatched_dataset_gets_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], stage: str
) -> None:
    for name, suite in (("empty", SUITES["lav_data"]), ("blind", ())):
        root = tmp_path / name
        DatasetInfo.of(RecordConfig(suite), seed=1).write(root)
        arguments = ["--preset", "micro", "--set", 'lav.training.painting="truth"', "--out", str(tmp_path / "out")]
        assert main(["train", stage, "--data", str(root), *arguments, "--resume"]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1, error
        assert name in error


@pytest.mark.slow
def test_two_processes_train_together(recorded: Path, tmp_path: Path) -> None:
    sets = ("train.epochs=0.5", "train.batch=4", 'train.precision="float32"')
    task = TrainTask("bev", recorded, tmp_path / "two", "micro", sets=sets, processes=2)
    measures = train(task)
    alone = train(replace(task, out=tmp_path / "one", processes=1))
    assert measures.keys() == alone.keys()
    rows = [(tmp_path / name / "bev" / CURVE).read_text().count("\n") for name in ("one", "two")]
    assert rows[0] == rows[1] > 1
    found = read_weights(_marker(tmp_path / "two", "bev")).tensors
    assert all(torch.isfinite(value).all() for value in found.values() if value.is_floating_point())
    with pytest.raises(ConfigError, match="can't be shared by 2 processes"):
        train(replace(task, out=tmp_path / "odd", sets=(*sets, "train.batch=5")))


def _marker(out: Path, name: str) -> Path:
    return out / name / (f"{name}.safetensors" if STAGES[name].is_trained else DONE)
