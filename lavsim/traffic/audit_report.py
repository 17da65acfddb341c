"""What the audit of traffic tells: single incidents, and the sums over all it saw."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Incident:
    """Something that should not have happened.

    Attributes:
        kind: "contact", "walker_hit", "static_hit", "red_light", "stop_sign", "off_lane", "long_stop", "blocked",
            "near_miss", "jump".
        tick: When.
        actors: Ids of who was in it, the cause first; 0 is the static world.
        x, y: Where [m].
        detail: In words.
    """

    kind: str
    tick: int
    actors: tuple[int, ...]
    x: float
    y: float
    detail: str


@dataclass(frozen=True)
class TrafficReport:
    """Sums and shares over everything observed; vehicles are those of background traffic.

    Attributes:
        seconds: Observed time [s].
        vehicles: Mean number of vehicles.
        vehicle_km: Distance driven by all [km].
        space_mean: Speed over limit, mean over vehicles at an instant.
        time_mean: The same as a detector beside the road sees it, weighted by distance.
        mean_speed: Mean over vehicles at an instant [m/s].
        standing: Share of vehicle time below 0.1 m/s.
        contacts: Events between two vehicles of traffic.
        walkers_hit: Events between a vehicle and a walker.
        static_hit: Events between a vehicle and the static world, props and parked cars.
        other_contacts: Events with the ego and with actors of hazards.
        red_lights: Stop lines crossed at red.
        red_chances: Stop lines crossed in all, where a light governs.
        stop_signs: Stop signs passed without a halt.
        stop_chances: Stop signs passed.
        near_misses: Pairs, one of traffic, within 0.5 s of a contact at a closing speed that hurts.
        off_lane: Times that a vehicle's centre left all driving lanes.
        off_lane_share: Share of vehicle time there.
        off_lane_worst: Farthest beyond the edge of the nearest lane [m].
        against: Share of vehicle time against the direction of the lane, outside junctions (overtaking).
        lane_changes: From a lane to its neighbour.
        long_stops: Stops of over 60 s without a red light ahead.
        blocked: Stops of over 180 s, when the leaderboard calls an agent blocked.
        longest_stop: [s].
        harsh_brakes: Onsets of braking beyond 4 m/s².
        emergency_brakes: The same beyond 6.5 m/s².
        jerk: Root mean square [m/s³].
        side_acceleration: Largest [m/s²].
        saturation_flow: Of queues that discharge at green, after their first vehicle [vehicles/h/lane].
        jumps: Vehicles set somewhere else.
    """

    seconds: float
    vehicles: float
    vehicle_km: float
    space_mean: float
    time_mean: float
    mean_speed: float
    standing: float
    contacts: int
    walkers_hit: int
    static_hit: int
    other_contacts: int
    red_lights: int
    red_chances: int
    stop_signs: int
    stop_chances: int
    near_misses: int
    off_lane: int
    off_lane_share: float
    off_lane_worst: float
    against: float
    lane_changes: int
    long_stops: int
    blocked: int
    longest_stop: float
    harsh_brakes: int
    emergency_brakes: int
    jerk: float
    side_acceleration: float
    saturation_flow: float
    jumps: int

    def as_dict(self) -> dict[str, Any]:
        """In JSON types."""
        return asdict(self)
