"""Milliseconds of processor time per reading of each sensor of the LAV suite, on one core.

    python -m benchmarks.sensors [--town eu_small_a] [--vehicles 100] [--walkers 50] [--places 40] [--embree]
                                 [--llvmpipe]

The ego stands at many places of a town among vehicles on the lanes and walkers beside them; medians over the
places of the best of six readings.
Every reading is of a fresh snapshot, so nothing is remembered from another reading; placing the actors is a row of its
own. A tilted LiDAR, images by kind and the sensors that the suite lacks are measured besides. With `--embree` the same
beams and pixels are cast by Embree over the same scene as triangles (tests/meshes.py), without building it. With
`--llvmpipe` OpenGL draws tags and depth of those triangles on the processor (benchmarks/llvmpipe.py).
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Sequence
from copy import copy

import numpy as np

from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.render.frame import Mount
from lavsim.render.scene import Scene, get_scene
from lavsim.render.sheet import CAMERAS
from lavsim.render.sweep import LidarModel
from lavsim.sensors.base import SensorSuite, make_sensor
from lavsim.sensors.suites import LAV
from lavsim.types import ActorClass, LaneType, LightState
from lavsim.world.blueprints import BLUEPRINTS
from lavsim.world.snapshot import Snapshot
from tests.snapshots import EGO, Body, snapshot_of

REPEATS = 6
OTHERS: tuple[dict[str, object], ...] = (
    {"type": "sensor.lidar.ray_cast", "attributes": {"full_sweep": True}},
    {"type": "sensor.lidar.ray_cast_semantic"},
    {"type": "sensor.lavsim.lidar_raster"},
    {"type": "sensor.other.radar"},
    {"type": "sensor.lavsim.truth"},
    {"type": "sensor.lavsim.truth", "visibility": True},
)


def bodies_of(town: TownMap, vehicles: int, walkers: int) -> list[Body]:
    """Vehicles on driving lanes and walkers on the right of them, spread over the town."""
    rng = np.random.default_rng(0)
    driving = np.flatnonzero(town.lanes.type == LaneType.DRIVING)
    weight = town.lanes.length[driving] / town.lanes.length[driving].sum()
    kinds = [b for b in BLUEPRINTS.values() if b.weight > 0.0]
    share = np.array([b.weight for b in kinds]) / sum(b.weight for b in kinds)
    bodies = []
    for number in range(vehicles + walkers):
        lane = rng.choice(driving, p=weight)
        x, y, z, yaw, _ = town.centre([lane], [rng.uniform(0.0, town.lanes.length[lane])])[0]
        paint = (int(rng.integers(256)), int(rng.integers(256)), int(rng.integers(256)))
        if number < vehicles:
            kind = kinds[rng.choice(len(kinds), p=share)]
            bodies.append(Body(1_000 + number, x, y, z, yaw, kind=kind.actor_class, size=kind.size, colour=paint,
                               blueprint=kind.name, lights=int(rng.choice([0, 8, 32]))))  # fmt: skip
        else:
            x, y = x - 3.2 * np.sin(yaw), y + 3.2 * np.cos(yaw)
            bodies.append(Body(100_000 + number, x, y, z, yaw, kind=ActorClass.WALKER, size=(0.38, 0.38, 1.86),
                               colour=paint, blueprint="walker.pedestrian.0001"))  # fmt: skip
    return bodies


def snapshots_in(town: TownMap, bodies: Sequence[Body], places: int) -> list[Snapshot]:
    rng = np.random.default_rng(1)
    driving = np.flatnonzero((town.lanes.type == LaneType.DRIVING) & (town.lanes.length > 20.0))
    lights = [int(LightState.RED), int(LightState.GREEN)] * (len(town.lights) // 2 + 1)
    found = []
    for tick in range(places):
        lane = rng.choice(driving)
        x, y, z, yaw, _ = town.centre([lane], [rng.uniform(0.0, town.lanes.length[lane])])[0]
        ego = Body(EGO.id, x, y, z, yaw, role=EGO.role, size=EGO.size, colour=EGO.colour, blueprint=EGO.blueprint)
        found.append(snapshot_of([ego, *bodies], tick=tick, lights=lights[: len(town.lights)]))
    return found


def median_ms(snapshots: Sequence[Snapshot], scene: Scene, work: Callable[[Snapshot], object], placed: bool) -> float:
    """Median over the places of the best of several readings, which other work on the machine disturbs least."""
    best = np.full(len(snapshots), np.inf)
    for place, original in enumerate(snapshots):
        for snapshot in [copy(original) for _ in range(REPEATS)]:
            if placed:
                scene.actors(snapshot)
            begin = time.thread_time()
            work(snapshot)
            best[place] = min(best[place], time.thread_time() - begin)
    return float(np.median(best)) * 1e3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--town", default="eu_small_a")
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--walkers", type=int, default=50)
    parser.add_argument("--places", type=int, default=40)
    parser.add_argument("--embree", action="store_true")
    parser.add_argument("--llvmpipe", action="store_true")
    args = parser.parse_args()
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    town, draws = load_town(args.town), Draws.of_seed(0)
    scene = get_scene(town)
    snapshots = snapshots_in(town, bodies_of(town, args.vehicles, args.walkers), args.places)
    scene.actors(snapshots[0])
    first = snapshots[0].table
    snapshots = [snapshot_with(s, first) for s in snapshots]

    def show(name: str, work: Callable[[Snapshot], object], placed: bool = True) -> None:
        print(f"{name:34s} {median_ms(snapshots, scene, work, placed):7.3f} ms")

    actors = len(scene.actors(snapshots[0]).z0)
    print(
        f"{town.name}: {len(scene.statics.z0)} static solids, {args.vehicles + args.walkers} actors of {actors} solids"
    )
    show("placing the actors", scene.actors, placed=False)
    for values in LAV:
        sensor = make_sensor(values)
        show(f"{values['id']} ({values['type']})", lambda s, sensor=sensor: sensor.read([s], scene, draws))  # type: ignore[misc]
    tilted = make_sensor({"type": "sensor.lidar.ray_cast", "id": "tilted", "z": 2.4, "pitch": 2.0})
    show("LiDAR, tilted by 2 degrees", lambda s: tilted.read([s], scene, draws))
    for values in OTHERS:
        other = make_sensor({"id": "other", "z": 2.4, **values})
        show(str(values["type"]), lambda s, other=other: other.read([s], scene, draws))  # type: ignore[misc]
    for name, view in CAMERAS[1::2]:
        show(f"{name}: tags and depth", lambda s, view=view: (view.labels(s, scene), view.depth(s, scene)))  # type: ignore[misc]
        show(f"{name}: all four images", lambda s, view=view: view.render(s, scene))  # type: ignore[misc]
    suite = SensorSuite(scene, LAV, draws)
    show("the whole suite", lambda s: suite.read([s]), placed=False)
    if args.embree:
        show_embree(scene, snapshots)
    if args.llvmpipe:
        show_llvmpipe(scene, snapshots)


def show_embree(scene: Scene, snapshots: Sequence[Snapshot]) -> None:
    """Embree's time for the beams that a half sweep sends, and for the pixels of the front camera."""
    from tests.meshes import Meshes

    model, (_, view) = LidarModel(), CAMERAS[1]
    azimuth, elevation = model.azimuths(0), np.radians(np.linspace(model.upper, model.lower, model.channels))
    flat, up = np.cos(elevation), np.sin(elevation)
    beams = np.stack([np.outer(np.cos(azimuth), flat), np.outer(np.sin(azimuth), flat),
                      np.outer(np.ones(len(azimuth)), up)], axis=-1).reshape(-1, 3)  # fmt: skip
    beams = beams[np.random.default_rng(0).random(len(beams)) >= model.general_drop]
    column, row = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    focal = view.lens.focal
    rays = np.stack([np.ones_like(column), (column - view.width / 2.0) / focal, -(row - view.height / 2.0) / focal], -1)
    pixels = rays.reshape(-1, 3) / np.linalg.norm(rays.reshape(-1, 3), axis=1, keepdims=True)
    best: dict[str, list[float]] = {"half sweep by Embree": [], "front camera by Embree": []}
    for snapshot in snapshots[:10]:
        pose = Mount(z=2.4).pose(snapshot)
        meshes = Meshes(scene, snapshot, pose.origin, 130.0)
        for name, directions in zip(best, (beams @ pose.axes.T, pixels @ pose.axes.T), strict=True):
            times = []
            for _ in range(REPEATS):
                begin = time.thread_time()
                meshes.first(directions)
                times.append(time.thread_time() - begin)
            best[name].append(min(times))
    for name, times in best.items():
        print(f"{name:34s} {float(np.median(times)) * 1e3:7.3f} ms")


