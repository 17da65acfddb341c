"""The recorded drive that these tests share."""

from pathlib import Path

import pytest

from tests.dataset.recorded import make_dataset


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of two short episodes; not to be changed."""
    return make_dataset(tmp_path_factory.mktemp("dataset"))
