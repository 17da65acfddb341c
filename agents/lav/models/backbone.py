"""The bird's-eye convolutions and the heads on them (reference `lav.md` 4.4)."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from agents.lav.config import BackboneConfig

HEADS = {"centre": 2, "size": 2, "heading": 2, "map": 3}  # outputs of each head


class Seen(NamedTuple):
    """What perception says of a frame, over the grid.

    Attributes:
        features: (B, F, H / 2, W / 2) for motion; F is the neck's width or 6 C.
        centre: (B, 2, H, W) logits of centres of pedestrians and vehicles.
        size: (B, 2, H, W) half length and half width [cells].
        heading: (B, 2, H, W) cosine and sine of the heading in the planner frame.
        map: (B, 3, H, W) logits of road, solid and broken marks.
    """

    features: Tensor
    centre: Tensor
    size: Tensor
    heading: Tensor
    map: Tensor


class Backbone(nn.Module):
    """Three scales of convolutions, drawn up to half the grid's resolution and joined, then heads.

    Args:
        config: Widths.
        inputs: Channels of the pillars' image.
    """

    def __init__(self, config: BackboneConfig, inputs: int) -> None:
        super().__init__()
        c = config.width
        self.first = _stage(inputs, c, 3)
        self.second = _stage(c, 2 * c, 5)
        self.third = _stage(2 * c, 2 * c, 5)
        self.up_first = _normed(nn.Conv2d(c, 2 * c, 1, bias=False), 2 * c)
        self.up_second = _normed(nn.ConvTranspose2d(2 * c, 2 * c, 4, 2, 1, bias=False), 2 * c)
        self.up_third = _normed(nn.ConvTranspose2d(2 * c, 2 * c, 4, 4, 1, output_padding=2, bias=False), 2 * c)
        self.neck = _normed(nn.Conv2d(6 * c, config.neck, 1, bias=False), config.neck) if config.neck else nn.Identity()
        self.channels = config.neck or 6 * c
        self.heads = _SharedHead(self.channels, config.head_width) if config.shared_head else _Heads(6 * c, config)
        self._heads_take_neck = config.shared_head

    def forward(self, image: Tensor) -> Seen:
        first = self.first(image)
        second = self.second(first)
        third = self.third(second)
        scales = (self.up_first(first), self.up_second(second), self.up_third(third))
        joined = torch.cat([_with_dense_gradient(scale) if self.training else scale for scale in scales], dim=1)
        features = self.neck(joined)
        found = self.heads(features if self._heads_take_neck else joined)
        return Seen(features, *(found[name] for name in HEADS))


class _Heads(nn.Module):
    """A head of its own for each output."""

    def __init__(self, inputs: int, config: BackboneConfig) -> None:
        super().__init__()
        width = config.head_width
        self.parts = nn.ModuleDict(
            {
                name: nn.Sequential(
                    _normed(nn.Conv2d(inputs, width, 3, padding=1, bias=False), width),
                    nn.ConvTranspose2d(width, outputs, 3, 2, 1, output_padding=1),
                )
                for name, outputs in HEADS.items()
            }
        )

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        return {name: part(x) for name, part in self.parts.items()}


class _SharedHead(nn.Module):
    """One convolution for all outputs, each pixel of which makes four cells."""

    def __init__(self, inputs: int, width: int) -> None:
        super().__init__()
        self.body = _normed(nn.Conv2d(inputs, width, 3, padding=1, bias=False), width)
        self.out = nn.Conv2d(width, 4 * sum(HEADS.values()), 1)
        self.shuffle = nn.PixelShuffle(2)

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        parts = torch.split(self.shuffle(self.out(self.body(x))), list(HEADS.values()), dim=1)
        return dict(zip(HEADS, parts, strict=True))


def _normed(conv: nn.Module, channels: int) -> nn.Sequential:
    """Convolution, ReLU, normalisation: the original's order."""
    return nn.Sequential(conv, nn.ReLU(inplace=True), nn.BatchNorm2d(channels, eps=1e-3, momentum=0.01))


def _stage(inputs: int, outputs: int, more: int) -> nn.Sequential:
    layers = [_normed(nn.Conv2d(inputs, outputs, 3, 2, 1, bias=False), outputs)]
    layers += [_normed(nn.Conv2d(outputs, outputs, 3, 1, 1, bias=False), outputs) for _ in range(more)]
    return nn.Sequential(*layers)


class _DenseGradient(torch.autograd.Function):
    """Nothing, but that the gradient is laid out channels last and dense."""

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        return x.view_as(x)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        return gradients[0].contiguous(memory_format=torch.channels_last)


def _with_dense_gradient(x: Tensor) -> Tensor:
    # What comes back through a concatenation is a slice of channels; normalisation is ten times slower on such.
    found: Tensor = _DenseGradient.apply(x)
    return found
