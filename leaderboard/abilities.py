"""Bench2Drive's view of a run: success rate, efficiency, smoothness, and five abilities by type of hazard.

Source: reference `leaderboard.md` 6.5 (`Thinklab-SJTU/Bench2Drive`, `tools/`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from leaderboard.score import RouteRecord

MIN_SPEED = "min_speed_infractions"
_SIGNALS = ("red_light", "stop_infraction")  # what the ability "Traffic signs" forbids

_OVERTAKING = (
    "Accident", "AccidentTwoWays", "ConstructionObstacle", "ConstructionObstacleTwoWays", "HazardAtSideLane",
    "HazardAtSideLaneTwoWays", "ParkedObstacle", "ParkedObstacleTwoWays", "VehicleOpensDoorTwoWays",
)  # fmt: skip
_MERGING = (
    "CrossingBicycleFlow", "EnterActorFlow", "HighwayExit", "HighwayCutIn", "InterurbanActorFlow",
    "InterurbanAdvancedActorFlow", "MergerIntoSlowTraffic", "MergerIntoSlowTrafficV2",
    "NonSignalizedJunctionLeftTurn", "NonSignalizedJunctionRightTurn", "NonSignalizedJunctionLeftTurnEnterFlow",
    "ParkingExit", "SequentialLaneChange", "SignalizedJunctionLeftTurn", "SignalizedJunctionRightTurn",
    "SignalizedJunctionLeftTurnEnterFlow",
)  # fmt: skip
_BRAKING = (
    "BlockedIntersection", "DynamicObjectCrossing", "HardBreakRoute", "OppositeVehicleTakingPriority",
    "OppositeVehicleRunningRedLight", "ParkingCutIn", "PedestrianCrossing", "ParkingCrossingPedestrian", "StaticCutIn",
    "VehicleTurningRoute", "VehicleTurningRoutePedestrian", "ControlLoss",
)  # fmt: skip
_SIGNS = (
    "T_Junction", "VanillaSignalizedTurnEncounterGreenLight", "VanillaSignalizedTurnEncounterRedLight",
    "VanillaNonSignalizedTurn", "VanillaNonSignalizedTurnEncounterStopsign",
    "NonSignalizedJunctionLeftTurn", "NonSignalizedJunctionRightTurn", "NonSignalizedJunctionLeftTurnEnterFlow",
    "SignalizedJunctionLeftTurn", "SignalizedJunctionRightTurn", "SignalizedJunctionLeftTurnEnterFlow",
    "PedestrianCrossing", "VehicleTurningRoute", "VehicleTurningRoutePedestrian", "OppositeVehicleTakingPriority",
    "OppositeVehicleRunningRedLight", "BlockedIntersection", "EnterActorFlow", "CrossingBicycleFlow",
)  # fmt: skip
ABILITIES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "Overtaking": _OVERTAKING,
        "Merging": _MERGING,
        "Emergency brake": _BRAKING,
        "Give way": ("InvadingTurn", "YieldToEmergencyVehicle"),
        "Traffic signs": _SIGNS,
    }
)


def is_success(record: RouteRecord) -> bool:
    """Whether a drive reached its target without any infraction but for its speed."""
    return record.reached and all(not texts for key, texts in record.infractions.items() if key != MIN_SPEED)


def run_metrics(records: Sequence[RouteRecord], drives: Sequence[Mapping[str, Any]], total: int) -> dict[str, Any]:
    """Bench2Drive's measures of a run, in JSON types.

    Args:
        records: Of the drives done.
        drives: What the run file says of each, with its hazards' types ("scenarios") and "metrics".
        total: Planned drives; a missing one is no success.

    Returns:
        success_rate [%], efficiency [%] and smoothness [%] (None where no drive has any), and abilities [%] by name,
        those without a drive left out, with their mean.
    """
    pairs = list(zip(records, drives, strict=True))
    abilities: dict[str, float] = {}
    for name, types in ABILITIES.items():
        rated = [_masters(record, drive, name) for record, drive in pairs if set(types) & set(drive["scenarios"])]
        if rated:
            abilities[name] = 100.0 * sum(rated) / len(rated)
    if abilities:
        abilities["Mean"] = sum(abilities.values()) / len(abilities)
    return {
        "success_rate": 100.0 * sum(map(is_success, records)) / total if total else 0.0,
        "efficiency": _mean([drive["metrics"].get("efficiency") for drive in drives]),
        "smoothness": _mean([drive["metrics"].get("smoothness") for drive in drives], 100.0),
        "abilities": abilities,
    }


def _masters(record: RouteRecord, drive: Mapping[str, Any], ability: str) -> bool:
    if is_success(record):
        return True
    junction = drive["metrics"].get("first_junction")
    if ability != "Traffic signs" or junction is None:
        return False
    return record.scores.route > junction and not any(record.infractions.get(key) for key in _SIGNALS)


def _mean(values: Sequence[float | None], scale: float = 1.0) -> float | None:
    known = [value for value in values if value is not None]
    return scale * sum(known) / len(known) if known else None
