"""The blueprint table: names, boxes and masses of what can be in a town.

Source: names and boxes are CARLA 0.9.16's (reference `carla.md` 2.1, and the table that it names); masses marked there
as proposals are ours. The bus has a sane box in place of CARLA's, which is 3.9 m wide and 4.3 m high.
"""

from __future__ import annotations

from dataclasses import dataclass

from lavsim.errors import UnknownName
from lavsim.random import Draws
from lavsim.types import ActorClass

Colour = tuple[int, int, int]

PAINTS: tuple[Colour, ...] = (
    (235, 235, 235), (25, 25, 28), (150, 152, 156), (170, 30, 30), (35, 60, 130),
    (90, 95, 100), (210, 200, 170), (30, 90, 60), (220, 140, 30), (110, 20, 40),
)  # fmt: skip
CLOTHES: tuple[Colour, ...] = (
    (190, 40, 45), (35, 80, 160), (230, 190, 50), (60, 130, 70), (235, 235, 230), (140, 70, 150), (40, 42, 50),
)  # fmt: skip
_WHITE, _RED, _YELLOW, _GREEN = ((240, 240, 240),), ((190, 25, 25),), ((240, 190, 40),), ((60, 110, 70),)
_BLACK, _GREY, _ORANGE, _BROWN = ((25, 25, 28),), ((130, 132, 136),), ((240, 110, 30),), ((120, 95, 70),)
_IMMOVABLE = float("inf")


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
        special_type: CARLA's attribute: "emergency", "taxi", "electric" or "".
        is_solid: Whether anything can touch it; what lies flat on the road is driven over.
    """

    name: str
    actor_class: ActorClass
    size: tuple[float, float, float]
    mass: float
    weight: float = 0.0
    colours: tuple[Colour, ...] = PAINTS
    special_type: str = ""
    is_solid: bool = True

    def colour(self, draws: Draws, actor_id: int) -> Colour:
        """The colour of one actor."""
        return self.colours[draws.stream("colour", actor_id).integer(0, len(self.colours))]

    @property
    def base_type(self) -> str:
        """CARLA's attribute: "car", "truck", "van", "motorcycle", "bicycle" or "bus"; "" for all else."""
        return self.actor_class.name.lower() if self.actor_class.is_vehicle else ""

    @property
    def number_of_wheels(self) -> int:
        """4 or 2; 0 for what is no vehicle."""
        if self.actor_class in (ActorClass.MOTORCYCLE, ActorClass.BICYCLE):
            return 2
        return 4 if self.actor_class.is_vehicle else 0

    @property
    def is_emergency(self) -> bool:
        return self.special_type == "emergency"


_CAR, _VAN, _TRUCK, _BUS = ActorClass.CAR, ActorClass.VAN, ActorClass.TRUCK, ActorClass.BUS
_MOTORCYCLE, _BICYCLE = ActorClass.MOTORCYCLE, ActorClass.BICYCLE

