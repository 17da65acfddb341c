"""How large a long replay is, how fast it opens and plays: ten minutes with 150 actors in headless Chromium.

python benchmarks/replay.py [LOG]          another log instead of the drive that it makes (about two minutes)
python benchmarks/replay.py --panes LOG    with the cameras and the LiDAR
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from pathlib import Path

from agents.behavior import BehaviorAgent
from lavsim.agent import plan_of
from lavsim.agent_runner import InProcessAgent
from lavsim.episode import run_episode
from lavsim.log.writer import LogWriter
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import DriveSpec, Simulation
from leaderboard.routes import read_routes
from leaderboard.show import Wish, show_log

TOWN, VEHICLES, TICKS = "us_large_a", 149, 12_000
PLAYED = 8.0  # [s] that are played for the figure


def drive(path: Path) -> None:
    """Ten minutes of the longest route that trains in the town; once there, the ego stands."""
    entry = max((e for e in read_routes("training") if e.town == TOWN), key=lambda e: e.length)
    spec = DriveSpec(TOWN, "long", entry.keypoints, seed=3, traffic="lav", vehicles=VEHICLES, walkers=0, parked=0.0)
    simulation = Simulation(spec)
    agent = InProcessAgent(BehaviorAgent)
    agent.start(plan_of(simulation.route, simulation.town))
    suite = SensorSuite(get_scene(simulation.town), agent.sensors(), simulation.draws)
    run_episode(simulation, agent, [LogWriter(path)], suite, max_ticks=TICKS)


def measure(page: Path) -> dict[str, float]:
    """Seconds until the first whole picture, and pictures a second at single and fourfold speed."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        window = browser.new_page(viewport={"width": 1280, "height": 800})
        begun = time.perf_counter()
        window.goto(page.resolve().as_uri())
        while not window.evaluate("!!window.replay && replay.state().isSettled"):
            time.sleep(0.01)
        found = {"open_s": time.perf_counter() - begun}
        play = """async ([speed, time]) => {
            const player = replay.player;
            player.speed = speed;
            player.toggle();
            await new Promise((resolve) => setTimeout(resolve, 1000));
            const [frames, begun] = [player.frames, performance.now()];
            await new Promise((resolve) => setTimeout(resolve, time * 1000));
            const rate = (player.frames - frames) / (performance.now() - begun) * 1000;
            player.toggle();
            return rate;
        }"""
        for speed in (1, 4):
            found[f"frames_per_s_at_{speed}x"] = window.evaluate(play, [speed, PLAYED])
        browser.close()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path, nargs="?")
    parser.add_argument("--panes", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        log = arguments.log or Path(folder) / "long.lavlog"
        if arguments.log is None:
            drive(log)
        page = Path(folder) / "replay.html"
        begun = time.perf_counter()
        show_log(log, Wish(html=page, panes=arguments.panes))
        print(f"{'write_s':22} {time.perf_counter() - begun:.2f}")
        print(f"{'size_mb':22} {page.stat().st_size / 1e6:.2f}")
        for name, value in measure(page).items():
            print(f"{name:22} {value:.2f}")


if __name__ == "__main__":
    main()
