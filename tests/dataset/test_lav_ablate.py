# ruff: noqa: E402 - torch comes first
"""`lavsim ablate` from a dataset to the table: what differs is trained, what does not is shared, and it goes on."""

from __future__ import annotations

from pathlib import Path

import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from lavsim.cli import main
from leaderboard.run import Run

ROUTES = Path(__file__).parents[2] / "examples" / "short.xml"
ONE_STEP = ("train.epochs=0.01", "train.batch=4", 'train.precision="float32"')


@pytest.mark.slow
def test_a_table_is_trained_driven_and_gone_on_with(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    torch.set_num_threads(1)
    sets = [part for value in ONE_STEP for part in ("--set", value)]
    command = ["ablate", "--data", str(recorded), "--out", str(tmp_path), "--table", "refinement", "--preset", "micro"]
    assert main([*command, *sets, "--routes", str(ROUTES), "--route-ids", "0"]) == 0
    table = (tmp_path / "ablations.md").read_text()
    assert [line.split(" | ")[0] for line in table.splitlines()[4:]] == ["| K = 0", "| K = 1", "| K = 5"]
    assert table in capsys.readouterr().out
    assert sorted(path.name for path in (tmp_path / "refinements-0" / "seed0").iterdir() if path.is_dir()) == [
        "bev", "full", "runs",
    ]  # fmt: skip
    for name in ("full", "refinements-0", "refinements-1"):
        [record] = Run.load(tmp_path / name / "seed0" / "runs").records
        assert "set up" not in record["status"], "what it shares with others is found"
    weights = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.safetensors")}
    assert main([*command, *sets, "--routes", str(ROUTES), "--route-ids", "0"]) == 0
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.safetensors")} == weights
    assert (tmp_path / "ablations.md").read_text() == table