# Weights: a town is full of cars; one vehicle in eight is a two-wheeler, one in fifty a truck. The long and wide ones
# stay out of background traffic: in a turn of 9.3 m radius, the tightest of our towns, a bus sweeps 2.5 m to the
# outside of its lane's middle, the two big trucks 2.1 m, where half a lane is 1.65 m.
_VEHICLES = (
    Blueprint("vehicle.lincoln.mkz_2017", _CAR, (4.902, 2.128, 1.511), 1700.0, 1.0),
    Blueprint("vehicle.lincoln.mkz_2020", _CAR, (4.892, 1.837, 1.490), 1800.0, 1.0),
    Blueprint("vehicle.tesla.model3", _CAR, (4.792, 2.163, 1.488), 1845.0, 1.0, special_type="electric"),
    Blueprint("vehicle.audi.a2", _CAR, (3.705, 1.789, 1.549), 1000.0, 1.0),
    Blueprint("vehicle.audi.etron", _CAR, (4.856, 2.033, 1.649), 2500.0, 1.0, special_type="electric"),
    Blueprint("vehicle.audi.tt", _CAR, (4.181, 1.994, 1.385), 1400.0, 1.0),
    Blueprint("vehicle.bmw.grandtourer", _CAR, (4.611, 2.242, 1.667), 1600.0, 1.0),
    Blueprint("vehicle.chevrolet.impala", _CAR, (5.357, 2.033, 1.411), 1700.0, 1.0),
    Blueprint("vehicle.citroen.c3", _CAR, (3.988, 1.851, 1.617), 1100.0, 1.0),
    Blueprint("vehicle.dodge.charger_2020", _CAR, (5.008, 1.882, 1.535), 1900.0, 1.0),
    Blueprint("vehicle.dodge.charger_police", _CAR, (4.974, 2.038, 1.542), 1900.0, 0.2, _BLACK, "emergency"),
    Blueprint("vehicle.dodge.charger_police_2020", _CAR, (5.238, 1.930, 1.638), 1900.0, 0.2, _BLACK, "emergency"),
    Blueprint("vehicle.ford.crown", _CAR, (5.366, 1.801, 1.575), 1850.0, 0.6, _YELLOW, "taxi"),
    Blueprint("vehicle.ford.mustang", _CAR, (4.718, 1.895, 1.301), 1600.0, 1.0),
    Blueprint("vehicle.jeep.wrangler_rubicon", _CAR, (3.866, 1.905, 1.878), 1900.0, 1.0),
    Blueprint("vehicle.mercedes.coupe", _CAR, (5.027, 2.152, 1.651), 1700.0, 1.0),
    Blueprint("vehicle.mercedes.coupe_2020", _CAR, (4.674, 1.812, 1.442), 1650.0, 1.0),
    Blueprint("vehicle.micro.microlino", _CAR, (2.207, 1.481, 1.376), 550.0, 0.3, special_type="electric"),
    Blueprint("vehicle.mini.cooper_s", _CAR, (3.806, 1.970, 1.475), 1200.0, 1.0),
    Blueprint("vehicle.mini.cooper_s_2021", _CAR, (4.553, 2.097, 1.767), 1400.0, 1.0),
    Blueprint("vehicle.nissan.micra", _CAR, (3.633, 1.845, 1.501), 1000.0, 1.0),
    Blueprint("vehicle.nissan.patrol", _CAR, (4.605, 1.932, 1.855), 2200.0, 1.0),
    Blueprint("vehicle.nissan.patrol_2021", _CAR, (5.566, 2.150, 2.045), 2400.0, 0.6),
    Blueprint("vehicle.seat.leon", _CAR, (4.193, 1.816, 1.474), 1250.0, 1.0),
    Blueprint("vehicle.toyota.prius", _CAR, (4.514, 2.007, 1.525), 1400.0, 1.0),
    Blueprint("vehicle.tesla.cybertruck", _TRUCK, (6.274, 2.390, 2.098), 3000.0, 0.2, _GREY, "electric"),
    Blueprint("vehicle.volkswagen.t2", _VAN, (4.480, 2.069, 2.038), 1500.0, 0.8),
    Blueprint("vehicle.volkswagen.t2_2021", _VAN, (4.442, 1.775, 1.987), 1500.0, 0.8),
    Blueprint("vehicle.mercedes.sprinter", _VAN, (5.915, 1.988, 2.561), 2500.0, 1.0),
    Blueprint("vehicle.ford.ambulance", _VAN, (6.366, 2.351, 2.431), 4000.0, 0.15, _WHITE, "emergency"),
    Blueprint("vehicle.carlamotors.carlacola", _TRUCK, (5.204, 2.627, 2.467), 5500.0, 0.4),
    Blueprint("vehicle.carlamotors.european_hgv", _TRUCK, (7.936, 2.891, 3.462), 9000.0),
    Blueprint("vehicle.carlamotors.firetruck", _TRUCK, (8.468, 2.891, 3.827), 12000.0, 0.0, _RED, "emergency"),
    Blueprint("vehicle.mitsubishi.fusorosa", _BUS, (10.273, 2.550, 3.200), 9000.0),
    Blueprint("vehicle.harley-davidson.low_rider", _MOTORCYCLE, (2.350, 0.766, 1.649), 300.0, 0.5),
    Blueprint("vehicle.kawasaki.ninja", _MOTORCYCLE, (2.044, 0.797, 1.523), 250.0, 0.5),
    Blueprint("vehicle.vespa.zx125", _MOTORCYCLE, (1.817, 0.866, 1.590), 190.0, 0.5),
    Blueprint("vehicle.yamaha.yzf", _MOTORCYCLE, (2.191, 0.866, 1.530), 250.0, 0.5),
    Blueprint("vehicle.bh.crossbike", _BICYCLE, (1.509, 0.866, 1.612), 90.0, 0.5),
    Blueprint("vehicle.diamondback.century", _BICYCLE, (1.656, 0.582, 1.620), 90.0, 0.5),
    Blueprint("vehicle.gazelle.omafiets", _BICYCLE, (1.843, 0.659, 1.776), 95.0, 0.5),
)

