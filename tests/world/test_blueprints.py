"""The blueprint table is complete and sane."""

import re

import pytest

from lavsim.errors import UnknownName
from lavsim.random import Draws
from lavsim.types import ActorClass
from lavsim.world.blueprints import BLUEPRINTS, find_blueprint
from lavsim.world.dynamics import HANDLING

VEHICLES = [kind for kind in BLUEPRINTS.values() if kind.actor_class.is_vehicle]


@pytest.mark.parametrize("kind", BLUEPRINTS.values(), ids=lambda kind: kind.name)
def test_every_blueprint_has_a_sane_box_and_colours(kind) -> None:  # type: ignore[no-untyped-def]
    length, width, height = kind.size
    assert 0.1 < length < 11.0
    assert 0.1 < width < 5.0
    assert 0.0 < height < 4.0
    assert re.fullmatch(r"(vehicle|walker|static)\.[\w-]+\.[\w]+", kind.name)
    assert all(0 <= channel <= 255 for colour in kind.colours for channel in colour)
    if kind.actor_class.is_vehicle:
        assert kind.actor_class in HANDLING
        assert width <= 2.9
        assert 80.0 <= kind.mass <= 15_000.0
        assert kind.number_of_wheels in (2, 4)
        assert kind.base_type == kind.actor_class.name.lower()
    else:
        assert kind.weight == 0.0
        assert kind.number_of_wheels == 0
        assert kind.base_type == ""


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("vehicle.lincoln.mkz_2017", (4.902, 2.128, 1.511)),
        ("vehicle.lincoln.mkz_2020", (4.892, 1.837, 1.490)),
        ("vehicle.nissan.patrol_2021", (5.566, 2.150, 2.045)),
        ("vehicle.carlamotors.firetruck", (8.468, 2.891, 3.827)),
        ("vehicle.gazelle.omafiets", (1.843, 0.659, 1.776)),
        ("walker.pedestrian.0001", (0.38, 0.38, 1.86)),
        ("walker.pedestrian.0013", (0.38, 0.38, 1.30)),
        ("walker.pedestrian.0049", (0.50, 0.50, 1.10)),
    ],
)
def test_boxes_are_those_of_the_reference(name: str, size: tuple[float, float, float]) -> None:
    assert find_blueprint(name).size == size


def test_background_traffic_is_mostly_cars_and_nothing_in_it_is_too_big_for_a_turn() -> None:
    total = sum(kind.weight for kind in VEHICLES)
    share = {c: sum(k.weight for k in VEHICLES if k.actor_class == c) / total for c in ActorClass}
    assert share[ActorClass.CAR] > 0.7
    assert 0.005 < share[ActorClass.TRUCK] < 0.05
    assert 0.05 < share[ActorClass.MOTORCYCLE] + share[ActorClass.BICYCLE] < 0.2
    # A box that follows the middle of a turn of 9.3 m radius stays within its lane of 3.3 m.
    for kind in VEHICLES:
        length, width, _ = kind.size
        swept = ((9.3 + width / 2) ** 2 + (length / 2) ** 2) ** 0.5 - 9.3
        assert kind.weight == 0.0 or swept < 1.7, kind.name


def test_emergency_vehicles_are_marked() -> None:
    assert {kind.name.split(".")[-1] for kind in VEHICLES if kind.is_emergency} == {
        "ambulance", "firetruck", "charger_police", "charger_police_2020"
    }  # fmt: skip


def test_old_names_are_known_and_wrong_ones_refused() -> None:
    assert find_blueprint("vehicle.lincoln.mkz2017").name == "vehicle.lincoln.mkz_2017"
    with pytest.raises(UnknownName, match=r"Did you mean 'vehicle.audi.tt'"):
        find_blueprint("vehicle.audi.ttt")


def test_a_colour_depends_on_the_actor_alone() -> None:
    draws, kind = Draws.of_seed(3), find_blueprint("vehicle.seat.leon")
    assert [kind.colour(draws, k) for k in range(9)] == [kind.colour(draws, k) for k in range(9)]
    assert len({kind.colour(draws, k) for k in range(60)}) > 5
