"""A hazard of one's own, a barrel in the lane, is put on a route and met by an agent that looks at nothing."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.place import Site, along_lane, aside, to_junction
from lavsim.types import Role
from leaderboard.evaluator import EvaluationConfig, evaluate

ROUTE = """<routes traffic="empty">
  <route id="0" town="eu_small_a">
    <waypoints><position x="42" y="7" z="0"/><position x="120" y="9" z="0"/></waypoints>
    <scenarios>
      <scenario name="LostBarrel_1" type="LostBarrel">
        <trigger_point x="49.5" y="7.2" z="0" yaw="1.5"/>
        <distance value="30"/>
      </scenario>
    </scenarios>
  </route>
</routes>
"""


@dataclass(frozen=True)
class LostBarrelConfig:
    """How far behind the trigger it stands [m]."""

    distance: float = 40.0


@SCENARIOS.register(("2.x", "LostBarrel"))
class LostBarrel(Scenario):
    """A barrel stands in the ego's lane."""

    Config = LostBarrelConfig

    def fits(self, site: Site) -> str | None:
        """One in a junction would be another story."""
        free = to_junction(site.anchor)
        return "a junction is too near" if free < self.config.distance + 5.0 else None

    def place(self, stage: Stage) -> None:
        """Puts it on the middle of the lane."""
        spot, _ = along_lane(stage.anchor, self.config.distance)
        self.spawn(stage, "static.prop.barrel", aside(spot, 0.0), spot.yaw, Role.PROP)

    def script(self, stage: Stage) -> Script:
        """Ends, and takes it away, 60 m on."""
        yield from wait.driven(stage.world.ego, 60.0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Drives into it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/own-hazard"))
    parser.add_argument("--agent", default="agents.baselines.constant_speed:ConstantSpeed")
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    routes = given.out / "lost_barrel.xml"
    routes.write_text(ROUTE, encoding="utf-8")
    config = EvaluationConfig.of(agent=given.agent, routes=str(routes), out=given.out / "run", overwrite=True)
    run = evaluate(config)
    found = {kind: len(told) for kind, told in run.records[0]["infractions"].items() if told}
    print(f"driving score {run.mean['score_composed']:.1f}, infractions {found}: {given.out / 'run' / 'report.html'}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
