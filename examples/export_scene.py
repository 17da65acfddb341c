"""A moment of a drive as a GLB file, to be opened in Blender or any glTF viewer."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from lavsim.export_scene import scene_meshes, write_glb
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import Control
from leaderboard.routes import read_routes


def main(arguments: Sequence[str] | None = None) -> int:
    """Lets traffic drive for some seconds and writes what stands where then."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/export-scene"))
    parser.add_argument("--seconds", type=float, default=3.0)
    given = parser.parse_args(arguments)
    entry = read_routes("quick")[0]
    simulation = Simulation(DriveSpec(town=entry.town, route_id=entry.id, keypoints=entry.keypoints, traffic="lav"))
    for _ in range(round(20 * given.seconds)):
        simulation.tick(Control(brake=1.0))
    meshes = scene_meshes(simulation.town, simulation.snapshot)
    path = given.out / f"{entry.town}.glb"
    write_glb(meshes, path)
    print(f"{sum(len(mesh.faces) for mesh in meshes.values())} triangles of {len(meshes)} classes: {path}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
