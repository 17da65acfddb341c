"""The file with which a user's own hazard begins."""

from __future__ import annotations

import re
from pathlib import Path

from lavsim.errors import OutputError, ScenarioError

_TEXT = '''"""A {words}: somebody runs across the ego's lane."""

from dataclasses import dataclass

from lavsim.geometry import right
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import cross, wait
from lavsim.scenarios.place import Site, along_lane, aside, kerb, to_junction
from lavsim.types import Role


@dataclass(frozen=True)
class {name}Config:
    distance: float = 30.0  # [m] from the trigger to where it crosses
    speed: float = 2.0  # [m/s]


@SCENARIOS.register(("2.x", "{name}"))
class {name}(Scenario):
    """A walker runs across when the ego would be there within 2 s or is nearer than 8 m."""

    Config = {name}Config

    def fits(self, site: Site) -> str | None:
        free = to_junction(site.anchor)
        return "a junction is too near" if free < self.config.distance + 5.0 else None

    def place(self, stage: Stage) -> None:
        self.crossing, _ = along_lane(stage.anchor, self.config.distance)
        reach = kerb(self.crossing, "right") + 0.8
        self.way, self.length = -right(self.crossing.yaw), 2.0 * reach
        spot = aside(self.crossing, reach)
        self.walker = self.spawn(stage, "walker.pedestrian.0002", spot, self.crossing.yaw, Role.SCENARIO)

    def script(self, stage: Stage) -> Script:
        yield from wait.until_arrival(stage.world.ego, self.crossing.xy, within=2.0, near=8.0)
        yield from cross.walk(self.walker, self.way, self.config.speed, self.length)
        yield from wait.driven(stage.world.ego, 20.0)
'''


def skeleton(name: str) -> str:
    """A hazard that runs as it is, to be changed.

    Raises:
        ScenarioError: `name` can't name a class.
    """
    if not re.fullmatch(r"[A-Z][A-Za-z0-9_]*", name):
        raise ScenarioError(f"--new: a hazard is named like RollingBin, got {name!r}.")
    words = re.sub(r"(?<!^)(?=[A-Z])", " ", name).lower()
    return _TEXT.format(name=name, words=words)


def write_skeleton(name: str, folder: Path) -> Path:
    """Writes the file of a new hazard into `folder`.

    Raises:
        OutputError: there is no such folder, or the file is there already.
    """
    text = skeleton(name)
    file = folder / (re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower() + ".py")
    if not folder.is_dir():
        raise OutputError(f"there is no folder {str(folder)!r} to write {file.name} into.")
    if file.exists():
        raise OutputError(f"{file} is there already.")
    file.write_text(text, encoding="utf-8")
    return file
