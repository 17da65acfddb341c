"""Cloning's tests use one thread, as LAV's do: results must not depend on them."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")
    torch.set_num_threads(1)
