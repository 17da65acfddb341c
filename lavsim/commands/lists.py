"""What there is: towns, agents, sensors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from lavsim.commands.base import AsJson, TownPath, app, print_findings, print_list, summary_of, towns_at
from lavsim.errors import LavsimError, OutputError


@app.command()
def towns(
    check: Annotated[
        Path | None,
        typer.Option("--check", help="An OpenDRIVE file: say what is wrong in it; exit code 2 if anything."),
    ] = None,
    town_path: TownPath = None,
    as_json: AsJson = False,
) -> int:
    """List the towns there are, or check a road network of one's own."""
    if check is not None:
        from lavsim.map.check import check_file

        if not check.is_file():
            raise OutputError(f"there is no file {str(check)!r} to check.")
        return print_findings(str(check), check_file(check), as_json)
    from lavsim.map.town_files import load_town, town_names
    from lavsim.towns.facts import facts_of
    from lavsim.types import LaneType

    search = towns_at(town_path)
    entries: list[dict[str, Any]] = []
    for name in town_names(search):
        facts = facts_of(name)
        try:
            town = load_town(name, search)
        except LavsimError as error:
            entries.append({"name": name, "error": str(error)})
            continue
        driving = town.lanes.where(LaneType.DRIVING)
        entries.append(
            {
                "name": name,
                "split": facts.split if facts else "",
                "road_km": round(sum(road.length for road in town.network.roads if road.junction < 0) / 1000.0, 2),
                "lane_km": round(float(town.lanes.length[driving].sum()) / 1000.0, 2),
                "junctions": len(town.junctions),
                "lights": len(town.lights),
                "vehicles": facts.vehicles if facts else "",
                "layout": facts.layout if facts else "",
                "digest": town.digest,
            }
        )
    if as_json:
        print_list(entries, True)
    else:
        print_list([{key: value for key, value in entry.items() if key != "digest"} for entry in entries], False)
    return 0


@app.command()
def agents(as_json: AsJson = False) -> None:
    """List the agents that ship."""
    from lavsim.agent_source import packaged_agents

    print_list([{"agent": target, "summary": summary} for target, summary in packaged_agents()], as_json)


@app.command()
def sensors(as_json: AsJson = False) -> None:
    """List the sensors an agent may ask for."""
    from lavsim.sensors.base import SENSORS

    print_list(
        [
            {"type": str(key), "privileged": bool(SENSORS[key].privileged), "summary": summary_of(SENSORS[key])}
            for key in SENSORS
        ],
        as_json,
    )
