"""The search for failures: the same on any number of workers, after a kill, and driven again from its route file."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lavsim.cli import main
from lavsim.errors import AgentError, LavsimError, OutputError
from leaderboard.drive import Tick
from leaderboard.evaluator import EvaluationConfig, evaluate
from leaderboard.route_check import check_routes
from leaderboard.route_writer import write_routes
from leaderboard.routes import RouteEntry, read_routes
from leaderboard.search import search as module
from leaderboard.search.cross_entropy import POPULATION
from leaderboard.search.ground import find_ground
from leaderboard.search.search import FOUND, Search, SearchConfig, failures_table
from leaderboard.search.store import HEADER, LINES
from leaderboard.search.trial import Trial, TrialTask
from tests.drives import hazard, straight_drive, straight_route

BLIND = "agents.baselines.blind"


@pytest.fixture(scope="module")
def routes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A route file: 110 m of a straight street with a walker at the kerb."""
    spec = straight_drive()
    route = straight_route()
    walker = hazard("DynamicObjectCrossing", 30, distance=25.0)
    ends = route.points[[0, 110]]
    entry = RouteEntry("7", spec.town, ends, (), (walker,), "2.x", "empty", "walker.xml", 1)
    path = tmp_path_factory.mktemp("routes") / "walker.xml"
    path.write_bytes(write_routes([entry], "empty"))
    return path


def config(routes: Path, out: Path, **changes: Any) -> SearchConfig:
    base = SearchConfig("DynamicObjectCrossing", BLIND, out, routes=str(routes), ranges=("distance=15:45",))
    return replace(base, **changes)


def pretended(task: TrialTask, report: Callable[[Tick], None]) -> Trial:
    """A drive that is only pretended: the agent fails where the walker is between 30 and 33 m away."""
    report(Tick(task.number, 50.0, 1.0, 0))
    distance = float(task.values["distance"])
    margin = min(abs(distance - 31.5) / 30.0, 1.0)
    failed = ("collisions_pedestrian",) if margin < 0.05 else ()
    return Trial(task.number, task.attempts, task.point, task.values, failed, 0.0 if failed else margin, True)


def lines_of(folder: Path) -> bytes:
    return (folder / LINES).read_bytes()


@pytest.fixture
def _pretend(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "run_trial", pretended)


@pytest.mark.usefixtures("_pretend")
def test_workers_change_nothing(routes: Path, tmp_path: Path) -> None:
    Search(config(routes, tmp_path / "a", drives=6)).run()
    Search(config(routes, tmp_path / "b", drives=6, workers=2)).run()
    assert lines_of(tmp_path / "a") == lines_of(tmp_path / "b")


