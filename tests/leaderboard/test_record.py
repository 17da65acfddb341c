"""The results file, against the layout of the originals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from leaderboard.record import Results, sensor_icons
from leaderboard.rules import RULES
from leaderboard.score import RouteRecord
from tests.leaderboard.test_score import RUNS, WORKED, record

GOLDEN = """{
    "_checkpoint": {
        "global_record": {
            "index": -1,
            "infractions": {
                "collisions_layout": 0.0,
                "collisions_pedestrian": 0.0,
                "collisions_vehicle": 0.0,
                "outside_route_lanes": 0.0,
                "red_light": 1.0,
                "route_dev": 0.0,
                "route_timeout": 0.0,
                "stop_infraction": 0.0,
                "vehicle_blocked": 0.0
            },
            "meta": {
                "duration_game": 10.0,
                "duration_system": 1.0,
                "total_length": 1000
            },
            "route_id": -1,
            "scores": {
                "score_composed": 70.0,
                "score_penalty": 0.7,
                "score_route": 100.0
            },
            "scores_std_dev": {
                "score_composed": null,
                "score_penalty": null,
                "score_route": null
            },
            "status": "Completed"
        },
        "progress": [
            1,
            1
        ],
        "records": [
            {
                "index": 0,
                "infractions": {
                    "collisions_layout": [],
                    "collisions_pedestrian": [],
                    "collisions_vehicle": [],
                    "outside_route_lanes": [],
                    "red_light": [
                        "red"
                    ],
                    "route_dev": [],
                    "route_timeout": [],
                    "stop_infraction": [],
                    "vehicle_blocked": []
                },
                "meta": {
                    "duration_game": 10.0,
                    "duration_system": 1.0,
                    "route_length": 1000
                },
                "route_id": "RouteScenario_0",
                "scores": {
                    "score_composed": 70.0,
                    "score_penalty": 0.7,
                    "score_route": 100
                },
                "status": "Completed"
            }
        ]
    },
    "eligible": true,
    "entry_status": "Finished",
    "labels": [
        "Avg. driving score",
        "Avg. route completion",
        "Avg. infraction penalty",
        "Collisions with pedestrians",
        "Collisions with vehicles",
        "Collisions with layout",
        "Red lights infractions",
        "Stop sign infractions",
        "Off-road infractions",
        "Route deviations",
        "Route timeouts",
        "Agent blocked"
    ],
    "sensors": [
        "carla_camera",
        "carla_speedometer"
    ],
    "values": [
        "70.000",
        "100.000",
        "0.700",
        "0.000",
        "0.000",
        "0.000",
        "1.000",
        "0.000",
        "0.000",
        "0.000",
        "0.000",
        "0.000"
    ]
}"""


def results(name: str, version: str, *, total: int | None = None, finished: bool = True) -> Results:
    rules = RULES[version]
    rows = RUNS[name]
    made = Results(rules, len(rows) if total is None else total, finished=finished)
    for index, row in enumerate(rows):
        made = made.with_record(record(row, rules, index))
    return made


def test_file_of_1_0_to_the_byte(tmp_path: Path) -> None:
    rules = RULES["1.0"]
    icons = tuple(sensor_icons(["sensor.camera.rgb", "sensor.speedometer"]))
    made = Results(rules, 1, (record((1000, 100, "red", None), rules),), icons, finished=True)
    made.write(tmp_path)
    assert (tmp_path / "results.json").read_text() == GOLDEN
    replace(made, strict=True).write(tmp_path)
    assert (tmp_path / "results.json").read_text() == GOLDEN.replace("null", '"NaN"')
    assert [p.name for p in tmp_path.iterdir()] == ["results.json"]


def test_file_of_1_0_before_the_first_route() -> None:
    empty = {"_checkpoint": {"global_record": {}, "progress": [0, 4], "records": []}}
    empty |= {"labels": [], "values": [], "sensors": []}
    assert Results(RULES["1.0"], 4).to_json() == empty | {"entry_status": "Started", "eligible": False}
    assert Results(RULES["1.0"], 4, strict=True).to_json() == empty | {"entry_status": "", "eligible": ""}


def test_values_of_worked_example_9() -> None:
    first = results("W9", "1.0").to_json()
    assert " ".join(first["values"]) == ("59.000 75.000 0.680 0.000 4.000 0.000 0.000 0.000 0.000 0.000 0.000 2.000")
    second = results("W9", "2.1").to_json()
    assert " ".join(second["values"]) == ("60.416666 75.0 0.708333 0.0 1.333 0.0 0.0 0.0 0.0 0.0 0.0 0.667 0.0 0.0 0.0")
    assert second["labels"][12:] == [
        "Yield emergency vehicles infractions",
        "Scenario timeouts",
        "Min speed infractions",
    ]


@pytest.mark.parametrize(
    ("name", "version", "entry", "eligible"),
    [
        ("W2", "1.0", "Finished", True),
        ("W12", "1.0", "Finished with agent errors", True),
        ("W4", "1.0", "Finished with agent errors", True),  # blocked: the status contains "Agent"
        ("W12", "2.0", "Finished", True),
        ("W12", "2.1", "Finished", True),
    ],
)
def test_entry_status_at_the_end(name: str, version: str, entry: str, eligible: bool) -> None:
    made = results(name, version)
    assert (made.entry_status(), made.eligible()) == (entry, eligible)
    assert results(name, version, finished=False).entry_status() == "Started"
    assert not results(name, version, finished=False).eligible()


def test_entry_status_with_missing_routes_or_invalid_sensors() -> None:
    assert results("W2", "1.0", total=2).entry_status() == "Finished with missing data"
    assert not results("W2", "1.0", total=2).eligible()
    assert results("W2", "2.0", total=2).entry_status() == "Invalid"
    for version in ("1.0", "2.0"):
        row = (500, 0, "", "Agent's sensors were invalid")
        made = Results(RULES[version], 1, (record(row, RULES[version]),), finished=True)
        assert (made.entry_status(), made.eligible()) == ("Rejected", False)


def test_global_record_lists_what_failed() -> None:
    content = results("W12", "1.0").to_json()["_checkpoint"]["global_record"]
    assert content["status"] == "Failed"
    assert content["meta"]["exceptions"] == [["RouteScenario_2", 2, "Failed - Agent crashed"]]
    assert content["meta"]["total_length"] == 3500
    assert "exceptions" not in results("W2", "1.0").to_json()["_checkpoint"]["global_record"]["meta"]
    assert results("W2", "2.0").to_json()["_checkpoint"]["global_record"]["meta"]["exceptions"] == []


def test_file_of_2_x_has_its_own_keys_and_order() -> None:
    content = results("W9", "2.1").to_json()
    made: dict[str, Any] = content["_checkpoint"]["records"][1]
    assert list(made) == ["index", "route_id", "status", "num_infractions", "infractions", "scores", "meta"]
    assert made["num_infractions"] == 3
    assert list(made["infractions"])[:3] == ["collisions_layout", "collisions_pedestrian", "collisions_vehicle"]
    whole = content["_checkpoint"]["global_record"]
    assert whole["scores_mean"]["score_composed"] == 60.416666
    assert whole["scores_std_dev"]["score_composed"] == 55.979
    single = results("W1", "2.0").to_json()["_checkpoint"]["global_record"]
    assert single["status"] == "Perfect"
    assert single["scores_std_dev"]["score_composed"] == 0.0


def test_worked_examples_make_valid_json() -> None:
    for name in WORKED:
        for version in RULES:
            text = json.dumps(results(name, version).to_json(), allow_nan=False)
            assert json.loads(text)["_checkpoint"]["progress"] == [1, 1]


def test_infractions_survive_the_file() -> None:
    made = results("W9", "1.0").records[1]
    assert isinstance(made, RouteRecord)
    assert made.infractions["collisions_vehicle"] == ("veh", "veh")
