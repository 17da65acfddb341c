"""Whether to stop, from the panorama and the telephoto image: red lights, stop signs, hazards (paper, appendix)."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from agents.lav.config import LavConfig
from agents.lav.models.resnet import ResNet
from lavsim.types import Tag

# Classes of the auxiliary segmentation, which keeps the trunk on what matters; everything else is background.
AUXILIARY_TAGS = (Tag.PEDESTRIAN, Tag.VEHICLE, Tag.TRAFFIC_LIGHT)
_AUXILIARY_WEIGHTS = (1.0, 4.0, 1.0, 8.0)  # walkers and lights are few pixels
_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


class BrakeNetwork(nn.Module):
    """One trunk for both images, averaged over each, and a logit.

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
        self.out = nn.Linear(2 * features, 1)
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
        """Logits (B,) of stopping.

        Args:
            panorama: (B, 3, H, 3 W) red, green, blue, 0 to 1: left, centre, right beside each other.
            telephoto: (B, 3, h, w) without its lowest third.
            with_tags: Gives the auxiliary logits (B, 4, H / 4, W / 4) of each image too.
        """
        logit, maps = self._run(panorama, telephoto)
        return (logit, self.auxiliary(maps[0]), self.auxiliary(maps[1])) if with_tags else logit

    def _run(self, panorama: Tensor, telephoto: Tensor) -> tuple[Tensor, list[Tensor]]:
        maps = [self.trunk((image - self.mean) / self.std) for image in (panorama, telephoto)]
        pooled = [pool(features).flatten(1) for pool, features in zip(self.pools, maps, strict=True)]
        return self.out(torch.cat(pooled, dim=1))[:, 0], maps


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