@pytest.mark.usefixtures("_pretend")
@pytest.mark.parametrize("after", [0, 3, 11])
def test_a_killed_search_ends_as_one_that_was_not(
    routes: Path, tmp_path: Path, after: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    budget = 2 * POPULATION
    Search(config(routes, tmp_path / "whole", drives=budget)).run()

    def killed(task: TrialTask, report: Callable[[Tick], None]) -> Trial:
        if task.number == after:
            raise KeyboardInterrupt
        return pretended(task, report)

    with monkeypatch.context() as context:
        context.setattr(module, "run_trial", killed)
        with pytest.raises(KeyboardInterrupt):
            Search(config(routes, tmp_path / "cut", drives=budget)).run()
    if after:
        (tmp_path / "cut" / f"{LINES}.1.partial").write_text("half a li")
    Search(config(routes, tmp_path / "cut", drives=budget)).run()
    assert lines_of(tmp_path / "cut") == lines_of(tmp_path / "whole")
    assert not list((tmp_path / "cut").glob("*.partial"))


@pytest.mark.usefixtures("_pretend")
def test_a_larger_budget_goes_on_where_a_smaller_one_ended(routes: Path, tmp_path: Path) -> None:
    for drives in (5, 2 * POPULATION):
        Search(config(routes, tmp_path / "steps", drives=drives)).run()
    Search(config(routes, tmp_path / "once", drives=2 * POPULATION)).run()
    assert lines_of(tmp_path / "steps") == lines_of(tmp_path / "once")


@pytest.mark.usefixtures("_pretend")
def test_another_search_is_refused_in_the_folder_unless_it_may_be_replaced(routes: Path, tmp_path: Path) -> None:
    Search(config(routes, tmp_path, drives=2)).run()
    with pytest.raises(OutputError, match=r"begun with seed = 0, not 1"):
        Search(config(routes, tmp_path, drives=2, seed=1))
    first = lines_of(tmp_path)
    Search(config(routes, tmp_path, drives=2, seed=1, overwrite=True)).run()
    assert lines_of(tmp_path) != first


@pytest.mark.parametrize("name", [HEADER, LINES])
def test_a_damaged_folder_is_told(routes: Path, tmp_path: Path, name: str) -> None:
    Search(config(routes, tmp_path, drives=2))
    (tmp_path / name).write_text("{")
    with pytest.raises(OutputError, match=name):
        Search(config(routes, tmp_path, drives=2))


def test_a_range_of_values_that_cannot_stand_there_is_refused(routes: Path, tmp_path: Path) -> None:
    ground = find_ground("DynamicObjectCrossing", str(routes))
    refused = {d: ground.refusal(ground.with_values({"distance": float(d)}, "0")) for d in range(20, 400, 5)}
    assert refused[25] is None
    inside = next(d for d, reason in refused.items() if reason is not None)
    assert "junction" in str(refused[inside])
    with pytest.raises(LavsimError, match=rf"no values of distance={inside}:{inside} .* walker\.xml, route 7"):
        Search(config(routes, tmp_path, ranges=(f"distance={inside}",), drives=1)).run()
    Search(config(routes, tmp_path / "both", ranges=(f"distance=25:{inside}",), drives=1))


def test_variations_are_drawn_from_their_ranges_and_stand_in_a_file_that_loads(routes: Path, tmp_path: Path) -> None:
    def vary(name: str, *more: str) -> list[float | str]:
        given = ["--routes", str(routes), "--range", "distance=20:30", "--out", str(tmp_path / name), *more]
        assert main(["scenarios", "--vary", "DynamicObjectCrossing", *given]) == 0
        return [entry.scenarios[0].parameters["distance"] for entry in read_routes(tmp_path / name)]

    first = vary("a.xml", "--count", "5")
    assert len(set(first)) == 5
    assert all(20.0 <= float(value) <= 30.0 for value in first)
    assert vary("b.xml", "--count", "3") == first[:3]
    assert vary("c.xml", "--count", "5", "--seed", "1") != first
    assert check_routes(tmp_path / "a.xml") == []


def test_a_trigger_is_moved_along_the_route(routes: Path) -> None:
    ground = find_ground("DynamicObjectCrossing", str(routes))
    moved = ground.with_values({"trigger": 12.0}, "0").scenarios[0].trigger
    gap = ((moved[0] - ground.hazard.trigger[0]) ** 2 + (moved[1] - ground.hazard.trigger[1]) ** 2) ** 0.5
    assert 11.0 < gap < 13.5


def test_failures_are_driven_again_from_the_route_file_to_the_byte(routes: Path, tmp_path: Path) -> None:
    search = Search(config(routes, tmp_path / "search", drives=1, seed=5))
    trials = search.run()
    failures = [trial for trial in trials if trial.failed]
    assert failures, "the blind follower runs into somebody"
    assert all(trial.failed_by == ("collisions_pedestrian",) for trial in failures)
    assert [row["route"] for row in failures_table(search)] == [trial.number for trial in failures]
    found = read_routes(tmp_path / "search" / FOUND)
    assert [entry.to_json() for entry in found] == [search.entry_of(trial).to_json() for trial in failures]
    again = evaluate(
        EvaluationConfig.of(
            agent=BLIND, routes=str(tmp_path / "search" / FOUND), route_ids=found[0].id, rules="2.1", seed=5,
            out=tmp_path / "again", pictures=False,
        )
    )  # fmt: skip
    log = tmp_path / "again" / again.drive(0)["log"]
    assert failures[0].log is not None
    assert log.read_bytes() == (tmp_path / "search" / failures[0].log).read_bytes()
    assert json.loads(lines_of(tmp_path / "search").splitlines()[0])["number"] == 0


def test_an_agent_that_cannot_be_set_up_ends_the_search(routes: Path, tmp_path: Path) -> None:
    agent = tmp_path / "broken.py"
    agent.write_text(
        "class Broken:\n"
        "    def setup(self, path):\n"
        "        raise ValueError('no weights')\n"
        "    def sensors(self):\n"
        "        return []\n"
        "    def run_step(self, data, time):\n"
        "        return None\n"
        "def get_entry_point():\n"
        "    return 'Broken'\n"
    )
    with pytest.raises(AgentError, match="no weights"):
        Search(config(routes, tmp_path / "out", agent=str(agent), drives=2)).run()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--search", "Acident", "--agent", BLIND], ["Acident", "'Accident'"]),
        (["--search", "Accident"], ["--agent"]),
        (["--search", "Accident", "--agent", "agents.baselines.blnd"], ["agents.baselines.blnd"]),
        (["--search", "Accident", "--agent", BLIND, "--range", "distanse=1:2"], ["distanse", "'distance'"]),
        (["--search", "Accident", "--agent", BLIND, "--range", "distance=9:2"], ["distance", "rise"]),
        (["--search", "Accident", "--agent", BLIND, "--drives", "0"], ["drives", "0"]),
        (["--search", "Accident", "--agent", BLIND, "--workers", "0"], ["workers", "0"]),
        (["--search", "Accident", "--agent", BLIND, "--rules", "3"], ["'3'", "2.1"]),
        (["--search", "Accident", "--agent", BLIND, "--routes", "quik"], ["quik", "quick"]),
        (["--search", "Accident", "--agent", BLIND, "--route-id", "0"], ["Accident", "route 0"]),
        (["--search", "Accident", "--certify", "all"], ["--search", "--certify"]),
        (["--vary", "Acident"], ["Acident", "'Accident'"]),
        (["--vary", "Accident", "--count", "0"], ["count", "0"]),
        (["--certify", "Acident"], ["Acident", "'Accident'"]),
        (["--certify", "nowhere.xml"], ["nowhere.xml"]),
        (["--certify", "Accident", "--seeds", "0"], ["seeds", "0"]),
        (["--certify", "Accident", "--agent", "agents.nobody"], ["agents.nobody"]),
    ],
)
def test_a_mistake_is_one_line(
    arguments: list[str], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["scenarios", *arguments, "--out", str(tmp_path / "out")]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1, captured.err
    assert all(word in lines[0] for word in words), lines[0]
