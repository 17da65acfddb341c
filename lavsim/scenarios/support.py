"""Types that only mark a piece of road, or hold its lights: nothing and nobody acts against the ego."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.junctions import has_light, junction_ahead, no_light, no_turn, ways_through
from lavsim.scenarios.place import Site
from lavsim.types import LightState, RoadOption
from lavsim.world.snapshot import HAZARD_OWNS_TIMER

_LENGTH = 200.0  # [m] that the ego drives at a T
_FIRST = 5.0  # [s] of the first phase of the lights
_YELLOW = 3.0  # [s] of yellow after green
_SECOND = 10.0  # [s] of red after it
_END = 10.0  # [m] behind the junction
_TURNS = (RoadOption.LEFT, RoadOption.RIGHT)
_CHANGES = (RoadOption.CHANGELANELEFT, RoadOption.CHANGELANERIGHT)


@dataclass(frozen=True)
class SupportConfig:
    """Nothing to choose."""


class Support(Scenario):
    """What support types share.

    Class attributes:
        phases: Whether the ego's light is green in the first 5 s and from then on; None: lights are left alone.
        turns: Whether the route should turn.
        further: Metres behind the junction to which it lasts.
    """

    Config = SupportConfig
    acts = False
    phases: ClassVar[tuple[bool, bool] | None] = None
    turns: ClassVar[bool] = True
    further: ClassVar[float] = _END

    def fits(self, site: Site) -> str | None:
        return "the route crosses no junction after it" if junction_ahead(site) is None else None

    def suits(self, site: Site) -> str | None:
        reason = self.fits(site) or (no_turn(site, *_TURNS) if self.turns else no_turn(site))
        return reason or (no_light(site) if self.phases is not None else has_light(site))

    def place(self, stage: Stage) -> None:
        """It has no actors."""

    def script(self, stage: Stage) -> Script:
        passed = wait.until(wait.left_junction(stage, self.further))
        if self.phases is None or stage.site.light < 0:
            yield from passed
        else:
            yield from wait.beside(passed, _hold_lights(stage, self.phases))


def _hold_lights(stage: Stage, phases: tuple[bool, bool]) -> Script:
    """All other lights red; the ego's green or red, first for 5 s, then to the end of the hazard.

    Where the ego's stays red the lights follow their cycle again after 10 s more: the original holds them as long as
    the hazard lasts, and who came late would stand there for ever.
    """
    light = stage.site.light
    for is_green, duration in zip(phases, (_FIRST, _SECOND), strict=True):
        stage.lights.hold_junction(light, greens=(light,) if is_green else ())
        yield from wait.seconds(duration)
        if phases == (True, False) and is_green:
            stage.lights.hold(light, LightState.YELLOW)
            yield from wait.seconds(_YELLOW)
    if not phases[-1]:
        stage.lights.release()


@SCENARIOS.register(("2.x", "PriorityAtJunction"))
class PriorityAtJunction(Support):
    """Support type: the ego has green and all others red until it has left the junction.

    Parameters: none. Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    phases = (True, True)
    turns = False
    further = 0.0


@SCENARIOS.register(("2.x", "T_Junction"))
class TJunction(Support):
    """Support type: nothing is scripted; the route leads over a T with a light or a stop sign.

    It lasts 200 m of driving and owns a timer of 240 s.

    Parameters: none. Source: Bench2Drive (reference `leaderboard.md` 6.3).
    """

    def suits(self, site: Site) -> str | None:
        junction = junction_ahead(site)
        if junction is None:
            return self.fits(site)
        before = {way.entry.road_id for way in ways_through(site.town, junction.junction)}
        if site.ahead(_LENGTH + _END) is None:
            return f"the route should go on for {_LENGTH + _END:g} m"
        return no_turn(site) or (None if len(before) == 3 else "the next junction is no T")

    def script(self, stage: Stage) -> Script:
        stage.flags.set(HAZARD_OWNS_TIMER)
        yield from wait.driven(stage.world.ego, _LENGTH)


@SCENARIOS.register(("2.x", "VanillaSignalizedTurnEncounterGreenLight"))
class VanillaSignalizedTurnEncounterGreenLight(Support):
    """Support type: the ego's light is green for 5 s and all others are red; then it is yellow 3 s and red for 10 s.

    It lasts to 10 m behind the junction.

    Parameters: none. Source: Bench2Drive (reference `leaderboard.md` 6.3).
    """

    phases = (True, False)


@SCENARIOS.register(("2.x", "VanillaSignalizedTurnEncounterRedLight"))
class VanillaSignalizedTurnEncounterRedLight(Support):
    """Support type: the ego's light is red for 5 s, then green; all others are red.

    It lasts to 10 m behind the junction.

    Parameters: none. Source: Bench2Drive (reference `leaderboard.md` 6.3).
    """

    phases = (False, True)


@SCENARIOS.register(("2.x", "VanillaNonSignalizedTurn"))
class VanillaNonSignalizedTurn(Support):
    """Support type: nothing is scripted; a turn at a junction without lights. It lasts to 10 m behind the junction.

    Parameters: none. Source: Bench2Drive (reference `leaderboard.md` 6.3).
    """


@SCENARIOS.register(("2.x", "VanillaNonSignalizedTurnEncounterStopsign"))
class VanillaNonSignalizedTurnEncounterStopsign(Support):
    """Support type: nothing is scripted; a turn at a junction with a stop sign. It lasts to 10 m behind the junction.

    Parameters: none. Source: Bench2Drive (reference `leaderboard.md` 6.3).
    """

    def suits(self, site: Site) -> str | None:
        sign = int(site.town.lanes.sign[site.entry_lane]) if site.junction is not None else -1
        has_stop = sign >= 0 and site.town.signs[sign].kind == "stop"
        return super().suits(site) or (None if has_stop else "the next junction has no stop sign for the route")


@SCENARIOS.register(("2.x", "SequentialLaneChange"))
class SequentialLaneChange(Support):
    """Support type: nothing is scripted; the route asks for lane changes one after another and lasts to the last.

    Parameters: none. Source: Bench2Drive (reference `leaderboard.md` 6.3).
    """

    def fits(self, site: Site) -> str | None:
        return "the route changes no lane after it" if not _changes(site) else None

    def suits(self, site: Site) -> str | None:
        return "the route changes lanes less than twice after it" if len(_changes(site)) < 4 else None

    def script(self, stage: Stage) -> Script:
        last = float(stage.route.distance[_changes(stage.site)[-1]])
        yield from wait.until(lambda: stage.progress() >= last)


def _changes(site: Site) -> list[int]:
    """Points of the route after the trigger at which it changes lanes, two for each change."""
    ahead = range(site.index, len(site.route))
    return [k for k in ahead if RoadOption(int(site.route.command[k])) in _CHANGES]
