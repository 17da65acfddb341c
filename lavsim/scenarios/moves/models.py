"""Which vehicle a hazard takes."""

from __future__ import annotations

from collections.abc import Sequence

from lavsim.random import Draws
from lavsim.types import VehicleLight

POLICE = "vehicle.dodge.charger_police_2020"
EMERGENCY = (POLICE, "vehicle.ford.ambulance", "vehicle.carlamotors.firetruck")
WALKERS = tuple(f"walker.pedestrian.{number:04d}" for number in range(1, 9))  # adults
HAZARD_LIGHTS = VehicleLight.LEFT_BLINKER | VehicleLight.RIGHT_BLINKER
BLUE_LIGHTS = VehicleLight.SPECIAL1 | VehicleLight.SPECIAL2 | VehicleLight.POSITION


def pick(draws: Draws, choices: Sequence[str], number: int = 0) -> str:
    """One of `choices` for the hazard's actor `number`."""
    return choices[draws.stream("model", number).integer(0, len(choices))]
