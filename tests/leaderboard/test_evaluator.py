"""Whole runs: short, straight, in the bundled town, with agents in processes of their own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lavsim.agent import AgentFailure, Track
from lavsim.errors import AgentError, ConfigError, OutputError, RouteError, UnknownName
from lavsim.map.town_files import load_town
from lavsim.types import LaneType
from leaderboard.evaluator import EvaluationConfig, Progress, evaluate
from leaderboard.observer import CriteriaObserver
from leaderboard.recorded import RecordedDrive
from leaderboard.run import Run
from leaderboard.sensor_check import check_sensors
from tests.leaderboard.worlds import V1, V20

AGENT = Path(__file__).parent / "fixtures" / "moody_agent.py"
LENGTH = 45.0


def straight_ends() -> list[tuple[float, float]]:
    """Ends of `LENGTH` m on a straight lane of the bundled town."""
    town = load_town("eu_small_a")
    for lane in np.flatnonzero((town.lanes.type == LaneType.DRIVING) & (town.lanes.junction < 0)):
        if town.lanes.length[lane] > LENGTH + 20.0:
            points = town.centre(np.full(2, lane), np.array([5.0, 5.0 + LENGTH]))
            if np.ptp(points[:, 3]) < 1e-6 and abs(np.linalg.norm(np.diff(points[:, :2], axis=0)) - LENGTH) < 1e-3:
                return [(float(p[0]), float(p[1])) for p in points]
    raise AssertionError("no straight lane in eu_small_a")


def route_file(folder: Path, count: int, town: str = "eu_small_a", ends: Any = None) -> Path:
    places = "".join(f'<position x="{x}" y="{y}" z="0"/>' for x, y in ends or straight_ends())
    routes = "".join(f'<route id="{k}" town="{town}"><waypoints>{places}</waypoints></route>\n' for k in range(count))
    path = folder / "short.xml"
    path.write_text(f'<routes traffic="empty">\n{routes}</routes>')
    return path


def config(folder: Path, moods: str, count: int | None = None, **more: Any) -> EvaluationConfig:
    (folder / "moods").write_text(moods)
    values: dict[str, Any] = {
        "agent": str(AGENT),
        "agent_config": str(folder / "moods"),
        "routes": str(route_file(folder, len(moods.split()) if count is None else count)),
        "out": folder / "out",
        "pictures": False,
    }
    return EvaluationConfig.of(**values | more)


def statuses(run: Run) -> list[str]:
    return [record["status"] for record in run.records]


def test_a_failing_agent_loses_its_route_and_no_other(tmp_path: Path) -> None:
    seen: list[Progress] = []
    run = evaluate(config(tmp_path, "raise go nan none exit no-setup truth cameras"), seen.append)
    assert statuses(run) == [
        "Failed - Agent crashed",
        "Completed",
        "Failed - Agent crashed",
        "Failed - Agent crashed",
        "Failed - Agent crashed",
        "Failed - Agent couldn't be set up",
        "Failed - Agent's sensors were invalid",
        "Failed - Agent's sensors were invalid",
    ]
    drives = run.run["drives"]
    messages = [drive["agent_message"] for drive in drives]
    assert "ValueError: no idea" in messages[0]
    assert messages[1] is None
    assert "nan" in messages[2]
    assert "None" in messages[3]
    assert "3" in messages[4]
    assert "no weights" in messages[5]
    assert "sensor.lavsim.truth is not allowed on track SENSORS" in messages[6]
    assert "5 sensors of type sensor.camera.rgb, 4 at most" in messages[7]
    assert run.records[1]["scores"] == {"score_route": 100.0, "score_penalty": 1.0, "score_composed": 100.0}
    assert run.records[5]["scores"]["score_route"] == 0.0
    assert run.mean["score_composed"] == pytest.approx(100.0 / 8, abs=0.5)
    assert run.results["_checkpoint"]["progress"] == [8, 8]
    assert run.results["entry_status"] == "Rejected"
    assert run.results["sensors"] == ["carla_speedometer"]
    assert (run.folder / "report.html").is_file()
    assert [bool(drive["log"]) for drive in drives] == [True] * 5 + [False] * 3
    assert seen[-1].done == seen[-1].total == 8
    assert max(p.completion for p in seen) == 100.0


def test_a_crash_of_the_simulation_loses_its_route_and_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def crash(*_: object) -> None:
        raise ZeroDivisionError("in a kernel")

    made = config(tmp_path, "go go")
    with monkeypatch.context() as patch:
        patch.setattr("leaderboard.drive.run_episode", crash)
        run = evaluate(made)
    assert statuses(run) == ["Failed - Simulation crashed"] * 2
    assert run.results["entry_status"] == "Crashed"
    assert run.run["drives"][0]["ending"] == "ZeroDivisionError: in a kernel"
    assert "the simulation crashed" in caplog.text


def without_clock(run: Run) -> dict[str, Any]:
    content = json.loads((run.folder / "results.json").read_text())
    for record in [*content["_checkpoint"]["records"], content["_checkpoint"]["global_record"]]:
        del record["meta"]["duration_system"]
    return dict(content)


def test_one_seed_gives_the_same_bytes_and_repetitions_differ(tmp_path: Path) -> None:
    runs = []
    for name, suite in (("a", None), ("b", "lav")):  # rendering changes nothing
        more = {"out": tmp_path / name, "repetitions": 2, "sensors": suite, "seed": 3}
        runs.append(evaluate(config(tmp_path, "go go", 1, **more)))
    assert without_clock(runs[0]) == without_clock(runs[1])
    logs = [sorted((run.folder / "logs").glob("*.lavlog")) for run in runs]
    assert [p.name for p in logs[0]] == ["RouteScenario_0_rep0.lavlog", "RouteScenario_0_rep1.lavlog"]
    assert [p.read_bytes() for p in logs[0]] == [p.read_bytes() for p in logs[1]]
    assert runs[0].run["benchmark_id"] == runs[1].run["benchmark_id"]
    first, second = runs[0].run["seeds"]
    assert first == 3
    assert second not in (3, 4)
    assert [drive["seed"] for drive in runs[0].run["drives"]] == [first, second]
    assert str(tmp_path) not in (runs[0].folder / "results.json").read_text()
    watched = CriteriaObserver(V1)  # the recorded drive is judged as the live one
    drive = RecordedDrive.open(logs[0][0])
    watched.watch(drive.town, drive.route)
    endings = [watched.observe(snapshot) for snapshot in drive.log]
    watched.close(None)
    verdict = watched.verdict()
    assert endings[-1] == runs[0].run["drives"][0]["ending"] == "completed"
    assert [i.to_json() for i in verdict.infractions] == runs[0].run["drives"][0]["infractions"]
    assert verdict.duration == runs[0].records[0]["meta"]["duration_game"]


def test_benchmark_id_belongs_to_routes_and_rules(tmp_path: Path) -> None:
    ids = set()
    for k, more in enumerate(({}, {"rules": "2.0"}, {"route_ids": "0"})):
        made = evaluate(config(tmp_path, "no-setup no-setup", 2, out=tmp_path / str(k), **more))
        ids.add(made.run["benchmark_id"])
        if "rules" in more:
            assert [r["route_id"] for r in made.records] == ["RouteScenario_0_rep0", "RouteScenario_1_rep0"]
    assert len(ids) == 3


@pytest.mark.parametrize(
    ("more", "error", "message"),
    [
        ({"agent": "nowhere.py"}, AgentError, "nowhere.py"),
        ({"agent": f"{AGENT}:Moody"}, AgentError, "MoodyAgent"),
        ({"route_ids": "7"}, RouteError, "no route '7'"),
        ({"rules": "3.0"}, UnknownName, r"no rules '3\.0'\. .*1\.0, 2\.0, 2\.1"),
        ({"traffic": "lot"}, UnknownName, "no traffic profile 'lot'"),
        ({"track": "SENSOR"}, UnknownName, r"no track 'SENSOR'\. Did you mean 'SENSORS'"),
        ({"sensors": "lavv"}, UnknownName, "lav"),
        ({"repetitions": 0}, ConfigError, r"repetitions: .*greater than or equal to 1"),
        ({"repetition": 1}, ConfigError, r"no setting 'repetition' of an evaluation\. Did you mean 'repetitions'"),
    ],
)
def test_mistakes_are_said_before_anything_is_written(
    tmp_path: Path, more: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        evaluate(config(tmp_path, "go", **more))
    assert not (tmp_path / "out").exists()


def test_routes_that_cannot_be_driven_are_named(tmp_path: Path) -> None:
    for more, message in (
        ({"town": "eu_smal_a"}, r"short\.xml, route 0: no town 'eu_smal_a'\. Did you mean 'eu_small_a'"),
        ({"ends": [(5000.0, 0.0), (0.0, 0.0)]}, r"short\.xml, route 0: .*5000"),
    ):
        made = config(tmp_path, "go")
        route_file(tmp_path, 1, **more)
        with pytest.raises(RouteError, match=message):
            evaluate(made)
        assert not made.out.exists()


@pytest.mark.parametrize(
    ("kind", "message"), [("DynamicObjectCrosing", "Did you mean"), ("DynamicObjectCrossing", "no parameter 'dist'")]
)
def test_hazards_that_cannot_be_made_are_named_before_the_first_drive(tmp_path: Path, kind: str, message: str) -> None:
    made = config(tmp_path, "go")
    path = Path(made.routes)
    x, y = straight_ends()[0]
    trigger = f'<trigger_point x="{x}" y="{y}" z="0" yaw="0"/><dist value="12"/>'
    hazard = f'<scenarios><scenario name="a" type="{kind}">{trigger}</scenario></scenarios>'
    path.write_text(path.read_text().replace("</waypoints>", f"</waypoints>{hazard}"))
    with pytest.raises(RouteError, match=rf"short\.xml, route 0: .*{message}"):
        evaluate(made)
    assert not made.out.exists()


def test_a_folder_with_a_run_is_kept_without_overwrite(tmp_path: Path) -> None:
    evaluate(config(tmp_path, "no-setup"))
    before = (tmp_path / "out" / "results.json").read_bytes()
    with pytest.raises(OutputError, match="already holds a run"):
        evaluate(config(tmp_path, "no-setup"))
    assert (tmp_path / "out" / "results.json").read_bytes() == before
    evaluate(config(tmp_path, "no-setup", overwrite=True))


SPEED = {"type": "sensor.speedometer", "id": "speed"}
MAP = {"type": "sensor.opendrive_map", "id": "map"}
LIDAR = {"type": "sensor.lidar.ray_cast", "id": "lidar", "x": 0.0, "y": 0.0, "z": 3.0}


@pytest.mark.parametrize(
    ("sensors", "track", "wrong"),
    [
        ([SPEED, LIDAR], Track.SENSORS, None),
        ([SPEED, MAP], Track.MAP, None),
        ([SPEED, MAP], Track.SENSORS, "not allowed on track SENSORS"),
        ([{**LIDAR, "x": 0.1}], Track.SENSORS, r"3\.00 m from the ego, 3\.0 m at most"),
        ([SPEED, {**LIDAR, "id": "speed"}], Track.SENSORS, "two sensors have the id 'speed'"),
        ([{"type": "sensor.speedometer"}], Track.SENSORS, "without type or id"),
        (
            [{**LIDAR, "attributes": {"channels": 32}}],
            Track.SENSORS,
            "'lidar': its attributes are fixed on track SENSORS",
        ),
        ([{**LIDAR, "attributes": {"channels": 32}}], Track.PRIVILEGED, None),
        ([{"type": "sensor.lavsim.truth", "id": "t"}], Track.PRIVILEGED, None),
        ([{"type": "sensor.camera.depth", "id": "d"}], Track.MAP, "not allowed on track MAP"),
    ],
)
def test_sensors_are_held_to_the_track(sensors: list[dict[str, Any]], track: Track, wrong: str | None) -> None:
    if wrong is None:
        check_sensors(sensors, track, None, V1)
        return
    with pytest.raises(AgentFailure, match=wrong):
        check_sensors(sensors, track, None, V1)


def test_sensor_limits_go_by_generation_and_track() -> None:
    two = [LIDAR, {**LIDAR, "id": "other"}]
    check_sensors(two, Track.SENSORS, "SENSORS", V20)
    for track, expected, rules in (
        (Track.SENSORS, None, V1),
        (Track.SENSORS_QUALIFIER, None, V20),
        (Track.SENSORS, "MAP", V20),
    ):
        with pytest.raises(AgentFailure):
            check_sensors(two, track, expected, rules)


@pytest.mark.parametrize("rules", ["1.0", "2.1"])
def test_the_expert_drives_under_either_generation(tmp_path: Path, rules: str) -> None:
    run = evaluate(config(tmp_path, "go", agent="agents.behavior:BehaviorAgent", agent_config=None, rules=rules))
    assert statuses(run) == ["Completed" if rules == "1.0" else "Perfect"]


def without_clock_of_run(run: Run) -> dict[str, Any]:
    content = json.loads((run.folder / "run.json").read_text())
    del content["config"]["out"]
    for drive in content["drives"]:
        for key in ("setup_seconds", "drive_seconds", "real_time_factor", "step_ms"):
            del drive[key]
    return dict(content)


def same(first: Run, second: Run) -> bool:
    logs = [sorted(path.read_bytes() for path in (run.folder / "logs").glob("*.lavlog")) for run in (first, second)]
    return (
        without_clock(first) == without_clock(second)
        and without_clock_of_run(first) == without_clock_of_run(second)
        and logs[0] == logs[1]
    )


def steady(folder: Path, count: int, **more: Any) -> EvaluationConfig:
    """A run of an agent that keeps no state between drives."""
    agent = str(AGENT.with_name("steady_agent.py"))
    return config(folder, "", count, **({"agent": agent, "agent_config": None} | more))


def test_workers_drive_what_one_process_drives(tmp_path: Path) -> None:
    alone = evaluate(steady(tmp_path, 4))
    seen: list[Progress] = []
    together = evaluate(steady(tmp_path, 4, out=tmp_path / "two", workers=2), seen.append)
    assert same(alone, together)
    assert max(p.share for p in seen) == 1.0


def test_workers_begin_with_the_longest_routes(tmp_path: Path) -> None:
    seen: list[Progress] = []
    together = evaluate(steady(tmp_path, 4, workers=2), seen.append)
    begun = list(dict.fromkeys(p.name for p in seen))
    lengths = {entry["name"]: entry["keypoint_length"] for entry in together.run["drives"]}
    assert min(lengths[name] for name in begun[:2]) >= max(lengths[name] for name in begun[2:])


def test_a_run_cut_short_goes_on_and_ends_with_the_same_files(tmp_path: Path) -> None:
    whole = evaluate(steady(tmp_path, 3))

    def stop(progress: Progress) -> None:
        if progress.done == 1 and progress.completion > 20.0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate(steady(tmp_path, 3, out=tmp_path / "cut"), stop)
    cut = Run.load(tmp_path / "cut")
    assert len(cut.records) == 1
    half = cut.folder / "drives" / "RouteScenario_1_rep0.json.4711.partial"
    half.write_text("{")  # what a kill in the middle of writing leaves
    seen: list[Progress] = []
    resumed = evaluate(steady(tmp_path, 3, out=tmp_path / "cut", resume=True), seen.append)
    assert min(p.done for p in seen) == 1, "the drive done is not driven again"
    assert not half.exists()
    assert same(whole, resumed)


def test_a_run_is_resumed_as_it_was_begun_or_not_at_all(tmp_path: Path) -> None:
    evaluate(steady(tmp_path, 1))
    with pytest.raises(OutputError, match="begun with seed = 0, not 3"):
        evaluate(steady(tmp_path, 1, resume=True, seed=3))
    with pytest.raises(ConfigError, match="give one of them"):
        steady(tmp_path, 1, resume=True, overwrite=True)


def test_resuming_in_an_empty_folder_begins(tmp_path: Path) -> None:
    assert statuses(evaluate(steady(tmp_path, 1, resume=True))) == ["Completed"]


@pytest.mark.slow
def test_a_cluster_drives_what_one_process_drives(tmp_path: Path) -> None:
    ray = pytest.importorskip("ray")
    alone = evaluate(steady(tmp_path, 3))
    try:
        together = evaluate(steady(tmp_path, 3, out=tmp_path / "cluster", cluster="local"))
    finally:
        ray.shutdown()
    assert same(alone, together)
