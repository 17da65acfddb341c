"""Weather that is drawn anew every ten seconds: what jumps, what moves, and how it survives a log."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lavsim.errors import ConfigError
from lavsim.log.reader import LogReader
from lavsim.log.replay import resume
from lavsim.log.writer import LogWriter
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import Control
from lavsim.world.weather import Weather
from lavsim.world.weather_redrawn import RedrawnWeather
from tests.drives import straight_drive

PERIOD = 200  # ticks


class Ended:
    def summary(self) -> dict[str, str]:
        return {"ending": "tick limit"}


def but_for_the_sun(weather: Weather) -> list[float]:
    return [*weather.to_array()[:4].tolist(), *weather.to_array()[6:].tolist()]


def test_all_but_the_sun_holds_for_ten_seconds_and_then_jumps() -> None:
    weather = RedrawnWeather(seed=3)
    first = [but_for_the_sun(weather.at(tick)) for tick in range(PERIOD)]
    assert first == [first[0]] * PERIOD
    assert but_for_the_sun(weather.at(PERIOD)) != first[0]


@given(st.integers(0, 2**40), st.integers(0, 10**6))
def test_the_sun_moves_steadily_and_all_values_keep_to_their_ranges(seed: int, tick: int) -> None:
    weather = RedrawnWeather(seed)
    now, then = weather.at(tick), weather.at(tick + 1)
    turn = (then.sun_azimuth_angle - now.sun_azimuth_angle + 180.0) % 360.0 - 180.0
    assert abs(turn) <= 180.0 / PERIOD + 0.02
    assert abs(then.sun_altitude_angle - now.sun_altitude_angle) <= 100.0 / PERIOD + 0.02
    assert 0.0 <= now.sun_azimuth_angle < 360.0
    assert -50.0 <= now.sun_altitude_angle <= 50.0
    assert 0.0 <= now.cloudiness <= 90.0
    assert now.precipitation <= 80.0
    assert now.fog_density <= 80.0
    assert now.precipitation_deposits <= 50.0 or now.precipitation_deposits >= 30.0
    assert (now.precipitation == now.fog_density == now.wetness == 0.0) or now.precipitation_deposits >= 30.0


def test_half_of_the_draws_are_dry_and_about_half_are_at_night() -> None:
    drawn = [RedrawnWeather(seed).at(PERIOD // 2) for seed in range(400)]
    assert np.mean([weather.precipitation == 0.0 for weather in drawn]) == pytest.approx(0.5, abs=0.08)
    assert np.mean([weather.is_night for weather in drawn]) == pytest.approx(0.5, abs=0.08)
    assert len({weather.wind_intensity for weather in drawn}) == 3  # those of CARLA's presets


def test_a_drive_in_redrawn_weather_comes_back_from_its_log(tmp_path: Path) -> None:
    spec = straight_drive(weather=RedrawnWeather(seed=5, period=1.0))
    simulation = Simulation(spec)
    writer = LogWriter(tmp_path / "a.lavlog")
    writer.start(simulation)
    for _ in range(50):
        writer.observe(simulation.snapshot)
        simulation.tick(Control(throttle=0.5))
    writer.finish(Ended())  # type: ignore[arg-type]
    reader = LogReader(tmp_path / "a.lavlog")
    assert DriveSpec.from_header(reader.header).weather == spec.weather
    assert isinstance(spec.weather, RedrawnWeather)
    assert np.array_equal(reader[29].weather_values, spec.weather.at(30).to_array())
    assert len({snapshot.weather.cloudiness for snapshot in reader}) == 3
    assert resume(reader, 45).snapshot.weather == reader[44].weather


def test_a_period_shorter_than_a_tick_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"at least 0\.05 s, got 0"):
        RedrawnWeather(period=0.0)