def show_llvmpipe(scene: Scene, snapshots: Sequence[Snapshot]) -> None:
    """OpenGL's time on the processor for tags and depth of the front camera, triangles handed over beforehand."""
    from benchmarks.llvmpipe import Picture
    from tests.meshes import Meshes

    view, shares, times = CAMERAS[1][1], [], []
    picture = Picture(view.width, view.height, view.lens.focal)
    for snapshot in snapshots[:10]:
        pose = view.mount.pose(snapshot)
        picture.load(Meshes(scene, snapshot, pose.origin, 400.0))
        seen, _ = picture.draw(pose.axes)
        ours = scene.view(snapshot, view.lens, view.mount).face
        shares.append(float(((seen > 0) == (ours >= 0)).mean()))  # as a check that both see the same
        trials = []
        for _ in range(REPEATS):
            begin = time.process_time()  # it may have threads of its own
            picture.draw(pose.axes)
            trials.append(time.process_time() - begin)
        times.append(min(trials))
    print(f"{'front camera by ' + picture.renderer[:16]:34s} {float(np.median(times)) * 1e3:7.3f} ms")
    print(f"pixels on which both see a solid or none: {float(np.mean(shares)):.3f}")


def snapshot_with(snapshot: Snapshot, table: object) -> Snapshot:
    """The same moment with a shared actor table, as ticks of one drive have it."""
    shared = copy(snapshot)
    object.__setattr__(shared, "table", table)
    return shared


if __name__ == "__main__":
    main()
