"""Networks that classify every pixel: what painting writes onto the points (paper, section 3.2).

`erfnet` after Romera et al. 2018, T-ITS, from the layer table in reference `lav.md` 4.1; `unet` is the paper's ablation
entry (Ronneberger et al. 2015); `light` is a small U-Net that begins at stride 2, for CPUs.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from agents.lav.config import SegmentationConfig
from lavsim.types import Tag

_LEAST_SPREAD = 0.02
_CORRECTION = (
    0.75  # of the class weights' logarithms; the dice loss leaves less than all of them. Best on training data
)
# What a pixel can be, in the order of the scores; everything else is background.
CLASSES = ("background", "pedestrian", "lane mark", "road", "vehicle")
CLASS_WEIGHTS = (1.0, 20.0, 5.0, 1.0, 2.0)  # in the loss: one pixel in a thousand is a walker's, one in eighty a line's
TAG_OF_CLASS = (None, Tag.PEDESTRIAN, Tag.ROAD_LINE, Tag.ROAD, Tag.VEHICLE)


def make_segmentation(config: SegmentationConfig, classes: int = len(CLASSES)) -> nn.Module:
    """The network that a configuration names: (B, 3, H, W) in -1..1 to logits (B, classes, H, W)."""
    if config.network == "erfnet":
        return ErfNet(config, classes)
    is_light = config.network == "light"
    return UNet(config.widths, classes, stem_stride=2 if is_light else 1, evens_out=is_light)


def classes_of_tags(tags: Tensor) -> Tensor:
    """Class indices (...) of semantic tags (...): the labels of segmentation."""
    table = torch.zeros(256, dtype=torch.long, device=tags.device)
    for number, tag in enumerate(TAG_OF_CLASS):
        if tag is not None:
            table[int(tag)] = number
    found: Tensor = table[tags.long()]
    return found


def calibrated(logits: Tensor) -> Tensor:
    """Logits (B, classes, H, W) of classes as frequent as they are.

    A network that was trained with class weights tells of a world in which each class is more frequent by its weight.
    """
    weights = torch.tensor(CLASS_WEIGHTS, device=logits.device).view(1, -1, 1, 1)
    return logits - _CORRECTION * weights.log()


def in_unit_range(images: Tensor) -> Tensor:
    """-1..1 of bytes (..., 3, H, W)."""
    return images.float() / 127.5 - 1.0


class ErfNet(nn.Module):
    """Factorised residual blocks between a down- and an upsampling half."""

    def __init__(self, config: SegmentationConfig, classes: int) -> None:
        super().__init__()
        first, middle, last = config.widths
        shallow, rounds = config.blocks
        self.encoder = nn.Sequential(
            _Down(3, first),
            _Down(first, middle),
            *(_NonBottleneck(middle, 1, 0.03) for _ in range(shallow)),
            _Down(middle, last),
            *(_NonBottleneck(last, dilation, 0.3) for _ in range(rounds) for dilation in (2, 4, 8, 16)),
        )
        self.decoder = nn.Sequential(
            _up(last, middle),
            *(_NonBottleneck(middle, 1, 0.0) for _ in range(2)),
            _up(middle, first),
            *(_NonBottleneck(first, 1, 0.0) for _ in range(2)),
            nn.ConvTranspose2d(first, classes, 2, stride=2),
        )

    def forward(self, image: Tensor) -> Tensor:
        logits: Tensor = self.decoder(self.encoder(image))
        return logits


class _Down(nn.Module):
    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs - inputs, 3, stride=2, padding=1)
        self.norm = nn.BatchNorm2d(outputs, eps=1e-3)

    def forward(self, x: Tensor) -> Tensor:
        joined = torch.cat([self.conv(x), functional.max_pool2d(x, 2)], dim=1)
        return functional.relu(self.norm(joined), inplace=True)


class _NonBottleneck(nn.Module):
    """Two pairs of 3x1 and 1x3 convolutions, the second pair dilated, around a skip."""

    def __init__(self, channels: int, dilation: int, dropout: float) -> None:
        super().__init__()
        self.convs = nn.ModuleList(
            nn.Conv2d(channels, channels, size, padding=padding, dilation=spread)
            for size, padding, spread in (
                ((3, 1), (1, 0), (1, 1)),
                ((1, 3), (0, 1), (1, 1)),
                ((3, 1), (dilation, 0), (dilation, 1)),
                ((1, 3), (0, dilation), (1, dilation)),
            )
        )
        self.norms = nn.ModuleList(nn.BatchNorm2d(channels, eps=1e-3) for _ in range(2))
        self.dropout = nn.Dropout2d(dropout)

    def forward(self, x: Tensor) -> Tensor:
        y = functional.relu(self.convs[0](x))
        y = functional.relu(self.norms[0](self.convs[1](y)))
        y = functional.relu(self.convs[2](y))
        y = self.dropout(self.norms[1](self.convs[3](y)))
        return functional.relu(x + y)


def _up(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.ConvTranspose2d(inputs, outputs, 3, stride=2, padding=1, output_padding=1),
        nn.BatchNorm2d(outputs, eps=1e-3),
        nn.ReLU(inplace=True),
    )


class UNet(nn.Module):
    """An encoder of two convolutions a level and a decoder that sees each level again.

    Args:
        widths: Channels of the levels, finest first.
        classes: Of a pixel.
        evens_out: Whether every image is first brought to one mean and spread: nights are dark.
        stem_stride: 1, or 2 to work at half the resolution; each place then answers for the four pixels that it covers.
    """

    def __init__(self, widths: tuple[int, ...], classes: int, stem_stride: int = 1, evens_out: bool = False) -> None:
        super().__init__()
        self._evens_out = evens_out
        self.stem = _conv(3, widths[0], stem_stride)
        self.down = nn.ModuleList(nn.Sequential(_conv(a, b, 2), _conv(b, b)) for a, b in pairwise(widths))
        self.up = nn.ModuleList(_conv(b + a, a) for a, b in zip(widths[-2::-1], widths[:0:-1], strict=True))
        self.head = nn.Sequential(nn.Conv2d(widths[0], classes * stem_stride**2, 1), nn.PixelShuffle(stem_stride))

    def forward(self, image: Tensor) -> Tensor:
        if self._evens_out:
            # Over one dimension, and channels last as the images are: three times as fast as over three.
            spread, mean = torch.std_mean(image.permute(0, 2, 3, 1).flatten(1), dim=1)
            image = (image - mean.view(-1, 1, 1, 1)) / (spread.view(-1, 1, 1, 1) + _LEAST_SPREAD)
        levels = [self.stem(image)]
        for block in self.down:
            levels.append(block(levels[-1]))
        x = levels.pop()
        for block in self.up:
            finer = levels.pop()
            x = block(torch.cat([functional.interpolate(x, size=finer.shape[2:], mode="nearest"), finer], dim=1))
        logits: Tensor = self.head(x)
        return logits


def _conv(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True)
    )
