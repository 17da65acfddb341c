"""The hazards a route file may name: list them, find places for them, begin one."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import typer

from lavsim.commands.base import AsJson, TownPath, app, print_list, summary_of, towns_at

ScenarioPath = Annotated[
    list[Path] | None, typer.Option("--scenario-path", help="Folder with your own hazards (*.py); may be given again.")
]


@app.command()
def scenarios(
    suggest: Annotated[
        tuple[str, str], typer.Option("--suggest", metavar="TOWN TYPE", help="List places in a town for a hazard.")
    ] = ("", ""),
    new: Annotated[
        str, typer.Option("--new", metavar="NAME", help="Write the file of a new hazard (RollingBin).")
    ] = "",
    count: Annotated[int, typer.Option(help="Places to list at most.")] = 20,
    scenario_path: ScenarioPath = None,
    town_path: TownPath = None,
    as_json: AsJson = False,
) -> None:
    """List the hazards a route file may name; find places for one; begin a new one."""
    from lavsim.scenarios.skeleton import write_skeleton
    from lavsim.scenarios.user_files import use_folders

    if new:
        typer.echo(write_skeleton(new, (scenario_path or [Path()])[0]))
        return
    use_folders(scenario_path or [])
    if suggest[0]:
        print_list(_places(suggest[0], suggest[1], count, towns_at(town_path)), as_json)
    else:
        print_list(_types(), as_json)


def _types() -> list[dict[str, Any]]:
    from lavsim.scenarios.base import SCENARIOS

    entries = []
    for key in SCENARIOS:
        assert isinstance(key, tuple)
        scenario = SCENARIOS[key]
        entries.append(
            {
                "type": key[1],
                "generation": key[0],
                "acts": scenario.acts,
                "summary": summary_of(scenario),
                "parameters": {f.name: f.default for f in fields(scenario.Config) if f.default is not MISSING},
            }
        )
    return entries


def _places(town_name: str, kind: str, count: int, town_path: tuple[Path, ...]) -> list[dict[str, Any]]:
    from lavsim.map.town_map import load_town
    from leaderboard.hazard_maker import find_type, stands

    town = load_town(town_name, town_path)
    generation, name = find_type(kind)
    return [
        {
            "x": round(stand.spec.trigger[0], 1),
            "y": round(stand.spec.trigger[1], 1),
            "z": round(stand.spec.trigger[2], 1),
            "yaw": round(math.degrees(stand.spec.trigger[3]) % 360.0, 1),
            "road": int(town.lanes.road_id[stand.route.lane[stand.index]]),
            "lane": int(town.lanes.lane_id[stand.route.lane[stand.index]]),
            "parameters": dict(stand.spec.parameters),
        }
        for stand in islice(stands(town, name, generation), count)
    ]
