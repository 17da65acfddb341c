"""Where CARLA's own arithmetic decides a route: the order of its tables and its single precision.

CARLA keeps roads and the connections of a junction in hash tables, and its route planner settles ties (which of two
equally long ways, which of two segments between the same nodes) by the order in which they come out. So an equal route
needs the order of those tables: GNU's `std::unordered_map` with integer keys. And it needs the last bit of positions
where a lane's length is a whole number of hops.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from lavsim.map.section import SectionShape
from lavsim.map.town_map import TownMap

Floats = NDArray[np.float64]

# Numbers of buckets as the table grows.
_BUCKETS = (1, 13, 29, 59, 127, 257, 541, 1109, 2357, 5087, 10273, 20753, 42043, 85229, 172933, 351061, 712697, 1447153)


def table_order(keys: Iterable[int]) -> list[int]:
    """`keys`, inserted in this order, as the table lists them.

    The table is one linked list in which the keys of a bucket stand together: a key goes before the others of its
    bucket, and that of an empty bucket before all. When there are more keys than buckets the list is walked and laid
    out anew in the same way.
    """
    buckets: dict[int, list[int]] = {}
    sizes = iter(_BUCKETS)
    size = next(sizes)

    def walk() -> list[int]:
        return [key for bucket in reversed(buckets.values()) for key in reversed(bucket)]

    for count, key in enumerate(dict.fromkeys(keys), start=1):
        if count > size:
            known, size = walk(), next(sizes)
            buckets.clear()
            for other in known:
                buckets.setdefault(other % size, []).append(other)
        buckets.setdefault(key % size, []).append(key)
    return walk()


def lanes_in_order(town: TownMap, lanes: Iterable[int]) -> list[int]:
    """Rows of the lane table as CARLA's `get_topology` goes through them: by road, section, lane id."""
    table = town.lanes
    rank = {road: k for k, road in enumerate(table_order(road.id for road in town.network.roads))}
    return sorted(lanes, key=lambda k: (rank[int(table.road_id[k])], int(table.section[k]), int(table.lane_id[k])))


def followers_in_order(town: TownMap) -> dict[int, int]:
    """Place of each connecting road among those of its junction."""
    places: dict[int, int] = {}
    for junction in town.network.junctions:
        rank = {number: k for k, number in enumerate(table_order(c.id for c in junction.connections))}
        places.update({c.connecting: rank[c.id] for c in junction.connections})
    return places


def single_precision_points(town: TownMap, lane: int, s: Floats) -> NDArray[np.float32]:
    """Lane centres (n, 3) at OpenDRIVE `s` (n,), rounded step by step as CARLA's single-precision code does.

    Lanes of whole metres are common, and whether their last metre is a hop of its own hangs on the last bit.
    """
    lane_id, road_id = int(town.lanes.lane_id[lane]), int(town.lanes.road_id[lane])
    shape = town.shapes[road_id]
    section = SectionShape(shape, int(town.lanes.section[lane]))
    s = np.clip(s, section.start, section.end - 1e-7)  # records that begin at the end belong to the next section
    x, y, heading = shape.pose(s)[:3]
    starts = np.array([(record.s, record.x, record.y) for record in shape.road.geometry])
    start = starts[np.clip(np.searchsorted(starts[:, 0], s, side="right") - 1, 0, None), 1:]
    xy = start.astype(np.float32) + (np.stack([x, y], axis=1) - start).astype(np.float32)
    aside = np.stack([np.sin(heading.astype(np.float32)), -np.cos(heading.astype(np.float32))], axis=1)
    offset = shape.offset(s)[0]
    t = section.centre(lane_id, s)[0]
    for step in (-offset, offset - t):
        xy = xy + step.astype(np.float32)[:, None] * aside
    z = shape.elevation(s)[0]
    return np.stack([xy[:, 0], -xy[:, 1], z.astype(np.float32)], axis=1)
