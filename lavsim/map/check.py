"""What is wrong with a user's OpenDRIVE file, in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from lavsim.errors import MapError
from lavsim.map.lane import CLEAR_HEIGHT, gaps, kinks
from lavsim.map.opendrive import read_bytes
from lavsim.map.signal import LIGHT_TYPES
from lavsim.map.town_files import build_town
from lavsim.map.town_map import TownMap
from lavsim.types import LaneType

WIDEST_GAP = 0.1  # [m] between linked lanes
SHARPEST_KINK = 5.0  # [deg]
TIGHTEST = 2.0  # [m] radius of a lane that a car can follow
NARROWEST = 2.0  # [m]
MOST_NAMED = 6  # of one kind


def check_file(path: Path) -> list[str]:
    """Findings, one sentence each; empty when all is well. A file that can't be read is one finding."""
    try:
        return check_town(build_town(path.stem, read_bytes(path), str(path)))
    except MapError as error:
        return [str(error)]


def check_town(town: TownMap) -> list[str]:
    """Findings about a town that could be read."""
    return [*town.report, *_curves(town), *_lanes(town), *_links(town), *_signals(town)]


def _list(things: Iterable[str]) -> str:
    named = list(things)
    more = f" and {len(named) - MOST_NAMED} more" if len(named) > MOST_NAMED else ""
    return ", ".join(named[:MOST_NAMED]) + more


def _name(town: TownMap, lane: int) -> str:
    t = town.lanes
    section = int(t.section[lane])
    return f"{int(t.lane_id[lane])} of road {int(t.road_id[lane])}" + (f" (section {section})" if section else "")


def _curves(town: TownMap) -> Iterator[str]:
    """Reference lines that jump, or that don't span their road."""
    jumps, short = [], []
    for road in town.network.roads:
        line = town.shapes[road.id].line
        for before, after in pairwise(road.geometry):
            at = np.array([after.s - 1e-7])
            x, y = (float(v[0]) for v in line.pose(at)[:2])
            apart = float(np.hypot(x - after.x, y - after.y))
            if apart > WIDEST_GAP and before.length > 0.0:
                jumps.append(f"road {road.id} by {apart:.2f} m at s = {after.s:.1f}")
        last = road.geometry[-1]
        if abs(last.s + last.length - road.length) > WIDEST_GAP:
            short.append(f"road {road.id} ({last.s + last.length:.2f} of {road.length:.2f} m)")
    if jumps:
        yield f"Reference lines jump between two curves: {_list(jumps)}."
    if short:
        yield f"The curves do not add up to the road's length: {_list(short)}."


def _lanes(town: TownMap) -> Iterator[str]:
    """Lanes that no car can follow."""
    t = town.lanes
    driving = t.where(LaneType.DRIVING)
    if not len(driving):
        yield "There is no driving lane."
        return
    thin, tight = [], []
    for lane in driving.tolist():
        widths = t.width[t.rows(lane)]
        if np.median(widths) < NARROWEST:
            thin.append(f"{_name(town, lane)} ({float(np.median(widths)):.2f} m)")
        bend = float(np.abs(t.centre_line(lane)[:, 4]).max())
        if bend > 1.0 / TIGHTEST:
            tight.append(f"{_name(town, lane)} ({1.0 / bend:.2f} m)")
    if thin:
        yield f"Driving lanes narrower than {NARROWEST:g} m: {_list(thin)}."
    if tight:
        yield f"Driving lanes that bend with a radius below {TIGHTEST:g} m: {_list(tight)}."


def _links(town: TownMap) -> Iterator[str]:
    """Lanes that don't join."""
    t = town.lanes
    driving = t.where(LaneType.DRIVING)
    if not len(driving):
        return
    source = np.repeat(np.arange(len(t)), np.diff(t.succ_first))
    wide = [f"{_name(town, source[k])} to {_name(town, t.succ[k])}" for k in np.flatnonzero(gaps(t) > WIDEST_GAP)]
    if wide:
        yield f"Linked lanes lie more than {WIDEST_GAP:g} m apart: {_list(wide)}."
    bent = np.flatnonzero(np.degrees(kinks(t)) > SHARPEST_KINK)
    if len(bent):
        pairs = (f"{_name(town, source[k])} to {_name(town, t.succ[k])}" for k in bent)
        yield f"Linked lanes meet at an angle above {SHARPEST_KINK:g} degrees: {_list(pairs)}."
    ends = [k for k in driving.tolist() if not len(t.successors(k))]
    if ends:
        yield f"Driving lanes from which nothing leads on: {_list(_name(town, k) for k in ends)}."
    starts = [k for k in driving.tolist() if not len(t.predecessors(k))]
    if starts:
        yield f"Driving lanes that nothing leads into: {_list(_name(town, k) for k in starts)}."
    pairs_of = [(source, t.succ)]
    for beside, allowed in ((t.left, t.change_left), (t.right, t.change_right)):
        lanes = np.flatnonzero(allowed & (beside >= 0))
        pairs_of.append((lanes, beside[lanes]))
    rows, columns = (np.concatenate(part) for part in zip(*pairs_of, strict=True))
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(len(t), len(t)))
    _, part = connected_components(graph, connection="strong")
    sizes = np.bincount(part[driving])
    if (sizes > 0).sum() > 1:
        apart = int(len(driving) - sizes.max())
        yield f"{apart} of {len(driving)} driving lanes can't be reached from the rest, or the rest not from them."


def _signals(town: TownMap) -> Iterator[str]:
    """Signals that govern nothing, and controllers of what isn't there."""
    network = town.network
    known = {signal.id for road in network.roads for signal in road.signals}
    lost = {r.id for road in network.roads for r in road.references if r.id not in known}
    if lost:
        yield f"Signal references name signals that are missing: {_list(map(str, sorted(lost)))}."
    idle = [str(light.signal_id) for light in town.lights if not light.lanes]
    if idle:
        yield f"Traffic lights that govern no junction lane: {_list(idle)}."
    idle = [f"{sign.kind} sign {sign.signal_id}" for sign in town.signs if not sign.lanes and not sign.approach]
    if idle:
        yield f"Signs that govern no driving lane: {_list(idle)}."
    posts = [(f"light {light.signal_id}", light.x, light.y, light.z) for light in town.lights]
    posts += [(f"{sign.kind} sign {sign.signal_id}", sign.x, sign.y, sign.z) for sign in town.signs]
    if posts:
        hits = town.nearest(np.array([post[1:3] for post in posts]))
        low = np.array([post[3] for post in posts]) - hits.points[:, 2] < CLEAR_HEIGHT
        blocking = [post[0] for post, on_lane in zip(posts, hits.inside & low, strict=True) if on_lane]
        if blocking:
            yield f"Signals that stand on a driving lane, which CARLA would move aside: {_list(blocking)}."
    held = {signal for controller in network.controllers for signal in controller.signals}
    lights = {s.id for road in network.roads for s in road.signals if s.kind in LIGHT_TYPES}
    free = sorted(lights - held)
    if free:
        yield f"Traffic lights that no controller holds, so that each is a group of its own: {_list(map(str, free))}."
    missing = sorted(held - known)
    if missing:
        yield f"Controllers name signals that are missing: {_list(map(str, missing))}."
    numbers = {controller.id for controller in network.controllers}
    strange = sorted({c for junction in network.junctions for c in junction.controllers if c not in numbers})
    if strange:
        yield f"Junctions name controllers that are missing: {_list(map(str, strange))}."
