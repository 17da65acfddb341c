"""A run made without driving: its logs hold an ego that slides along its route."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np

from lavsim.log.writer import LogWriter
from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town
from leaderboard.config import EvaluationConfig
from leaderboard.criteria.base import Infraction
from leaderboard.record import Results, write_run
from leaderboard.rules import get_rules
from leaderboard.run import LOGS, PICTURES, Run
from leaderboard.score import plain_rates, record_of
from tests.leaderboard.worlds import ego_at

TOWN = "eu_small_a"


def keypoints(number: int = 0, length: float = 300.0) -> np.ndarray:
    """(2, 3) ends of a drive of about `length` m in the bundled town."""
    town = load_town(TOWN)
    lane = [k for k in range(len(town.lanes.length)) if town.lanes.type[k] == 2 and town.lanes.junction[k] < 0][number]
    here = town.waypoint_at(lane, 1.0)
    there = here
    for _ in range(int(length / 5.0)):
        there = (there.next(5.0) or [there])[0]
    return np.array([[w.x, w.y, w.z] for w in (here, there)])


def make_run(folder: Path, agent: str = "agents.example:Agent", route_id: str = "0", rules: str = "1.0") -> Run:
    """Three drives: one clean, one with infractions, one that the agent lost."""
    (folder / LOGS).mkdir(parents=True)
    (folder / PICTURES).mkdir()
    found = [
        Infraction("collisions_vehicle", 120, (0.0, 0.0, 0.0), "Agent collided against object with type=vehicle.<b>"),
        Infraction("red_light", 240, (0.0, 0.0, 0.0), "Agent ran a red light 7 at (x=1.0, y=2.0, z=0.0)"),
    ]
    plans: list[tuple[float, list[Infraction], str | None]] = [
        (100.0, [], None),
        (100.0, found, None),
        (41.5, [], "Agent crashed"),
    ]
    made = Results(get_rules(rules), len(plans), sensors=("carla_camera",), finished=True)
    drives = []
    for index, (percent, infractions, failure) in enumerate(plans):
        name = f"RouteScenario_{index}_rep0"
        points = keypoints(3 * index)
        infractions, ticks = _log(folder / LOGS / f"{name}.lavlog", points, percent, infractions)
        record = record_of(
            index=index,
            route_id=f"RouteScenario_{index}",
            completion=percent,
            reached=percent == 100.0,
            infractions=infractions,
            failure=failure,
            route_length=300.0,
            duration_game=ticks * 0.05,
            duration_system=2.5,
            rules=get_rules(rules),
        )
        made = made.with_record(record)
        cv2.imwrite(str(folder / PICTURES / f"{name}.png"), np.full((90, 320, 3), 60 + 40 * index, np.uint8))
        drives.append(
            {
                "index": index,
                "name": name,
                "route": route_id if index == 0 else str(index),
                "repetition": 0,
                "town": TOWN,
                "seed": 0,
                "traffic": "lav",
                "agent_message": "run_step raised ValueError: <script>alert(1)</script>" if failure else None,
                "infractions": [i.to_json() for i in infractions],
                "dense_length": 301.5,
                "real_time_factor": 7.25,
                "log": f"{LOGS}/{name}.lavlog",
                "picture": f"{PICTURES}/{name}.png",
            }
        )
    made.write(folder)
    config = EvaluationConfig.of(agent=agent, routes="devtest", rules=rules)
    run: dict[str, Any] = {"config": config.model_dump(mode="json"), "rules": rules, "seed": 0, "drives": drives}
    run |= {"kilometres": 0.72, "infractions_per_km": plain_rates(made.records, 0.72, get_rules(rules))}
    write_run(folder, run | {"benchmark_id": "0123456789abcdef", "track": "PRIVILEGED", "versions": {"lavsim": "0"}})
    return Run.load(folder)


def _log(path: Path, points: np.ndarray, percent: float, found: list[Infraction]) -> tuple[list[Infraction], int]:
    route = get_planner(load_town(TOWN)).trace(points)
    header = {"town": TOWN, "keypoints": points.tolist(), "seed": 0}
    writer = LogWriter(path)
    writer.start(SimpleNamespace(header=lambda: header))  # type: ignore[arg-type]
    end, at, tick, places = route.length * percent / 100.0, 0.0, 0, {}
    while at < end:
        speed = 8.0 + 3.0 * np.sin(at / 25.0)
        k = int(np.searchsorted(route.distance, at))
        places[tick] = (float(route.points[k, 0]), float(route.points[k, 1]), 0.0)
        x, y = places[tick][0], places[tick][1] + 0.5 * np.sin(at / 9.0)
        writer.observe(ego_at(x, y, tick=tick, speed=speed, yaw=float(route.yaw[k])))
        at += speed * 0.05
        tick += 1
    writer.finish(SimpleNamespace(summary=dict))  # type: ignore[arg-type]
    return [replace(i, position=places[min(i.tick, tick - 1)]) for i in found], tick
