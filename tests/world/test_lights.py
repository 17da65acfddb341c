"""Traffic lights cycle after CARLA's rule."""

from lavsim.map.signal import LightGroup
from lavsim.types import LightState
from lavsim.world.lights import TrafficLights

RED, YELLOW, GREEN = LightState.RED, LightState.YELLOW, LightState.GREEN


def test_phases_run_one_after_another() -> None:
    lights = TrafficLights(4, [LightGroup(0, ((0,), (1, 2), (3,)))])
    assert lights.states(0.0).tolist() == [GREEN, RED, RED, RED]
    assert lights.states(10.0).tolist() == [YELLOW, RED, RED, RED]
    assert lights.states(13.0).tolist() == [RED, RED, RED, RED]
    assert lights.states(15.0).tolist() == [RED, GREEN, GREEN, RED]
    assert lights.states(30.0).tolist() == [RED, RED, RED, GREEN]
    assert lights.states(45.0).tolist() == lights.states(0.0).tolist()


def test_a_light_of_no_group_is_green_and_a_held_one_stays() -> None:
    lights = TrafficLights(2, [LightGroup(0, ((0,),))])
    assert lights.states(14.0).tolist() == [RED, GREEN]
    lights.hold(1, RED)
    assert lights.states(99.0)[1] == RED
    lights.release(1)
    assert lights.states(99.0)[1] == GREEN
