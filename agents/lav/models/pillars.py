"""Points to a bird's-eye image of learned pillars, without padding (paper, section 3.2; reference `lav.md` 4.3)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from agents.lav.config import GridConfig

DECORATION = 5  # offsets from the pillar's mean (3) and from its middle (2)


class PillarEncoder(nn.Module):
    """A small network on every point, its largest values in each pillar, and zeros where no point lies.

    Args:
        grid: Pillars are its cells.
        features: Of a point, the first three its place.
        widths: Of the layers.
    """

    def __init__(self, grid: GridConfig, features: int, widths: tuple[int, ...]) -> None:
        super().__init__()
        self._grid = grid
        layers: list[nn.Module] = []
        for inputs, outputs in zip((features + DECORATION, *widths), widths, strict=False):
            layers += [nn.Linear(inputs, outputs), nn.BatchNorm1d(outputs), nn.ReLU(inplace=True)]
        self.layers = nn.Sequential(*layers)
        self.channels = widths[-1]

    def forward(self, points: Tensor, frame: Tensor, frames: int) -> Tensor:
        """The image (frames, C, rows, cols), row 0 ahead.

        Args:
            points: (P, F) of all frames together: x ahead, y right, z up [m], then what else is known of them. Those
                outside the grid are left out.
            frame: (P,) the frame of each.
            frames: How many there are.
        """
        cells, inside = _cells(points, frame, self._grid)
        points, cells = points[inside], cells[inside]
        canvas = points.new_zeros(frames * self._grid.rows * self._grid.cols, self.channels)
        if len(points):
            # Sorted by pillar, a pillar is a run of points, and its maximum a reduction over that run.
            order = torch.argsort(cells, stable=True)
            points, cells = points[order], cells[order]
            pillars, counts = torch.unique_consecutive(cells, return_counts=True)
            found = self.layers(_decorated(points, cells, counts, self._grid))
            highest = torch.segment_reduce(found, "max", lengths=counts, axis=0)
            canvas = canvas.index_copy(0, pillars, highest.to(canvas.dtype))
        image = canvas.view(frames, self._grid.rows, self._grid.cols, self.channels)
        return image.permute(0, 3, 1, 2)  # channels last in memory, as convolutions on CPUs want it


def _cells(points: Tensor, frame: Tensor, grid: GridConfig) -> tuple[Tensor, Tensor]:
    """Number of each point's cell among those of all frames, and whether it lies on the grid."""
    row = torch.floor((grid.ahead - points[:, 0]) / grid.cell).long()
    col = torch.floor((points[:, 1] + grid.aside) / grid.cell).long()
    inside = (row >= 0) & (row < grid.rows) & (col >= 0) & (col < grid.cols)
    return (frame.long() * grid.rows + row) * grid.cols + col, inside


def _decorated(points: Tensor, cells: Tensor, counts: Tensor, grid: GridConfig) -> Tensor:
    """Points (P, F) sorted by cell with their offsets from their pillar's mean and middle (P, F + 5)."""
    with torch.no_grad():
        place = points[:, :3]
        means = torch.segment_reduce(place.contiguous(), "mean", lengths=counts, axis=0)
        from_mean = place - torch.repeat_interleave(means, counts, dim=0)
        row, col = (cells // grid.cols) % grid.rows, cells % grid.cols
        middle = torch.stack([grid.ahead - (row + 0.5) * grid.cell, (col + 0.5) * grid.cell - grid.aside], dim=1)
        return torch.cat([points, from_mean, place[:, :2] - middle], dim=1)
