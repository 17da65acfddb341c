"""Whether to stop, from the panorama and the telephoto image: red lights, stop signs, hazards (paper, appendix)."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from agents.lav.config import LavConfig
from agents.lav.models.resnet import STRIDE, ResNet
from lavsim.types import Tag

# Classes of the auxiliary segmentation, which keeps the trunk on what matters; everything else is background.
AUXILIARY_TAGS = (Tag.PEDESTRIAN, Tag.VEHICLE, Tag.TRAFFIC_LIGHT)
_AUXILIARY_WEIGHTS = (1.0, 4.0, 1.0, 8.0)  # walkers and lights are few pixels
OUTPUTS = 8  # of a network that tells causes: stop, no light, red, yellow, green, stop sign, others, distance
DISTANCE_UNIT = 10.0  # [m] of the last of them
_CELL_CHANNELS, _HIDDEN = 24, 64
_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


class Causes(NamedTuple):
    """Logits of a network that tells causes apart.

    Attributes:
        stop, sign, others: (B,) whether the expert would stop; whether a stop sign is ahead; whether somebody or
            something in the way stops it.
        light: (B, 4) none, red, yellow, green: of the light that governs the ego, up to 40 m ahead.
        distance: (B,) from the ego's front to the line of that light or sign [m]; no logit.
    """

    stop: Tensor
    light: Tensor
    sign: Tensor
    others: Tensor
    distance: Tensor


def causes_of(outputs: Tensor) -> Causes:
    """What the outputs (B, 8) of a network say."""
    stop, sign, others, distance = (outputs[:, place] for place in (0, 5, 6, 7))
    return Causes(stop, outputs[:, 1:5], sign, others, DISTANCE_UNIT * distance)


def stop_of(outputs: Tensor) -> Tensor:
    """Logits (B,) of a full stop in the outputs (B,) or (B, 8) of a network."""
    return outputs if outputs.ndim == 1 else outputs[:, 0]


class BrakeNetwork(nn.Module):
    """One trunk for both images, averaged over each, and a logit; or eight that tell causes (`causes_of`).

    Causes depend on where things are (which of a junction's lights is the ego's), so these look at the cells of both
    maps beside their averages.

    Args:
        config: Sizes.
        attention: Pool by attention instead of averages: the leaderboard entry's.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, config: LavConfig, attention: bool = False) -> None:
        super().__init__()
        features = config.brake.features
        self.trunk = ResNet(config.brake, 3)
        self.pools = nn.ModuleList(_AttentionPool(features) if attention else nn.AdaptiveAvgPool2d(1) for _ in range(2))
        self.cells = _Cells(config) if config.brake.causes else None
        self.out = nn.Linear(2 * features + (_HIDDEN if self.cells else 0), OUTPUTS if self.cells else 1)
        widths = [features, features // 2, features // 4, features // 8]
        self.auxiliary = nn.Sequential(
            *(_up(a, b) for a, b in pairwise(widths)),
            nn.Conv2d(widths[-1], 1 + len(AUXILIARY_TAGS), 1),
        )
        self.register_buffer("mean", torch.tensor(_MEAN).view(1, 3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(_STD).view(1, 3, 1, 1), persistent=False)

    def forward(
        self, panorama: Tensor, telephoto: Tensor, with_tags: bool = False
    ) -> Tensor | tuple[Tensor, Tensor, Tensor]:
        """Logits (B,) of stopping; or (B, 8).

        Args:
            panorama: (B, 3, H, 3 W) red, green, blue, 0 to 1: left, centre, right beside each other.
            telephoto: (B, 3, h, w) without its lowest third, or its sharp middle.
            with_tags: Gives the auxiliary logits (B, 4, H / 4, W / 4) of each image too.
        """
        logit, maps = self._run(panorama, telephoto)
        return (logit, self.auxiliary(maps[0]), self.auxiliary(maps[1])) if with_tags else logit

    def _run(self, panorama: Tensor, telephoto: Tensor) -> tuple[Tensor, list[Tensor]]:
        maps = [self.trunk((image - self.mean) / self.std) for image in (panorama, telephoto)]
        pooled = [pool(features).flatten(1) for pool, features in zip(self.pools, maps, strict=True)]
        if self.cells is None:
            return self.out(torch.cat(pooled, dim=1))[:, 0], maps
        return self.out(torch.cat([*pooled, self.cells(maps)], dim=1)), maps


def auxiliary_labels(tags: Tensor) -> Tensor:
    """Classes (B, H / 4, W / 4) of semantic tags (B, H, W): the last one of the list in each square of four by four.

    So a lamp two pixels wide is not lost between the squares.
    """
    table = torch.zeros(256, device=tags.device)
    for number, tag in enumerate(AUXILIARY_TAGS):
        table[int(tag)] = number + 1
    return functional.max_pool2d(table[tags.long()], 4, ceil_mode=True).long()


def auxiliary_loss(logits: Tensor, tags: Tensor) -> Tensor:
    """Weighted cross entropy of auxiliary logits and semantic tags (B, H, W)."""
    labels = auxiliary_labels(tags)
    weights = torch.tensor(_AUXILIARY_WEIGHTS, device=logits.device)
    return functional.cross_entropy(logits[:, :, : labels.shape[1], : labels.shape[2]], labels, weights)


def telephoto_size(config: LavConfig) -> tuple[int, int]:
    """Rows and columns of the telephoto's image as the network takes it."""
    return config.brake.sharp or (config.cameras.telephoto_height, config.cameras.telephoto_width)


class _Cells(nn.Module):
    """(B, hidden) of all cells of both maps."""

    def __init__(self, config: LavConfig) -> None:
        super().__init__()
        sizes = (config.cameras.height, 3 * config.cameras.width), telephoto_size(config)
        cells = sum(-(-height // STRIDE) * -(-width // STRIDE) for height, width in sizes)
        self.narrow = nn.ModuleList(nn.Conv2d(config.brake.features, _CELL_CHANNELS, 1) for _ in sizes)
        self.hidden = nn.Sequential(nn.Dropout(0.2), nn.Linear(_CELL_CHANNELS * cells, _HIDDEN), nn.ReLU(inplace=True))

    def forward(self, maps: list[Tensor]) -> Tensor:
        parts = [functional.relu(conv(part)).flatten(1) for conv, part in zip(self.narrow, maps, strict=True)]
        hidden: Tensor = self.hidden(torch.cat(parts, dim=1))
        return hidden


def _up(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.ConvTranspose2d(inputs, outputs, 3, stride=2, padding=1, output_padding=1, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


class _AttentionPool(nn.Module):
    """Averages a map by eight learned queries; keys know their place along the row-major sequence."""

    HEADS = 8

    def __init__(self, features: int) -> None:
        super().__init__()
        self._size = features // self.HEADS
        self.query = nn.Parameter(torch.randn(1, self.HEADS, 1, self._size) * self._size**-0.5)
        self.key_value = nn.Linear(features, 2 * features)

    def forward(self, features: Tensor) -> Tensor:
        sequence = features.flatten(2).transpose(1, 2)
        keys, values = (
            part.unflatten(2, (self.HEADS, self._size)).transpose(1, 2)
            for part in self.key_value(sequence).chunk(2, dim=2)
        )
        keys = keys + _positions(sequence.shape[1], self._size, features)
        pooled = functional.scaled_dot_product_attention(self.query.expand(len(features), -1, -1, -1), keys, values)
        return pooled.flatten(1)


def _positions(count: int, size: int, like: Tensor) -> Tensor:
    """(count, size) sines and cosines of places in a sequence (Vaswani et al. 2017)."""
    place = torch.arange(count, device=like.device, dtype=like.dtype)[:, None]
    rate = 10_000.0 ** (-torch.arange(0, size, 2, device=like.device, dtype=like.dtype) / size)
    angles = place * rate
    return torch.stack([torch.sin(angles), torch.cos(angles)], dim=2).flatten(1)[:, :size]