# Children of two kinds, by the last part of their name; all other walkers are adults.
_SMALL, _CHILDREN = (9, 10, 11, 48, 49), (12, 13, 14)


def _walker(number: int) -> Blueprint:
    size, mass = (0.38, 0.38, 1.86), 75.0
    if number in _SMALL:
        size, mass = (0.50, 0.50, 1.10), 30.0
    elif number in _CHILDREN:
        size, mass = (0.38, 0.38, 1.30), 35.0
    return Blueprint(f"walker.pedestrian.{number:04d}", ActorClass.WALKER, size, mass, colours=CLOTHES)


# Name after "static.prop.", box, mass and colour of what hazards set up; CARLA holds props fixed unless told otherwise,
# here the light ones give way.
_PROPS: tuple[tuple[str, tuple[float, float, float], float, tuple[Colour, ...]], ...] = (
    ("advertisement", (1.30, 0.30, 2.40), _IMMOVABLE, ((215, 215, 205),)),
    ("atm", (0.90, 0.80, 1.90), _IMMOVABLE, _GREY),
    ("barrel", (0.60, 0.60, 0.90), 20.0, _ORANGE),
    ("bench01", (1.544, 0.736, 0.970), _IMMOVABLE, _BROWN),
    ("bench02", (1.564, 0.545, 0.509), _IMMOVABLE, _BROWN),
    ("bench03", (1.583, 0.513, 0.513), _IMMOVABLE, _BROWN),
    ("bin", (0.548, 0.638, 1.059), 15.0, _GREEN),
    ("box01", (0.652, 0.652, 0.692), 10.0, _BROWN),
    ("box02", (0.649, 0.649, 0.649), 10.0, _BROWN),
    ("box03", (0.661, 0.670, 0.649), 10.0, _BROWN),
    ("busstop", (3.876, 1.894, 2.739), _IMMOVABLE, ((120, 140, 150),)),
    ("busstoplb", (1.894, 3.876, 2.739), _IMMOVABLE, ((120, 140, 150),)),
    ("cardoor", (0.12, 0.95, 1.20), _IMMOVABLE, _GREY),  # ours: an open door, for the touch
    ("chainbarrier", (1.494, 0.239, 0.889), _IMMOVABLE, _GREY),
    ("clothcontainer", (1.239, 1.887, 1.810), _IMMOVABLE, _GREEN),
    ("constructioncone", (0.344, 0.344, 0.586), 5.0, _ORANGE),
    ("container", (1.932, 1.012, 1.714), _IMMOVABLE, ((50, 105, 70),)),
    ("creasedbox01", (0.809, 0.713, 0.118), 0.0, _BROWN),
    ("creasedbox02", (1.633, 0.713, 0.212), 0.0, _BROWN),
    ("creasedbox03", (1.669, 0.713, 0.022), 0.0, _BROWN),
    ("dirtdebris01", (1.857, 1.514, 0.149), 0.0, _BROWN),
    ("dirtdebris02", (1.857, 1.514, 0.149), 0.0, _BROWN),
    ("dirtdebris03", (1.857, 1.514, 0.188), 0.0, _BROWN),
    ("doghouse", (1.079, 1.272, 1.094), _IMMOVABLE, _BROWN),
    ("foodcart", (2.285, 4.638, 3.573), _IMMOVABLE, _YELLOW),
    ("glasscontainer", (1.955, 2.009, 1.788), _IMMOVABLE, _GREEN),
    ("haybale", (1.248, 1.193, 1.195), 200.0, _YELLOW),
    ("haybalelb", (1.248, 1.193, 1.195), 200.0, _YELLOW),
    ("ironplank", (1.452, 1.174, 0.021), 0.0, _GREY),
    ("kiosk_01", (1.625, 1.654, 3.245), _IMMOVABLE, _GREEN),
    ("mailbox", (0.527, 0.438, 1.157), _IMMOVABLE, _YELLOW),
    ("maptable", (1.573, 0.617, 1.181), _IMMOVABLE, _BROWN),
    ("plantpot01", (1.089, 0.476, 0.557), _IMMOVABLE, _GREEN),
    ("plantpot02", (1.051, 0.431, 0.487), _IMMOVABLE, _GREEN),
    ("plantpot03", (1.051, 0.431, 0.487), _IMMOVABLE, _GREEN),
    ("plantpot06", (1.593, 1.593, 0.850), _IMMOVABLE, _GREEN),
    ("plasticchair", (0.730, 0.750, 1.271), 4.0, _WHITE),
    ("shoppingcart", (0.669, 1.208, 1.079), 25.0, _GREY),
    ("shoppingtrolley", (0.506, 0.331, 1.094), 15.0, _RED),
    ("streetbarrier", (1.215, 0.372, 1.069), _IMMOVABLE, ((220, 60, 45),)),
    ("streetfountain", (0.287, 0.670, 1.259), _IMMOVABLE, _GREY),
    ("streetsign", (1.064, 0.125, 2.154), _IMMOVABLE, _GREY),
    ("table", (2.156, 2.152, 0.846), _IMMOVABLE, _BROWN),
    ("trafficcone01", (0.883, 0.882, 1.133), 7.0, _ORANGE),
    ("trafficcone02", (0.456, 0.395, 1.183), 5.0, _ORANGE),
    ("trafficwarning", (2.373, 2.871, 3.570), _IMMOVABLE, _ORANGE),
    ("trashbag", (0.378, 0.430, 0.702), 8.0, _BLACK),
    ("trashcan01", (0.635, 0.568, 0.848), 15.0, _GREEN),
    ("trashcan02", (0.524, 0.514, 1.045), 15.0, _GREEN),
    ("trashcan03", (0.629, 0.545, 0.934), 15.0, _GREEN),
    ("trashcan04", (0.789, 0.580, 1.016), 15.0, _GREEN),
    ("trashcan05", (0.789, 0.580, 1.016), 15.0, _GREEN),
    ("travelcase", (0.567, 0.328, 1.263), 20.0, _RED),
    ("vendingmachine", (0.873, 1.102, 2.108), _IMMOVABLE, ((185, 35, 40),)),
    ("warningaccident", (1.305, 1.055, 1.860), _IMMOVABLE, _ORANGE),
    ("warningconstruction", (1.305, 1.055, 1.860), _IMMOVABLE, _ORANGE),
)


def _prop(name: str, size: tuple[float, float, float], mass: float, colours: tuple[Colour, ...]) -> Blueprint:
    return Blueprint(f"static.prop.{name}", ActorClass.PROP, size, mass, colours=colours, is_solid=mass > 0.0)


_TABLE = (*_VEHICLES, *(_walker(number) for number in range(1, 53)), *(_prop(*row) for row in _PROPS))
BLUEPRINTS = {blueprint.name: blueprint for blueprint in _TABLE}
# Names that older releases use for the same thing.
_ALIASES = {
    "vehicle.lincoln.mkz2017": "vehicle.lincoln.mkz_2017",
    "vehicle.dodge_charger.police": "vehicle.dodge.charger_police",
    "vehicle.mustang.mustang": "vehicle.ford.mustang",
    "vehicle.bmw.isetta": "vehicle.micro.microlino",
}


def find_blueprint(name: str) -> Blueprint:
    """The blueprint called `name`; names of older releases are known.

    Raises:
        UnknownName: there is none; the message names the nearest.
    """
    try:
        return BLUEPRINTS[_ALIASES.get(name, name)]
    except KeyError:
        raise UnknownName("blueprint", name, BLUEPRINTS) from None
