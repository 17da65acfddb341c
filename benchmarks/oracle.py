"""How far lavsim's map answers lie from CARLA's own, in figures.

`python benchmarks/oracle.py`: needs `maps/carla` and `maps/oracle` in LAVSIM_SHARED or in `shared` beside the checkout.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.types import LaneType
from tests.map.shared import MAPS, oracle

TYPES = {"Driving": 2, "Shoulder": 8, "Sidewalk": 32, "Parking": 256, "Any": -2}


def turned(a: float, b: float) -> float:
    """Angle between headings [deg]."""
    return abs((a - b + 180.0) % 360.0 - 180.0)


def waypoints(town: TownMap, answers: Any) -> None:
    """Poses, widths and neighbours at file coordinates."""
    rows = answers["waypoints"] + answers["lane_samples"]
    figures = []
    table = []
    for x, y, z, yaw, road, section, lane_id, s, width in (row[:9] for row in rows):
        lane = town.lane_index(road, section, lane_id)
        here, carla = town.exact(lane, s), town.exact(lane, s, carla_yaw=True)
        on_table = town.centre(lane, town.lanes.u_of_s(lane, s))[0]
        figures.append(
            (
                float(np.sqrt((here[0] - x) ** 2 + (here[1] - y) ** 2 + (here[2] - z) ** 2)),
                turned(np.degrees(here[3]), yaw),
                turned(np.degrees(carla[3]), yaw),
                abs(here[4] - width),
            )
        )
        table.append(float(np.hypot(on_table[0] - x, on_table[1] - y)))
    position, yaw, carla_yaw, width = np.max(figures, axis=0)
    print(f"  {len(rows)} waypoints: position {position:.2e} m, width {width:.1e} m")
    print(f"    yaw {yaw:.2e} deg (with CARLA's formula {carla_yaw:.2e}); lane table {max(table):.2e} m")


def projections(town: TownMap, answers: Any) -> None:
    """Nearest lanes, by chords as CARLA does and by our own query."""
    for name, query in (("by chords", town.project), ("nearest", town.nearest)):
        same, off, refused, cases = 0, [], 0, []
        for px, py, pz, kind, project, x, y, z, _, road, section, lane_id, s in (
            r[:13] for r in answers["projections"]
        ):
            hit = query([[px, py, pz]], TYPES[kind])
            if road is None:
                refused += town.carla_waypoint((px, py, pz), bool(project), TYPES[kind]) is None
                continue
            lane = town.lane_index(road, section, lane_id)
            theirs = float(np.sqrt((px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2))
            if hit.lane[0] == lane:
                same += 1
                off.append(abs(hit.s[0] - s))
            else:
                cases.append(f"({px}, {py}) {kind}: ours {hit.distance[0]:.4f} m away, CARLA's {theirs:.4f} m")
        beyond = int((np.array(off) > 0.2).sum())
        print(
            f"  projections {name}: {same} of {same + len(cases)} same lane, s within {max(off):.2e} m "
            f"({beyond} beyond 0.2), {refused} none as in CARLA"
        )
        for case in cases:
            print(f"    {case}")


def steps(town: TownMap, answers: Any) -> None:
    """`next` and `previous` at 10 m, and the topology."""
    same, off = 0, [0.0]
    for record in answers["next"]:
        road, section, lane_id, s = record["from"]
        lane = town.lane_index(road, section, lane_id)
        here = town.waypoint_at(lane, town.lanes.u_of_s(lane, s))
        for found, expected in ((here.next(10.0), record["next"]), (here.previous(10.0), record["previous"])):
            ours = sorted((w.road_id, w.section_id, w.lane_id, w.s, w.x, w.y) for w in found)
            theirs = sorted((*row[4:8], row[0], row[1]) for row in expected)
            same += [row[:3] for row in ours] == [row[:3] for row in theirs]
            off += [float(np.hypot(a[4] - b[4], a[5] - b[5])) for a, b in zip(ours, theirs, strict=True)]
    print(f"  next and previous: {same} of {2 * len(answers['next'])} same lanes, within {max(off):.2e} m")
    lanes = town.lanes
    total = sum(max(1, len(lanes.successors(int(k)))) for k in lanes.where(int(LaneType.DRIVING)))
    there = 0
    for row in answers["topology"]:
        pair = dict(zip(answers["topology_columns"], row, strict=True))
        entry, leave = (
            town.lane_index(pair[f"{end}_road"], pair[f"{end}_section"], pair[f"{end}_lane"])
            for end in ("entry", "exit")
        )
        there += leave in lanes.successors(entry)
    print(f"  topology: {there} of {len(answers['topology'])} pairs, {total} of {answers['topology_total']} in all")


def landmarks(town: TownMap, answers: Any) -> None:
    """All landmarks and those ahead."""
    same = 0
    for query in answers["landmarks_ahead"]:
        road, section, lane_id, s = query["from"]
        lane = town.lane_index(road, section, lane_id)
        here = town.waypoint_at(lane, town.lanes.u_of_s(lane, s))
        found = here.landmarks(query["distance"], query["stop_at_junction"])
        ours = sorted((m.id, m.type, m.road_id, round(m.distance, 2)) for m in found)
        same += ours == sorted((i, t, road, round(d, 2)) for i, t, d, road, _ in query["found"])
    known = {(m.id, m.type, m.road_id, round(m.s, 2)) for m in town.landmarks}
    listed = sum((m["id"], m["type"], m["road_id"], round(m["s"], 2)) in known for m in answers["landmarks"])
    print(
        f"  landmarks: {len(town.landmarks)} of {answers['landmarks_total']}, {listed} of {len(answers['landmarks'])} "
        f"samples; ahead: {same} of {len(answers['landmarks_ahead'])} answers the same"
    )


def main() -> None:
    """Prints the figures of both towns."""
    for name in ("Town02", "Town10HD"):
        town, answers = load_town(name, [MAPS]), oracle(name)
        print(f"{name} against carla {answers['carla_version']}")
        waypoints(town, answers)
        projections(town, answers)
        steps(town, answers)
        landmarks(town, answers)


if __name__ == "__main__":
    main()
