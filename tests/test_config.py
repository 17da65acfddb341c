"""Configuration trees: files, overrides, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import Field

from lavsim.config import Config, parse_config, read_config, resolved
from lavsim.errors import ConfigError


class Motor(Config):
    power: float = Field(default=100.0, gt=0.0, description="[kW]")
    name: str = "small"


class Car(Config):
    doors: int = 4
    motor: Motor = Motor()
    colours: tuple[str, ...] = ("red",)


def test_overrides_come_after_the_file_and_the_file_after_the_base(tmp_path: Path) -> None:
    file = tmp_path / "car.toml"
    file.write_text("doors = 2\n[motor]\npower = 50\n")
    base = Car(motor=Motor(power=1.0, name="tiny"), colours=("blue",))
    car = read_config(Car, file, ["motor.power=75.5", 'colours=["green", "red"]'], base)
    assert car == Car(doors=2, motor=Motor(power=75.5, name="tiny"), colours=("green", "red"))
    assert read_config(Car, sets=["motor.name=large"]).motor.name == "large", "a bare word is a text"
    assert parse_config(Car, resolved(car)) == car


@pytest.mark.parametrize(
    ("sets", "message"),
    [
        (["motor.powr=3"], "unknown key 'motor.powr'. Did you mean 'power'?"),
        (["weels=3"], "unknown key 'weels'. Known: doors, motor, colours."),
        (["motor.power=-1"], "motor.power: Input should be greater than 0, got -1."),
        (["doors=many"], "doors: Input should be a valid integer"),
        (["doors"], "--set expects a.b=value, got 'doors'."),
        (["motor=3"], "motor: Input should be"),
    ],
)
def test_what_does_not_fit_is_named(sets: list[str], message: str) -> None:
    with pytest.raises(ConfigError) as error:
        read_config(Car, sets=sets)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_broken_file_is_named(tmp_path: Path) -> None:
    file = tmp_path / "car.toml"
    with pytest.raises(ConfigError, match="can't read the configuration"):
        read_config(Car, file)
    file.write_text("doors = = 2")
    with pytest.raises(ConfigError, match=r"car.toml is no TOML"):
        read_config(Car, file)
