"""A real town by the path of its OpenDRIVE file: what is wrong in it, its picture, and routes through it."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

from lavsim.map.check import check_file
from lavsim.map.town_files import load_town
from lavsim.render.birdseye import draw_town
from lavsim.render.canvas import write_png
from leaderboard.route_maker import RouteWish, make_routes
from leaderboard.route_writer import write_routes


def main(arguments: Sequence[str] | None = None) -> int:
    """Imports a file; without one, a bundled town stands in for what you would download."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/import-town"))
    parser.add_argument("--xodr", type=Path, help="the file: CARLA's Town01.xodr, or one exported from a map")
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.xodr
    if path is None:
        path = given.out / "my_town.xodr"
        path.write_bytes((resources.files("lavsim.towns") / "eu_small_a.xodr").read_bytes())
    for finding in check_file(path):
        print(finding)
    town = load_town(path.stem, (path.parent,))  # any folder on the search path, the file's name is the town's
    write_png(draw_town(town).image, given.out / f"{town.name}.png")
    routes = make_routes(town, RouteWish(count=2, shortest=100.0, longest=600.0))
    (given.out / "routes.xml").write_bytes(write_routes(routes, "lav"))
    print(f"{town.name}: {len(town.lanes.length)} lanes, {len(town.lights)} traffic lights, {len(routes)} routes")
    print(f"lavsim score --routes {given.out / 'routes.xml'} --town-path {path.parent} --agent agents.behavior")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
