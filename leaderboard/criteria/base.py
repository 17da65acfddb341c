"""What a criterion is: it watches snapshots, reports infractions, and says itself what they cost.

A new criterion is one file in this package. It states the rules versions it belongs to (`applies`), its place in their
order, and for each kind of infraction its key in the results, its label, and its cost. It sees snapshots, the town and
the route, never the world, so a recorded drive is judged as a live one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar, Literal

from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.registry import Registry
from lavsim.world.snapshot import Snapshot
from leaderboard.rules import Rules

CRITERIA: Registry[type[Criterion]] = Registry("criterion", "leaderboard.criteria")

COMPLETED = "completed"  # how an episode ends when the target is reached


@dataclass(frozen=True)
class Charge:
    """One kind of infraction: where it is written and what it costs.

    Attributes:
        key: Its name in the results file ("collisions_vehicle").
        label: Its name in tables ("Collisions with vehicles").
        column: Place among the results file's values.
        cost: By rules version or generation: the factor of one event where penalties are a product, the coefficient
            of one event where they are a reciprocal. No entry: costs nothing.
        by: What an event's cost is in proportion to. "event": nothing, each costs the same. "shortfall": the part
            missing to 100 of the event's value. "share": no cost of its own; the event's value [percent] is taken off
            the penalty.
        reason: Why the route failed, where this infraction ends it.
    """

    key: str
    label: str
    column: int
    cost: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    by: Literal["event", "shortfall", "share"] = "event"
    reason: str | None = None


@dataclass(frozen=True)
class Infraction:
    """One breach of a rule.

    Attributes:
        key: The charge's key.
        tick: When.
        position: Where the ego was: x, y, z [m].
        message: The text of the results file; tools read numbers from it, so its tokens are fixed.
        value: Percent, for charges in proportion to one.
        metres: Length of route it lasted [m], where it has one.
    """

    key: str
    tick: int
    position: tuple[float, float, float]
    message: str
    value: float | None = None
    metres: float | None = None

    def to_json(self) -> dict[str, Any]:
        """The infraction in JSON types, places in millimetres."""
        return {
            "key": self.key,
            "tick": self.tick,
            "position": [round(v, 3) for v in self.position],
            "message": self.message,
            "value": self.value,
            "metres": self.metres,
        }


class Criterion(ABC):
    """A rule being watched.

    Attributes:
        name: Its key in `CRITERIA`.
        order: Place among the criteria of a tick; also the order of factors in a product.
        applies: Rules versions or generations it belongs to.
        instead_of: The criterion that it takes the place of where both belong; empty for none.
        charges: The kinds of infraction it reports.
        ending: Why the episode ends, once this criterion says it does.
    """

    name: ClassVar[str]
    order: ClassVar[int]
    applies: ClassVar[tuple[str, ...]] = ("1.0", "2.x")
    instead_of: ClassVar[str] = ""
    charges: ClassVar[tuple[Charge, ...]] = ()

    def __init__(self, rules: Rules) -> None:
        self.rules = rules
        self.ending: str | None = None

    @abstractmethod
    def start(self, town: TownMap, route: Route) -> None:
        """Prepares for a drive of `route`."""

    @abstractmethod
    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        """What this tick adds; may set `ending`."""

    def finish(self) -> Sequence[Infraction]:
        """What only the end of the drive shows."""
        return ()


def criteria_of(rules: Rules) -> list[type[Criterion]]:
    """The criteria of `rules` in the order they run."""
    classes = [c for c in (CRITERIA[key] for key in CRITERIA) if set(c.applies) & set(rules.lineage)]
    replaced = {c.instead_of for c in classes}
    return sorted((c for c in classes if c.name not in replaced), key=lambda c: c.order)


def charges_of(rules: Rules) -> dict[str, Charge]:
    """The charges of `rules` by key, in the order of their criteria."""
    return {charge.key: charge for criterion in criteria_of(rules) for charge in criterion.charges}


def in_order(infractions: Iterable[Infraction], rules: Rules) -> list[Infraction]:
    """`infractions` by the order of their criteria, which is the order of factors in the originals' products."""
    charges = charges_of(rules)
    places = {charge.key: place for place, criterion in enumerate(criteria_of(rules)) for charge in criterion.charges}
    return sorted((i for i in infractions if i.key in charges), key=lambda i: places[i.key])


def place(snapshot: Snapshot) -> tuple[float, float, float]:
    """Where the ego is: x, y, z [m]."""
    ego = snapshot.ego
    return ego.x, ego.y, ego.z


def place_text(position: tuple[float, float, float]) -> str:
    """`(x=…, y=…, z=…)` with 3 decimals, as the results file has it."""
    x, y, z = (round(float(v), 3) for v in position)
    return f"(x={x}, y={y}, z={z})"
