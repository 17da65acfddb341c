"""Blocks of ticks: every bit comes back, and what is foreseen costs little."""

from dataclasses import replace

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from lavsim.log.codec import Block, decode_block, encode_block
from lavsim.world.snapshot import Snapshot, quantise_poses, quantise_velocities
from tests.log.made import assert_same, snapshot_at
from tests.snapshots import Body, snapshot_of

DERIVED = ("xyz", "yaw", "pitch", "velocities", "speeds", "sizes", "classes", "roles", "is_vehicle", "is_background")


def assert_comes_back(snapshots: list[Snapshot], starts: np.ndarray) -> None:
    block, table = Block.of(snapshots), snapshots[-1].table
    again = decode_block(encode_block(block, table, starts), block.first, len(block), table, starts)
    in_order = list(again.snapshots(table))
    assert len(in_order) == len(snapshots)
    for index, before in enumerate(snapshots):
        assert_same(before, again.snapshot(index, table))
        assert_same(before, in_order[index])
        for name in DERIVED:
            alone, together = getattr(before, name), getattr(in_order[index], name)
            assert (alone.dtype, alone.tobytes()) == (together.dtype, together.tobytes()), name
        assert before.ego == in_order[index].ego


@given(seed=st.integers(0, 10_000), ticks=st.integers(1, 30), actors=st.integers(1, 12))
@settings(max_examples=40, deadline=None)
def test_a_block_gives_back_every_bit(seed: int, ticks: int, actors: int) -> None:
    rng = np.random.default_rng(seed)
    snapshots = [snapshot_at(100 + t, actors, rng) for t in range(ticks)]
    assert_comes_back(snapshots, rng.integers(-(2**31), 2**31 - 1, (actors, 11)).astype(np.int32))


SMALLEST = np.full((4, 11), -(2**31), np.int32)
SMALLEST[0, 7] = 0  # a step to the smallest integer leaves a residual that is the smallest integer


@given(values=hnp.arrays(np.int32, (4, 11)))
@example(values=SMALLEST)
@settings(max_examples=20, deadline=None)
def test_extreme_integers_survive(values: np.ndarray) -> None:
    assert_comes_back(moving(values), np.zeros((1, 11), np.int32))


@given(values=hnp.arrays(np.int32, (6, 11), elements=st.integers(-3, 3)), yaw=st.sampled_from([-32768, 32767, 0]))
@settings(max_examples=40, deadline=None)
def test_angles_and_gait_may_pass_their_seams(values: np.ndarray, yaw: int) -> None:
    values[:, 3:5] = (values[:, 3:5] + yaw + 32768) % 65536 - 32768
    values[:, 10] %= 256
    assert_comes_back(moving(values), np.zeros((1, 11), np.int32))


def moving(values: np.ndarray) -> list[Snapshot]:
    """Snapshots of one actor with `values` (T, 11) over time."""
    base = snapshot_at(0, 1, np.random.default_rng(0))
    return [
        replace(base, tick=t, pose=v[None, :5].copy(), velocity=v[None, 5:8].copy(), state=v[None, 8:].copy())
        for t, v in enumerate(values)
    ]


def driving(count: int, ticks: int, speed: float) -> list[Snapshot]:
    """Cars on circles of 20 to 60 m, speeding up and slowing down around `speed` [m/s]; their rear axles roll."""
    radius, length = np.linspace(20.0, 60.0, count), 4.5
    time = 0.05 * np.arange(ticks)[:, None]
    angle = (speed * time + 3.0 * np.sin(0.3 * time)) / radius * (speed > 0.0) + np.arange(count)
    pace = (speed + 0.9 * np.cos(0.3 * time)) * (speed > 0.0)
    slip = np.arcsin(0.29 * length / radius)
    at = np.stack([radius * np.sin(angle), -radius * np.cos(angle), 0.0 * angle], axis=-1)
    course = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)
    bodies = [Body(id=1 + k, size=(length, 1.9, 1.5)) for k in range(count)]
    base = snapshot_of(bodies)
    return [
        replace(
            base,
            tick=t,
            pose=quantise_poses(at[t], angle[t] - slip, 0.0 * slip),
            velocity=quantise_velocities(pace[t][:, None] * course[t]),
        )
        for t in range(ticks)
    ]


def size_of(snapshots: list[Snapshot]) -> int:
    block = Block.of(snapshots)
    return len(encode_block(block, snapshots[-1].table, block.starts()))


def test_driving_in_bends_costs_less_than_a_byte_and_rest_nothing() -> None:
    ticks = 200
    at_rest = size_of(driving(100, ticks, 0.0))
    assert at_rest < 400
    on_the_move = size_of(driving(100, ticks, 10.0))
    assert (on_the_move - at_rest) / (100 * ticks) < 0.9
