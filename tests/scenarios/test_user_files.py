"""Hazards of users are found, listed, placed, driven; their mistakes are told with file and line."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from lavsim.cli import app
from lavsim.errors import OutputError, ScenarioError
from lavsim.map.town_files import load_town
from lavsim.scenarios.base import SCENARIOS
from lavsim.scenarios.skeleton import skeleton, write_skeleton
from lavsim.scenarios.user_files import SCENARIO_PATH, use_folders
from lavsim.simulation import Simulation
from lavsim.types import Control
from leaderboard.hazard_maker import Stand, stand_on, stands
from leaderboard.route_check import check_routes
from leaderboard.routes import read_routes
from tests.scenarios.stands import Follower, drive, hits, left_over, run


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of a user; what it registers is forgotten after the test."""
    assert ("2.x", "DynamicObjectCrossing") in SCENARIOS
    monkeypatch.setenv(SCENARIO_PATH, "")
    monkeypatch.setattr(SCENARIOS, "_entries", dict(SCENARIOS._entries))
    return tmp_path


def place(kind: str) -> Stand:
    return next(stands(load_town("eu_small_a"), kind, "2.x"))


def test_a_new_hazard_runs_as_it_is_written(folder: Path) -> None:
    """Hurts the blind, spares the careful, in about 30 lines."""
    assert 25 <= sum(1 for line in skeleton("RollingBin").splitlines() if line) <= 36
    assert write_skeleton("RollingBin", folder).name == "rolling_bin.py"
    use_folders([folder])
    spec = drive(place("RollingBin"))
    assert hits(run(spec, 400)) == {0}
    careful = run(spec, 700, Follower(looks=True))
    assert hits(careful) == set()
    assert left_over(careful[-1]) == 0


def test_the_skeleton_is_written_once_and_under_a_good_name(folder: Path) -> None:
    write_skeleton("RollingBin", folder)
    with pytest.raises(OutputError, match=r"rolling_bin.py is there already"):
        write_skeleton("RollingBin", folder)
    with pytest.raises(ScenarioError, match="named like RollingBin, got 'rolling bin'"):
        write_skeleton("rolling bin", folder)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1\ndef f(:\n", r"bad.py, line 2: invalid syntax"),
        ("\n\ny = 1 / 0\n", r"bad.py, line 3: ZeroDivisionError: division by zero"),
        (skeleton("DynamicObjectCrossing"), r"bad.py, line 18: ValueError: .* is registered twice"),
    ],
)
def test_mistakes_in_a_file_are_told_with_its_line(folder: Path, text: str, message: str) -> None:
    (folder / "bad.py").write_text(text)
    with pytest.raises(ScenarioError, match=message):
        use_folders([folder])


@pytest.mark.parametrize(
    ("mistake", "instead"),
    [
        ("free = to_junction(site.anchor)", "free = to_junction(site.ankor)"),
        ("spot = aside(self.crossing, reach)", "spot = aside(self.crosing, reach)"),
        ("yield from wait.driven(stage.world.ego, 20.0)", "yield from wait.drivn(stage.world.ego, 20.0)"),
    ],
)
def test_mistakes_while_it_runs_are_told_with_file_and_line(folder: Path, mistake: str, instead: str) -> None:
    file = write_skeleton("RollingBin", folder)
    good = file.read_text()
    use_folders([folder])
    spec = drive(place("RollingBin"))
    number = next(k for k, line in enumerate(good.splitlines(), 1) if mistake in line)
    bad = folder / "bad"
    bad.mkdir()
    (bad / "worse.py").write_text(good.replace(mistake, instead))
    del SCENARIOS._entries["2.x", "RollingBin"]
    use_folders([bad])
    with pytest.raises(ScenarioError, match=rf"worse.py, line {number}: AttributeError"):
        run(spec, 400)


def test_no_folder_no_hazards(folder: Path) -> None:
    with pytest.raises(ScenarioError, match="--scenario-path: there is no folder"):
        use_folders([folder / "nowhere"])


def test_commands_list_suggest_and_put_a_users_hazard_on_routes(folder: Path) -> None:
    runner = CliRunner()

    def said(*arguments: str) -> str:
        result = runner.invoke(app, [*arguments], catch_exceptions=False)
        assert result.exit_code == 0, result.output
        return result.output

    path = ("--scenario-path", str(folder))
    said("scenarios", "--new", "RollingBin", *path)
    assert "RollingBin" in said("scenarios", "--json", *path)
    assert (
        said("scenarios", "--suggest", "eu_small_a", "RollingBin", "--count", "2", "--json", *path).count('"road"') == 2
    )
    file = folder / "bench.xml"
    chosen = ("--hazard", "RollingBin", "--hazard", "1.0:Scenario3", "--spacing", "150", "--weather", "fog")
    said("routes", "make", "--town", "eu_small_a", "--out", str(file), "--count", "2", *chosen, *path)
    entries = read_routes(file)
    kinds = {(spec.generation, spec.type) for entry in entries for spec in entry.scenarios}
    assert kinds == {("2.x", "RollingBin"), ("1.0", "Scenario3")}
    assert {frame.weather.fog_density for entry in entries for frame in entry.weather} == {30.0}
    assert check_routes(file) == []


def test_a_route_keeps_its_hazard_through_a_file_and_stands_nowhere_without_room() -> None:
    town = load_town("eu_small_a")
    found = next(stands(town, "Scenario3", "1.0"))
    again = stand_on(town, found.route, "Scenario3", "1.0")
    assert again is not None
    assert again.spec == found.spec
    assert list(stands(town, "Scenario5", "1.0", tries=40)) == []
    simulation = Simulation(drive(found))
    simulation.tick(Control())
