"""Residual networks of basic blocks without a classifier (He et al. 2016, CVPR)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from agents.lav.config import ResNetConfig

STRIDE = 32  # of the last features; sides that are no multiple are rounded up
# With channels last, PyTorch 2's gradient of a strided 1x1 convolution of 4 or 8 channels writes out of bounds.
_LEAST_WIDTH = 12


def memory_format(config: ResNetConfig) -> torch.memory_format:
    """Channels last, which is faster on CPUs, where that is safe."""
    return torch.channels_last if config.width >= _LEAST_WIDTH else torch.contiguous_format


class ResNet(nn.Module):
    """A ResNet-18, or -10 with one block a stage, of any width.

    Args:
        config: Depth and width.
        inputs: Channels of the image.
    """

    def __init__(self, config: ResNetConfig, inputs: int) -> None:
        super().__init__()
        width = config.width
        self.stem = nn.Sequential(
            nn.Conv2d(inputs, width, 7, stride=2, padding=3, bias=False),
            nn.BatchNorm2d(width),
            nn.ReLU(inplace=True),
            nn.MaxPool2d(3, stride=2, padding=1),
        )
        blocks = 2 if config.depth == 18 else 1
        widths = [width * 2**stage for stage in range(4)]
        stages = []
        for number, out in enumerate(widths):
            before = widths[max(number - 1, 0)]
            stages.append(_Block(before, out, 1 if number == 0 else 2))
            stages += [_Block(out, out, 1) for _ in range(blocks - 1)]
        self.stages = nn.Sequential(*stages)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, image: Tensor) -> Tensor:
        """Features (B, 8 width, H / 32, W / 32) of an image (B, C, H, W)."""
        features: Tensor = self.stages(self.stem(image))
        return features


class _Block(nn.Module):
    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
        self.first_norm = nn.BatchNorm2d(outputs)
        self.second = nn.Conv2d(outputs, outputs, 3, 1, 1, bias=False)
        self.second_norm = nn.BatchNorm2d(outputs)
        self.relu = nn.ReLU(inplace=True)
        self.skip: nn.Module = nn.Identity()
        if stride != 1 or inputs != outputs:
            self.skip = nn.Sequential(nn.Conv2d(inputs, outputs, 1, stride, bias=False), nn.BatchNorm2d(outputs))

    def forward(self, x: Tensor) -> Tensor:
        y = self.second_norm(self.second(self.relu(self.first_norm(self.first(x)))))
        out: Tensor = self.relu(y + self.skip(x))
        return out
