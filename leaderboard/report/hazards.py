"""Hazards over a whole run: how often each was met, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lavsim.types import DT, ActorIds
from lavsim.viewer.tracks import Tracks
from leaderboard.report.markup import Markup, el

AFTER = 5.0  # [s] after a hazard in which an infraction is put down to it


@dataclass
class Tally:
    """What a hazard came to.

    Attributes:
        planned: In the routes driven.
        met: Set off by the ego.
        infractions: Committed while it was active, or within `AFTER` of it.
        contacts: Of the ego with the hazard's own actors.
        scores: Of the drives in which it was met.
    """

    planned: int = 0
    met: int = 0
    infractions: int = 0
    contacts: int = 0
    scores: list[float] = field(default_factory=list)


Tallies = dict[str, Tally]


def count_hazards(
    tallies: Tallies,
    tracks: Tracks,
    header: Mapping[str, Any],
    infractions: Sequence[Mapping[str, Any]],
    score: float,
) -> None:
    """Adds the hazards of a drive to `tallies`."""
    types = [str(scenario["type"]) for scenario in header.get("scenarios", [])]
    for kind in types:
        tallies.setdefault(kind, Tally()).planned += 1
    touched = tracks.touches[(tracks.touches[:, 1] == 1) | (tracks.touches[:, 2] == 1)]
    other = np.where(touched[:, 1] == 1, touched[:, 2], touched[:, 1])
    seen: set[int] = set()
    for number, first, last in tracks.hazards.tolist():
        if number >= len(types):
            continue
        tally = tallies[types[number]]
        begin, end = int(tracks.ticks[first]), int(tracks.ticks[last - 1]) + round(AFTER / DT)
        tally.infractions += sum(begin <= int(entry["tick"]) <= end for entry in infractions)
        if number not in seen:
            seen.add(number)
            own = ActorIds.of_scenario(number), ActorIds.of_scenario(number + 1)
            tally.met += 1
            tally.scores.append(score)
            tally.contacts += int(((other >= own[0]) & (other < own[1])).sum())


def add_tallies(tallies: Tallies, more: Tallies) -> None:
    """Adds those of other drives to `tallies`."""
    for kind, tally in more.items():
        total = tallies.setdefault(kind, Tally())
        total.planned += tally.planned
        total.met += tally.met
        total.infractions += tally.infractions
        total.contacts += tally.contacts
        total.scores += tally.scores


def hazard_table(tallies: Tallies) -> Markup | None:
    """A row a hazard; None where there was none."""
    if not tallies:
        return None
    names = ("planned", "met", "infractions around it", "contacts with its actors", "mean score where met")
    rows = []
    for kind, tally in sorted(tallies.items()):
        mean = f"{np.mean(tally.scores):.1f}" if tally.scores else "-"
        values = (tally.planned, tally.met, tally.infractions, tally.contacts, mean)
        rows.append(el("tr", el("td", kind), [el("td", str(value), class_="num") for value in values]))
    head = el("tr", el("th", "hazard"), [el("th", name, class_="num") for name in names])
    return el("div", el("table", el("thead", head), el("tbody", rows)), class_="card wide")
