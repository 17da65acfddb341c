"""Small shared vocabulary: enums with CARLA's values, controls, and the actor ids of each source."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag

DT = 0.05  # [s] the fixed tick of DESIGN section 2; CARLA's leaderboard runs at the same 20 Hz


class ActorClass(IntEnum):
    """What an actor is, for contacts, shapes and labels."""

    CAR = 0
    VAN = 1
    TRUCK = 2
    BUS = 3
    MOTORCYCLE = 4
    BICYCLE = 5
    WALKER = 6
    PROP = 7

    @property
    def is_vehicle(self) -> bool:
        return self <= ActorClass.BICYCLE


class Role(IntEnum):
    """Why an actor is there."""

    EGO = 0
    TRAFFIC = 1
    SCENARIO = 2
    PARKED = 3
    PROP = 4


class ActorIds(IntEnum):
    """First id of each source; ids are never reused within a drive, and 0 is the static world."""

    STATIC = 0
    EGO = 1
    TRAFFIC = 1_000
    WALKERS = 100_000
    PARKED = 200_000
    SCENARIOS = 1_000_000  # hazard k owns SCENARIOS + k * SCENARIO_SPAN …

    @staticmethod
    def of_scenario(instance: int) -> int:
        return ActorIds.SCENARIOS + 1_000 * instance


class LightState(IntEnum):
    """Traffic-light states with CARLA's values."""

    RED = 0
    YELLOW = 1
    GREEN = 2
    OFF = 3
    UNKNOWN = 4


class VehicleLight(IntFlag):
    """CARLA's light bit field."""

    NONE = 0
    POSITION = 1
    LOW_BEAM = 2
    HIGH_BEAM = 4
    BRAKE = 8
    RIGHT_BLINKER = 16
    LEFT_BLINKER = 32
    REVERSE = 64
    FOG = 128
    INTERIOR = 256
    SPECIAL1 = 512
    SPECIAL2 = 1024


class RoadOption(IntEnum):
    """High-level commands with CARLA's values."""

    VOID = -1
    LEFT = 1
    RIGHT = 2
    STRAIGHT = 3
    LANEFOLLOW = 4
    CHANGELANELEFT = 5
    CHANGELANERIGHT = 6

    @property
    def is_turn(self) -> bool:
        return self in (RoadOption.LEFT, RoadOption.RIGHT, RoadOption.STRAIGHT)

    @property
    def is_lane_change(self) -> bool:
        return self in (RoadOption.CHANGELANELEFT, RoadOption.CHANGELANERIGHT)


class LaneType(IntFlag):
    """OpenDRIVE lane types with CARLA's bit values."""

    NONE = 1
    DRIVING = 2
    STOP = 4
    SHOULDER = 8
    BIKING = 16
    SIDEWALK = 32
    BORDER = 64
    RESTRICTED = 128
    PARKING = 256
    BIDIRECTIONAL = 512
    MEDIAN = 1024
    SPECIAL1 = 2048
    SPECIAL2 = 4096
    SPECIAL3 = 8192
    ROADWORKS = 16384
    TRAM = 32768
    RAIL = 65536
    ENTRY = 131072
    EXIT = 262144
    OFF_RAMP = 524288
    ON_RAMP = 1048576


class Tag(IntEnum):
    """Semantic classes, CARLA's table up to 0.9.13 (reference `carla.md` 6.1)."""

    NONE = 0
    BUILDING = 1
    FENCE = 2
    OTHER = 3
    PEDESTRIAN = 4
    POLE = 5
    ROAD_LINE = 6
    ROAD = 7
    SIDEWALK = 8
    VEGETATION = 9
    VEHICLE = 10
    WALL = 11
    TRAFFIC_SIGN = 12
    SKY = 13
    GROUND = 14
    BRIDGE = 15
    RAIL_TRACK = 16
    GUARD_RAIL = 17
    TRAFFIC_LIGHT = 18
    STATIC = 19
    DYNAMIC = 20
    WATER = 21
    TERRAIN = 22


@dataclass(frozen=True)
class Control:
    """What an agent asks of its vehicle for one tick; CARLA's `VehicleControl` duck-types to it.

    Attributes:
        throttle: 0 to 1.
        steer: -1 to 1, positive to the right.
        brake: 0 to 1.
        hand_brake: Locks the wheels.
        reverse: Drives backward.
    """

    throttle: float = 0.0
    steer: float = 0.0
    brake: float = 0.0
    hand_brake: bool = False
    reverse: bool = False
