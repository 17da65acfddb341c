"""The draws of `lavsim.random`, one number at a time, for use inside kernels.

`draw_bits(draws.key, tick, index)` is the same word as `draws.bits(tick, index + 1)[index]`.
"""

from __future__ import annotations

import numpy as np

from lavsim.kernel import kernel

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)


@kernel
def mix_word(value: np.uint64) -> np.uint64:
    """Finaliser of splitmix64."""
    value = (value ^ (value >> np.uint64(30))) * _MIX_1
    value = (value ^ (value >> np.uint64(27))) * _MIX_2
    return value ^ (value >> np.uint64(31))


@kernel
def draw_base(key: np.uint64, tick: int) -> np.uint64:
    """What all draws of a stream at one tick share; pass it to `draw_at`."""
    return mix_word(np.uint64(tick) * _GOLDEN + np.uint64(key))


@kernel
def draw_at(base: np.uint64, index: int) -> np.uint64:
    """Word number `index` of a tick."""
    return mix_word(np.uint64(base) + (np.uint64(index) + np.uint64(1)) * _GOLDEN)


@kernel
def unit_at(base: np.uint64, index: int) -> float:
    """Number `index` of a tick in [0, 1)."""
    return float(draw_at(base, index) >> np.uint64(11)) * 2.0**-53
