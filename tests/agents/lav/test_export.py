"""Exported networks say what the networks say."""

from __future__ import annotations

from pathlib import Path

import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.config import find_preset
from agents.lav.export import export, exportable, read_exported
from agents.lav.models.brake import BrakeNetwork
from agents.lav.models.segmentation import make_segmentation
from agents.lav.models.student import Perception, Student
from agents.lav.models.teacher import make_teacher
from agents.lav.weights import Weights, read_weights, write_weights
from lavsim.errors import ConfigError

MICRO = find_preset("micro")
MAKERS = {
    "segmentation": lambda: make_segmentation(MICRO.segmentation),
    "brake": lambda: BrakeNetwork(MICRO),
    "perception": lambda: Perception(MICRO),
    "full": lambda: Student(MICRO),
    "bev": lambda: make_teacher(MICRO),
}


def written(folder: Path, stage: str) -> Path:
    """Weights of a network whose normalisation has seen something."""
    torch.manual_seed(3)
    network = MAKERS[stage]()
    for name, value in network.state_dict().items():
        if name.endswith("running_mean"):
            value.normal_(0.0, 0.3)
        if name.endswith("running_var"):
            value.uniform_(0.5, 2.0)
    path = folder / f"{stage}.safetensors"
    write_weights(path, Weights(stage, MICRO, network.state_dict(), {}))
    return path


@pytest.mark.parametrize("stage", ["segmentation", "brake", "perception", "full"])
def test_an_exported_network_says_the_same(tmp_path: Path, stage: str) -> None:
    path = written(tmp_path, stage)
    export(path)
    part = exportable(read_weights(path))
    inputs = [torch.rand(value.shape, generator=torch.Generator().manual_seed(7)) for value in part.inputs]
    with torch.no_grad():
        expected, found = part.network(*inputs), read_exported(path)(*inputs)
    pairs = zip(expected, found, strict=True) if isinstance(expected, tuple) else [(expected, found)]
    for wanted, got in pairs:
        assert torch.allclose(wanted, got, atol=1e-5, rtol=1e-5)


def test_what_was_not_exported_or_from_other_weights_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "perception")
    with pytest.raises(ConfigError, match="was not exported"):
        read_exported(path)
    target = export(path)
    weights = read_weights(path)
    write_weights(path, Weights("perception", MICRO, weights.tensors, {"seed": 1}))
    with pytest.raises(ConfigError, match="made from other weights"):
        read_exported(path)
    target.write_bytes(b"no script")
    with pytest.raises(ConfigError, match="can't be read"):
        read_exported(path)
    with pytest.raises(ConfigError, match="'bev' has nothing to export"):
        export(written(tmp_path, "bev"))
