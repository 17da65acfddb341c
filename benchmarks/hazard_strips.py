"""Film strips of hazards: six pictures each, from when the ego comes near to the end, into `docs/pictures/hazards`.

`python benchmarks/hazard_strips.py` draws every hazard of a route file once, seen from above, with an ego that keeps to
its route at 8 m/s, slower in bends, and looks at nobody; `--types` chooses some, `--out` another folder. Those of 1.0:
`python -m benchmarks.hazard_strips --routes routes/hazards.xml --types Scenario1,Scenario2,…`
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import to_local
from lavsim.map.route import RouteTracker
from lavsim.render.birdseye import draw_snapshot
from lavsim.render.canvas import write_text
from lavsim.render.scene import get_scene
from lavsim.scenarios.moves.meeting import calm_pace
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import ActorIds, Control
from lavsim.world.snapshot import Snapshot
from leaderboard.routes import RouteEntry, read_routes

ROUTES = Path("tests/scenarios/every_type.xml")
SIZE, METRES = (176, 200), 44.0  # [px] of a picture, [m] of road in its width
COUNT, GAP, QUALITY = 6, 3, 56
SPEED, NEAR, LONGEST = 8.0, 34.0, 900  # [m/s], [m] of the ego from an actor of the hazard, ticks
LOOKS = 30.0  # [m] of bends ahead for which it slows down
AFTER = 30  # ticks shown after a contact or after the end
WITH_TRAFFIC = ("HardBreakRoute", "Scenario7", "Scenario8", "Scenario9")  # types that act through background vehicles


def drive(entry: RouteEntry) -> tuple[Simulation, list[Snapshot]]:
    """The drive's snapshots from the trigger to a while after the hazard's end, or after a contact."""
    traffic = "leaderboard" if entry.scenarios[0].type in WITH_TRAFFIC else "empty"
    generation = entry.scenarios[0].generation
    simulation = Simulation(
        DriveSpec(
            entry.town,
            entry.id,
            entry.keypoints,
            entry.weather,
            entry.scenarios,
            traffic=traffic,
            generation=generation,
        )
    )
    tracker, shown, left = RouteTracker(simulation.route, 8), list[Snapshot](), AFTER
    for _ in range(LONGEST):
        snapshot = simulation.tick(_control(simulation, tracker))
        if len(snapshot.hazards):
            shown.append(snapshot)
        if shown and (not len(snapshot.hazards) or _hurt(snapshot) or left < AFTER):
            left -= 1
        if not left or tracker.metres() > simulation.route.length - 3.0:
            break
    return simulation, shown


def _control(simulation: Simulation, tracker: RouteTracker) -> Control:
    ego, route = simulation.snapshot.ego, simulation.route
    aim = route.xy[min(tracker.update(ego.xy) + 5, len(route) - 1)] - ego.xy
    angle = (np.arctan2(aim[1], aim[0]) - ego.yaw + np.pi) % (2.0 * np.pi) - np.pi
    steer = float(np.clip(1.5 * angle, -1.0, 1.0))
    pace = float(calm_pace(route, tracker.metres(), tracker.metres() + LOOKS)[0])
    if not len(simulation.snapshot.hazards) and _is_behind_someone(simulation.snapshot):
        return Control(brake=0.6, steer=steer)  # the drive to the trigger is a good one
    excess = ego.speed - min(SPEED, pace)
    return Control(0.75 if excess < 0.0 else 0.0, steer, 0.3 if excess > 0.5 else 0.0)


def _is_behind_someone(snapshot: Snapshot) -> bool:
    local = to_local(snapshot.xy[1:], snapshot.ego.xy, snapshot.ego.yaw)
    reach = 8.0 + snapshot.ego.speed**2 / 6.0
    return bool(((local[:, 0] > 0.0) & (local[:, 0] < reach) & (np.abs(local[:, 1]) < 1.5)).any())


def _hurt(snapshot: Snapshot) -> bool:
    return any(ActorIds.EGO in (c["a"], c["b"]) for c in snapshot.contacts)


def _is_near(snapshot: Snapshot) -> bool:
    others = snapshot.xy[snapshot.ids >= ActorIds.SCENARIOS]
    return len(others) > 0 and float(np.hypot(*(others - snapshot.ego.xy).T).min()) < NEAR


def draw(entry: RouteEntry) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 blue, green, red: the strip of one hazard."""
    simulation, shown = drive(entry)
    scene = get_scene(simulation.town)
    first = next((k for k, snapshot in enumerate(shown) if _is_near(snapshot)), 0)
    picks = np.rint(np.linspace(first, len(shown) - 1, COUNT)).astype(int)
    pictures = []
    for k in picks.tolist():
        picture = draw_snapshot(scene, shown[k], SIZE, METRES).image
        write_text(picture, f"{(shown[k].tick - shown[0].tick) * 0.05:.1f} s", (4, 14))
        pictures += [picture, np.full((SIZE[1], GAP, 3), 255, np.uint8)]
    return np.concatenate(pictures[:-1], axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--routes", type=Path, default=ROUTES)
    parser.add_argument("--types", help="with commas; all by default")
    parser.add_argument("--out", type=Path, default=Path("docs/pictures/hazards"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    drawn = set()
    for entry in read_routes(options.routes):
        kind = entry.scenarios[0].type
        if kind not in drawn and (options.types is None or kind in options.types.split(",")):
            drawn.add(kind)
            path = options.out / f"{kind}.jpg"
            cv2.imwrite(str(path), draw(entry), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
            print(f"{path}  {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
