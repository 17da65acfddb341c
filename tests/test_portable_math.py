"""Angles in plain arithmetic, against numpy's extended precision."""

from __future__ import annotations

import hashlib
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lavsim import portable_math as pm
from lavsim.kernel import kernel

LONG = np.longdouble
pytestmark = pytest.mark.skipif(np.finfo(LONG).nmant < 60, reason="numpy has no extended precision here")


@kernel
def each(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """All functions of angles and shares, row by row."""
    out = np.zeros((8, len(values)))
    for i in range(len(values)):
        out[0, i], out[1, i] = pm.cos_sin(values[i])
        out[2, i] = pm.tan(values[i])
        out[3, i] = pm.atan(values[i])
        out[4, i] = pm.asin(values[i])
        out[5, i] = pm.acos(values[i])
        out[6, i] = pm.cos(values[i])
        out[7, i] = pm.sin(values[i])
    return out


@kernel
def arcs(y: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
    out = np.zeros(len(x))
    for i in range(len(x)):
        out[i] = pm.atan2(y[i], x[i])
    return out


def errors(found: NDArray[np.float64], exact: NDArray[Any]) -> float:
    """Largest error in units in the last place."""
    return float(np.max(np.abs(found.astype(LONG) - exact) / np.spacing(np.abs(exact).astype(np.float64))))


def angles() -> NDArray[np.float64]:
    rng = np.random.default_rng(0)
    near = np.arange(-5000, 5001) * (0.5 * math.pi)
    return np.concatenate(
        [rng.uniform(-7.0, 7.0, 200_000), rng.uniform(-1e5, 1e5, 200_000), near, np.nextafter(near, 9e9),
         10.0 ** rng.uniform(-12.0, 0.0, 50_000), [0.0]]
    )  # fmt: skip


def test_sine_and_cosine_are_right_to_the_last_bit_or_so() -> None:
    x = angles()
    cos, sin, tan, *_, cos_alone, sin_alone = each(x)
    wide = x.astype(LONG)
    away = np.abs(np.sin(2.0 * wide)) > 1e-9  # beside the zeros extended precision itself falls short
    assert errors(sin[away], np.sin(wide[away])) < 0.8
    assert errors(cos[away], np.cos(wide[away])) < 0.8
    assert errors(tan[away], np.tan(wide[away])) < 2.5
    assert np.array_equal(cos, cos_alone)
    assert np.array_equal(sin, sin_alone)


def test_multiples_of_a_quarter_turn_leave_the_error_of_pi() -> None:
    """sin(fl(k pi)) is what the float k pi lacks: about its rounding error, which the reduction must not lose."""
    k = np.arange(1, 20_000)
    cos, sin, *_ = each((k * math.pi).astype(np.float64))
    libm = np.array([math.sin(v) for v in k * math.pi])
    assert np.max(np.abs(sin - libm) / np.abs(libm)) < 1e-15
    assert np.array_equal(cos, np.where(k % 2, -1.0, 1.0))


def test_arcs_are_right_to_the_last_bits() -> None:
    rng = np.random.default_rng(1)
    x = np.concatenate(
        [rng.uniform(-1.0, 1.0, 200_000), np.linspace(-1.0, 1.0, 10_001), 10.0 ** rng.uniform(-9, 0, 9_999)]
    )
    _, _, _, atan, asin, acos, *_ = each(x)
    assert errors(atan, np.arctan(x.astype(LONG))) < 1.5
    assert errors(asin, np.arcsin(x.astype(LONG))) < 2.0
    inside = np.abs(x) < 1.0
    assert errors(acos[inside], np.arccos(x[inside].astype(LONG))) < 2.0
    y, x = rng.normal(size=300_000) * 10.0 ** rng.uniform(-5, 5, 300_000), rng.normal(size=300_000)
    assert errors(arcs(y, x), np.arctan2(y.astype(LONG), x.astype(LONG))) < 1.5


@pytest.mark.parametrize("y", [0.0, -0.0, 1.0, -1.0, 3e-300])
@pytest.mark.parametrize("x", [0.0, -0.0, 1.0, -1.0, 3e300])
def test_the_axes_are_those_of_the_library(y: float, x: float) -> None:
    found = float(arcs(np.array([y]), np.array([x]))[0])
    assert math.isclose(found, math.atan2(y, x), rel_tol=1e-15)
    assert math.copysign(1.0, found) == math.copysign(1.0, math.atan2(y, x))


def test_what_is_no_angle_gives_nan() -> None:
    with np.errstate(invalid="ignore"):
        assert np.isnan(each(np.array([math.nan]))).all()
        assert np.isnan(each(np.array([math.inf]))).all()
        assert np.isnan(each(np.array([1.5]))[4:6]).all()


def test_the_bits_are_those_of_every_machine() -> None:
    """Golden: another digest here means that this machine or compiler breaks the promise of the module."""
    rng = np.random.default_rng(3)
    x = np.concatenate(
        [rng.uniform(-1.0, 1.0, 50_000), rng.uniform(-10.0, 10.0, 50_000), rng.uniform(-1e5, 1e5, 50_000)]
    )
    out = each(x)
    turned = arcs(out[1], out[0])
    digest = hashlib.blake2b(np.ascontiguousarray(np.nan_to_num(out)).tobytes() + turned.tobytes(), digest_size=8)
    assert digest.hexdigest() == "1a08e28b8abb9d59"


def test_snapping_takes_the_last_bits_off() -> None:
    x = np.random.default_rng(2).uniform(-1e4, 1e4, 10_000)
    assert np.max(np.abs(pm.snapped(x) - x)) <= pm.GRID / 2.0
    assert np.array_equal(pm.snapped(pm.snapped(x)), pm.snapped(x))
    same = pm.snapped(np.nextafter(x, np.inf)) == pm.snapped(x)
    assert same.mean() > 0.999
