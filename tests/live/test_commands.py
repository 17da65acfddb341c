"""Messages from pages: what is no command is refused in words, whatever it is."""

from __future__ import annotations

import contextlib
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lavsim.live.commands import CommandError, parse
from lavsim.live.wheel import Keys, Wheel

GOOD = [
    {"do": "drive", "throttle": 1, "brake": 0.5, "steer": -1.0},
    {"do": "reverse"},
    {"do": "pause", "on": True},
    {"do": "step", "ticks": 3},
    {"do": "speed", "value": 0},
    {"do": "speed", "value": 0.25},
    {"do": "hazards"},
    {"do": "hazard", "type": "DynamicObjectCrossing"},
    {"do": "save"},
    {"do": "look", "tick": 7},
    {"do": "fork", "tick": 7},
    {"do": "restart", "seed": 3},
    {"do": "seen", "frame": 1},
]
BAD = [
    "", "{", "nonsense", "[]", "3", "null", '"drive"', "[" * 4000, b"\x00\xff", b'{"do":"save"}', "{}", '{"do":"fly"}',
    '{"do":["save"]}',
    '{"do":"save","now":1}', '{"do":"drive"}', '{"do":"drive","throttle":NaN,"brake":0,"steer":0}',
    '{"do":"drive","throttle":1e999,"brake":0,"steer":0}', '{"do":"drive","throttle":2,"brake":0,"steer":0}',
    '{"do":"drive","throttle":true,"brake":0,"steer":0}', '{"do":"drive","throttle":"1","brake":0,"steer":0}',
    '{"do":"pause","on":1}', '{"do":"step","ticks":0}', '{"do":"step","ticks":1.0}', '{"do":"speed","value":0.1}',
    '{"do":"speed","value":9}', '{"do":"speed","value":-1}', '{"do":"hazard","type":""}',
    '{"do":"hazard","type":"a\\u0000b"}',
    '{"do":"look","tick":-1}', '{"do":"restart","seed":2147483648}', '{"do":"save","do":7}',
]  # fmt: skip


@pytest.mark.parametrize("message", GOOD, ids=lambda m: str(m["do"]))
def test_commands_are_taken(message: dict[str, object]) -> None:
    command = parse(json.dumps(message))
    assert {"do": command.name, **command.values} == message


@pytest.mark.parametrize("message", BAD, ids=lambda m: repr(m)[:40])
def test_anything_else_is_refused(message: str | bytes) -> None:
    with pytest.raises(CommandError):
        parse(message)


VALUES = st.none() | st.booleans() | st.integers() | st.floats() | st.text()
NAMES = st.sampled_from(["do", "on", "tick", "drive", "x"])
OBJECTS = st.recursive(
    VALUES, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(NAMES, inner, max_size=4), max_leaves=8
)


@given(st.one_of(st.text(), st.binary(), OBJECTS.map(json.dumps)))
def test_no_message_raises_anything_but_its_refusal(message: str | bytes) -> None:
    with contextlib.suppress(CommandError):
        parse(message)


def test_wheel_follows_the_keys_smoothly_and_comes_back() -> None:
    wheel = Wheel()
    wheel.keys = Keys(throttle=1.0, steer=1.0)
    steers = [wheel.turn(0.0).steer for _ in range(20)]
    assert steers[0] < 0.1
    assert steers == sorted(steers)
    assert steers[-1] == 1.0
    assert wheel.control.throttle == 1.0
    wheel.keys = Keys()
    back = [wheel.turn(0.0) for _ in range(10)]
    assert back[-1].steer == back[-1].throttle == 0.0
    assert back[0].steer > 0.8


def test_keys_alone_steer_less_at_speed_and_change_gear_only_at_walking_pace() -> None:
    wheel = Wheel()
    wheel.keys = Keys(steer=-1.0)
    for _ in range(40):
        wheel.turn(14.0)
    assert -0.3 < wheel.control.steer < -0.05
    wheel.wants_reverse = True
    assert not wheel.turn(14.0).reverse
    assert wheel.turn(0.2).reverse
    wheel.wants_reverse = False
    assert wheel.turn(-5.0).reverse
    assert not wheel.turn(-0.2).reverse
