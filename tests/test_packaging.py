"""The wheel: built from the tracked files, put into a clean environment, tried from another folder."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

import lavsim

ROOT = Path(__file__).parents[1]
TOWNS = 8
WEIGHTS = """
import json, struct
from importlib import resources
names = []
for file in sorted(resources.files("agents.lav").joinpath("trained").iterdir(), key=lambda f: f.name):
    if file.name.endswith(".safetensors"):
        data = file.read_bytes()
        head = json.loads(data[8 : 8 + struct.unpack("<Q", data[:8])[0]])
        ends = [entry["data_offsets"][1] for name, entry in head.items() if name != "__metadata__"]
        assert 8 + struct.unpack("<Q", data[:8])[0] + max(ends) == len(data), file.name
        names.append(file.name)
print(json.dumps(names))
"""
DATA = """
import json
import agents, lavsim, leaderboard, routes
from lavsim.map.town_files import load_town, town_names
from leaderboard.routes import read_routes, route_files
print(json.dumps({
    "from": [m.__file__ for m in (agents, lavsim, leaderboard, routes)],
    "routes": {name: len(read_routes(name)) for name in route_files()},
    "lanes": len(load_town("eu_small_a").lanes.length),
}))
"""

pytestmark = pytest.mark.slow


def run(*command: str | Path, cwd: Path) -> str:
    """What it prints; it must end well."""
    done = subprocess.run([*map(str, command)], cwd=cwd, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy of the tracked files, so that nothing else can be in it and nothing is left in the tree."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    for name in run("git", "ls-files", "-z", cwd=ROOT).split("\0"):
        if name.split("/")[0] in {
            "lavsim",
            "leaderboard",
            "agents",
            "routes",
            "pyproject.toml",
            "README.md",
            "LICENSE",
        }:
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, source / name)
    run(sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, source, cwd=folder)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fresh environment with the wheel. What it depends on is lent from here, but no package of this tree: lines of a
    *.pth file name folders, and *.pth files inside those (an editable install is one) are not read."""
    folder = tmp_path_factory.mktemp("clean") / "venv"
    venv.create(folder, with_pip=True)
    made = folder / "bin" / "python"
    run(made, "-m", "pip", "install", "--quiet", "--no-deps", wheel, cwd=folder)
    own = Path(run(made, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder).strip())
    (own / "lent.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    return made


def test_wheel_holds_what_is_read_at_run_time(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    tracked = run("git", "ls-files", "-z", "lavsim", "leaderboard", "agents", "routes", cwd=ROOT).split("\0")
    missing = {name for name in tracked if name} - names
    assert not missing, sorted(missing)
    assert "lavsim/py.typed" in names
    assert not {name for name in names if name.startswith(("tests/", "benchmarks/", "examples/"))}


def test_command_works_away_from_the_repository(python: Path, tmp_path: Path) -> None:
    command = python.parent / "lavsim"
    assert lavsim.__version__ in run(command, "--version", cwd=tmp_path)
    assert len(json.loads(run(command, "towns", "--json", cwd=tmp_path))) == TOWNS
    assert len(json.loads(run(command, "routes", "--json", cwd=tmp_path))) > 100
    assert json.loads(run(python, "-m", "lavsim", "agents", "--json", cwd=tmp_path))


def test_towns_routes_and_weights_are_read_from_the_wheel(python: Path, tmp_path: Path) -> None:
    found = json.loads(run(python, "-c", DATA, cwd=tmp_path))
    assert all(Path(file).is_relative_to(python.parents[1]) for file in found["from"]), found["from"]
    assert {"quick", "devtest", "training", "validation", "hazards"} <= set(found["routes"])
    assert found["lanes"] > 0
    shipped = sorted(path.name for path in (ROOT / "agents" / "lav" / "trained").glob("*.safetensors"))
    assert json.loads(run(python, "-c", WEIGHTS, cwd=tmp_path)) == shipped


def test_metadata_passes_twine(wheel: Path) -> None:
    pytest.importorskip("twine", reason="twine is part of the extra 'docs'")
    run(sys.executable, "-m", "twine", "check", "--strict", wheel, cwd=wheel.parent)
