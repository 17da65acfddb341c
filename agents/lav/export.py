"""Networks with fixed sizes and folded normalisation, for driving: TorchScript beside the weights.

Only what is convolution is exported: segmentation, brake, and the bird's-eye network of perception and of the student.
Pillars sort points, of which there is another number in each scan; they and the motions stay in PyTorch. The weights
remain the primary file: an exported one belongs to the version of PyTorch that wrote it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn

from agents.lav.config import LavConfig
from agents.lav.models.brake import BrakeNetwork, telephoto_size
from agents.lav.models.segmentation import make_segmentation
from agents.lav.models.student import Perception, Student
from agents.lav.weights import Weights, digest_of_file, read_weights
from lavsim.errors import ConfigError

SUFFIX = ".torchscript"
_DIGEST = "weights"  # name of the extra file that says which weights it was made from


class Exportable(NamedTuple):
    """A part of a stage's network.

    Attributes:
        network: The part, in evaluation mode.
        inputs: Of the sizes that it is made for.
    """

    network: nn.Module
    inputs: tuple[Tensor, ...]


def export(path: Path) -> Path:
    """Writes what drives from a weights' file as TorchScript beside it.

    Returns:
        The file.

    Raises:
        ConfigError: there are no such weights, or their stage has nothing to export.
    """
    part = exportable(read_weights(path))
    with torch.no_grad():
        # Tracing names the outputs by their place: a named tuple comes out as a plain one.
        script = torch.jit.trace(part.network, part.inputs, strict=False)
        frozen = torch.jit.freeze(script)
    target = path.with_suffix(SUFFIX)
    partial = target.with_name(target.name + ".partial")
    torch.jit.save(frozen, str(partial), _extra_files={_DIGEST: digest_of_file(path)})
    partial.replace(target)
    return target


def read_exported(path: Path) -> torch.jit.ScriptModule:
    """What `export` made of a weights' file.

    Raises:
        ConfigError: it was not exported, or from other weights.
    """
    target = path.with_suffix(SUFFIX)
    if not target.exists():
        raise ConfigError(f"{path.name} was not exported: `lavsim train … --export` does it.")
    notes = {_DIGEST: ""}
    try:
        script = torch.jit.load(str(target), _extra_files=notes)
    except RuntimeError as error:
        raise ConfigError(f"{target.name} can't be read: {str(error).splitlines()[0]}") from None
    found = notes[_DIGEST]
    if (found.decode() if isinstance(found, bytes) else found) != digest_of_file(path):
        raise ConfigError(f"{target.name} was made from other weights than {path.name} holds.")
    return script


def exportable(weights: Weights) -> Exportable:
    """The part of a stage's network that is exported.

    Raises:
        ConfigError: its stage has none.
    """
    try:
        make = _PARTS[weights.stage]
    except KeyError:
        raise ConfigError(f"stage {weights.stage!r} has nothing to export; {', '.join(_PARTS)} have.") from None
    part = make(weights.config, weights.tensors)
    return Exportable(part.network.eval().requires_grad_(False), part.inputs)


def _segmentation(config: LavConfig, tensors: Mapping[str, Tensor]) -> Exportable:
    network = make_segmentation(config.segmentation)
    network.load_state_dict(tensors)
    return Exportable(network, (torch.zeros(3, 3, config.cameras.height, config.cameras.width),))


def _brake(config: LavConfig, tensors: Mapping[str, Tensor]) -> Exportable:
    network, cameras = BrakeNetwork(config), config.cameras
    network.load_state_dict(tensors)
    wide = torch.zeros(1, 3, cameras.height, 3 * cameras.width)
    return Exportable(network, (wide, torch.zeros(1, 3, *telephoto_size(config))))


def _perception(config: LavConfig, tensors: Mapping[str, Tensor]) -> Exportable:
    network = Perception(config)
    network.load_state_dict(tensors)
    return _backbone(network, config)


def _full(config: LavConfig, tensors: Mapping[str, Tensor]) -> Exportable:
    network = Student(config)
    network.load_state_dict(tensors)
    return _backbone(network.perception, config)


def _backbone(network: Perception, config: LavConfig) -> Exportable:
    image = torch.zeros(1, network.pillars.channels, config.grid.rows, config.grid.cols)
    return Exportable(network.backbone, (image.contiguous(memory_format=torch.channels_last),))


_PARTS: Mapping[str, Callable[[LavConfig, Mapping[str, Tensor]], Exportable]] = {
    "segmentation": _segmentation,
    "brake": _brake,
    "perception": _perception,
    "full": _full,
}
EXPORTED = frozenset(_PARTS)  # stages
