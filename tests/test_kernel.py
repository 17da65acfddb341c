"""Compiled kernels are cached, and forgotten when anything they were compiled from has changed."""

from __future__ import annotations

import importlib

import numba
import pytest

from lavsim import kernel as kernels
from lavsim.kernel import kernel


@kernel
def doubled(value: float) -> float:
    return 2.0 * value


def test_kernels_run_and_leave_numbas_own_setting_alone() -> None:
    assert doubled(3.0) == 6.0
    assert numba.config.CACHE_DIR == ""


@pytest.mark.parametrize(
    ("module", "part", "other"),
    [
        ("lavsim.traffic.drive", "lavsim.traffic.following", "lavsim.map.town_map"),  # a callee; a mere type
        ("lavsim.world.motion", "lavsim.types", "lavsim.world.world"),  # a constant; who calls it
        ("lavsim.random", "lavsim.random", "lavsim.kernel_draws"),
    ],
)
def test_a_cache_is_named_by_all_that_is_compiled_in(
    module: str, part: str, other: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    importlib.import_module(module)
    before, text = kernels._digest(module), kernels._text
    monkeypatch.setattr(kernels, "_text", lambda name: text(name) + "# changed" * (name == other))
    assert kernels._digest(module) == before
    monkeypatch.setattr(kernels, "_text", lambda name: text(name) + "# changed" * (name == part))
    assert kernels._digest(module) != before
