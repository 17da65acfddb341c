"""The examples: each runs to its end at a small scale and leaves what it says; long ones are slow tests."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"

# Name of the script: arguments at a small scale, files it must leave below --out.
SMALL: dict[str, tuple[Sequence[str], Sequence[str]]] = {
    "own_sensor": (["--seconds", "1"], ["ring.json"]),
    "learn_by_reward": (["--rounds", "1", "--tries", "4", "--steps", "20"], ["policy.npz"]),
    "import_town": ([], ["my_town.png", "routes.xml"]),
    "collect_on_ray": (["--frames", "4"], ["README.md", "logs/ep_000000.lavlog"]),
    "export_scene": (["--seconds", "0.5"], ["eu_small_a.glb"]),
    "own_agent": ([], ["results.json", "report.html"]),
}
LONG: dict[str, tuple[Sequence[str], Sequence[str]]] = {
    "own_hazard": ([], ["run/results.json"]),
    "rescore_drive": ([], ["rules-2.1/results.json", "rules-corrected/results.json"]),
    "compare_agents": ([], ["comparison.html"]),
    "train_micro": (["--frames", "16", "--epochs", "1"], ["weights/bev/bev.safetensors"]),
}


def main_of(name: str) -> Callable[[Sequence[str]], int]:
    """The example's `main`; its own module, so that what it registers is registered once."""
    spec = importlib.util.spec_from_file_location(f"example_{name}", EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module.main


def run(name: str, arguments: Sequence[str], files: Sequence[str], out: Path) -> None:
    assert main_of(name)([*arguments, "--out", str(out)]) == 0
    for file in files:
        assert (out / file).stat().st_size > 0, file


def test_every_example_is_run_here() -> None:
    assert {path.stem for path in EXAMPLES.glob("*.py")} == {*SMALL, *LONG}
    assert len(SMALL) + len(LONG) == 10


@pytest.mark.parametrize("name", SMALL)
def test_runs(name: str, tmp_path: Path) -> None:
    run(name, *SMALL[name], tmp_path / "out")


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_runs_to_the_end(name: str, tmp_path: Path) -> None:
    if name == "train_micro":
        pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")
    run(name, *LONG[name], tmp_path / "out")
