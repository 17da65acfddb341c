"""The blueprint table: names, boxes and masses of what can be in a town.

Source: sizes from reference `carla.md` 2.1 (CARLA 0.9.16); masses marked there as proposals are ours.
"""

from __future__ import annotations

from dataclasses import dataclass

from lavsim.errors import UnknownName
from lavsim.random import Draws
from lavsim.types import ActorClass

PAINTS = (
    (235, 235, 235), (25, 25, 28), (150, 152, 156), (170, 30, 30), (35, 60, 130),
    (90, 95, 100), (210, 200, 170), (30, 90, 60), (220, 140, 30), (110, 20, 40),
)  # fmt: skip
CLOTHES = (
    (190, 40, 45), (35, 80, 160), (230, 190, 50), (60, 130, 70), (235, 235, 230), (140, 70, 150), (40, 42, 50),
)  # fmt: skip


@dataclass(frozen=True)
class Blueprint:
    """One kind of actor.

    Attributes:
        name: CARLA's id.
        actor_class: For contacts, shapes and labels.
        size: Full length, width, height [m].
        mass: [kg]; infinite for what a car can't push.
        weight: Relative frequency in background traffic; 0 keeps it out.
        colours: What it may be painted or dressed in (red, green, blue); one is drawn for each actor.
    """

    name: str
    actor_class: ActorClass
    size: tuple[float, float, float]
    mass: float
    weight: float = 0.0
    colours: tuple[tuple[int, int, int], ...] = PAINTS

    def colour(self, draws: Draws, actor_id: int) -> tuple[int, int, int]:
        """The colour of one actor."""
        return self.colours[draws.stream("colour", actor_id).integer(0, len(self.colours))]


_IMMOVABLE = float("inf")
_CAR, _VAN, _TRUCK, _BUS = ActorClass.CAR, ActorClass.VAN, ActorClass.TRUCK, ActorClass.BUS
_MOTORCYCLE, _BICYCLE = ActorClass.MOTORCYCLE, ActorClass.BICYCLE

_TABLE = (
    Blueprint("vehicle.lincoln.mkz_2017", _CAR, (4.902, 2.128, 1.511), 1700.0, 1.0),
    Blueprint("vehicle.lincoln.mkz_2020", _CAR, (4.892, 1.837, 1.490), 1800.0, 1.0),
    Blueprint("vehicle.tesla.model3", _CAR, (4.792, 2.163, 1.488), 1845.0, 1.0),
    Blueprint("vehicle.audi.tt", _CAR, (4.181, 1.994, 1.385), 1400.0, 1.0),
    Blueprint("vehicle.nissan.micra", _CAR, (3.633, 1.845, 1.501), 1000.0, 1.0),
    Blueprint("vehicle.nissan.patrol", _CAR, (4.605, 1.932, 1.855), 2200.0, 1.0),
    Blueprint("vehicle.toyota.prius", _CAR, (4.514, 2.007, 1.525), 1400.0, 1.0),
    Blueprint("vehicle.mini.cooper_s", _CAR, (3.806, 1.970, 1.475), 1200.0, 1.0),
    Blueprint("vehicle.seat.leon", _CAR, (4.193, 1.816, 1.474), 1250.0, 1.0),
    Blueprint("vehicle.mercedes.coupe", _CAR, (5.027, 2.152, 1.651), 1700.0, 1.0),
    Blueprint("vehicle.dodge.charger_2020", _CAR, (5.008, 1.882, 1.535), 1900.0, 1.0),
    Blueprint("vehicle.volkswagen.t2", _VAN, (4.480, 2.069, 2.038), 1500.0, 0.8),
    Blueprint("vehicle.mercedes.sprinter", _VAN, (5.915, 1.988, 2.561), 2500.0, 0.8),
    Blueprint("vehicle.ford.ambulance", _VAN, (6.366, 2.351, 2.431), 4000.0, 0.1),
    Blueprint("vehicle.carlamotors.carlacola", _TRUCK, (5.204, 2.627, 2.467), 5500.0, 0.3),
    Blueprint("vehicle.carlamotors.european_hgv", _TRUCK, (7.936, 2.891, 3.462), 9000.0, 0.0),
    Blueprint("vehicle.mitsubishi.fusorosa", _BUS, (10.273, 2.550, 3.200), 9000.0, 0.0),
    Blueprint("vehicle.harley-davidson.low_rider", _MOTORCYCLE, (2.350, 0.766, 1.649), 300.0, 0.4),
    Blueprint("vehicle.yamaha.yzf", _MOTORCYCLE, (2.191, 0.866, 1.530), 250.0, 0.4),
    Blueprint("vehicle.bh.crossbike", _BICYCLE, (1.509, 0.866, 1.612), 90.0, 0.3),
    Blueprint("vehicle.diamondback.century", _BICYCLE, (1.656, 0.582, 1.620), 90.0, 0.3),
    Blueprint("walker.pedestrian.0001", ActorClass.WALKER, (0.38, 0.38, 1.86), 75.0, colours=CLOTHES),
    Blueprint("walker.pedestrian.0009", ActorClass.WALKER, (0.50, 0.50, 1.10), 30.0, colours=CLOTHES),
    Blueprint("walker.pedestrian.0012", ActorClass.WALKER, (0.38, 0.38, 1.30), 35.0, colours=CLOTHES),
    Blueprint("static.prop.vendingmachine", ActorClass.PROP, (1.10, 0.90, 2.00), _IMMOVABLE, colours=((185, 35, 40),)),
    Blueprint("static.prop.container", ActorClass.PROP, (1.90, 1.10, 1.35), _IMMOVABLE, colours=((50, 105, 70),)),
    Blueprint("static.prop.busstop", ActorClass.PROP, (3.90, 1.60, 2.70), _IMMOVABLE, colours=((120, 140, 150),)),
    Blueprint("static.prop.advertisement", ActorClass.PROP, (1.30, 0.30, 2.40), _IMMOVABLE, colours=((215, 215, 205),)),
    Blueprint("static.prop.streetbarrier", ActorClass.PROP, (1.20, 0.40, 1.00), _IMMOVABLE, colours=((220, 60, 45),)),
    Blueprint("static.prop.trafficcone01", ActorClass.PROP, (0.40, 0.40, 0.80), 5.0, colours=((240, 110, 30),)),
)

BLUEPRINTS = {blueprint.name: blueprint for blueprint in _TABLE}


def find_blueprint(name: str) -> Blueprint:
    """The blueprint called `name`.

    Raises:
        UnknownName: there is none; the message names the nearest.
    """
    try:
        return BLUEPRINTS[name]
    except KeyError:
        raise UnknownName("blueprint", name, BLUEPRINTS) from None
