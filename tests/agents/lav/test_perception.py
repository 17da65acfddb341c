"""Pillars, backbone, detection and segmentation of LAV, against plain loops and the paper's sizes."""

from __future__ import annotations

import math

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.config import PRESETS, BackboneConfig, GridConfig, LavConfig, find_preset
from agents.lav.models.backbone import Seen
from agents.lav.models.brake import BrakeNetwork, auxiliary_labels, auxiliary_loss
from agents.lav.models.detection import (
    PEDESTRIAN,
    VEHICLE,
    DetectionLabels,
    balanced_centre_loss,
    decode,
    detection_labels,
    detection_loss,
    map_loss,
    without_ego,
)
from agents.lav.models.pillars import PillarEncoder
from agents.lav.models.segmentation import classes_of_tags, make_segmentation
from agents.lav.models.student import Perception, make_student
from lavsim.errors import UnknownName
from lavsim.types import Tag

GRID = GridConfig(behind=8.0, ahead=8.0, aside=8.0, cell=0.5)
NEAR = BackboneConfig(detection_radius=6.0, walker_radius=6.0, ring=20.0)


def parameters(module: torch.nn.Module) -> int:
    return sum(p.numel() for p in module.parameters())


def test_the_papers_networks_have_the_papers_sizes() -> None:
    """The layer sums of reference `lav.md` section 4, without the parameters it calls unused."""
    paper = find_preset("paper")
    assert parameters(make_segmentation(paper.segmentation)) == pytest.approx(2.064e6, rel=1e-3)
    unused_classifier = 512 * 1000 + 1000
    for attention, total in ((False, 13.24e6), (True, 14.29e6)):
        brake = BrakeNetwork(paper, attention)
        auxiliary = parameters(brake.auxiliary)
        assert parameters(brake) == pytest.approx(total - unused_classifier, rel=1e-3)
        assert auxiliary == pytest.approx(1.55e6, rel=1e-2)
    perception = Perception(paper)
    assert parameters(perception) == pytest.approx(1.046e6, rel=1e-3)
    assert parameters(perception.pillars) == (13 * 32 + 32 + 64) + (32 * 32 + 32 + 64)
    wide = paper.model_copy(update={"backbone": BackboneConfig(width=64), "temporal": paper.temporal})
    wide = wide.model_copy(update={"pillars": paper.pillars.model_copy(update={"widths": (64, 64)})})
    assert parameters(Perception(wide)) == pytest.approx(3.276e6, rel=5e-3)
    student = make_student(paper, perception)
    assert parameters(student.embedding) == pytest.approx(11.77e6, rel=1e-3)


@pytest.mark.parametrize("name", list(PRESETS))
def test_every_preset_fits_together(name: str) -> None:
    config = find_preset(name)
    if name == "paper":
        config = config.model_copy(update={"grid": GridConfig(behind=8.0, ahead=8.0, aside=8.0)})
    perception = Perception(config)
    points = torch.rand(300, config.point_features) * 8.0
    seen = perception(points, torch.arange(300) % 2, 2)
    rows, cols = config.grid.rows, config.grid.cols
    assert seen.centre.shape == (2, 2, rows, cols)
    assert seen.map.shape == (2, 3, rows, cols)
    assert seen.features.shape[2:] == (rows // 2, cols // 2)
    motions = make_student(config, perception)(seen.features, torch.zeros(2, 1, 3), torch.zeros(2, 2, 2))
    assert motions.coarse.shape == (2, 1, 6, config.motion.waypoints, 2)
    cameras = config.cameras
    images = torch.rand(1, 3, cameras.height, cameras.width)
    assert make_segmentation(config.segmentation)(images).shape == (1, 5, cameras.height, cameras.width)


def test_an_unknown_preset_and_an_odd_grid_are_refused() -> None:
    with pytest.raises(UnknownName, match="tiny"):
        find_preset("tny")
    with pytest.raises(ValueError, match="divisible by 8"):
        LavConfig(grid=GridConfig(behind=1.0, ahead=8.0, aside=8.0, cell=0.5))


def test_pillars_equal_a_loop_over_cells() -> None:
    encoder = PillarEncoder(GRID, 4, (6,)).eval()
    draws = np.random.default_rng(5)
    points = torch.tensor(draws.uniform(-9.0, 9.0, (400, 4)), dtype=torch.float32)
    frame = torch.tensor(draws.integers(0, 2, 400))
    image = encoder(points, frame, 2)
    assert image.shape == (2, 6, GRID.rows, GRID.cols)
    filled = 0
    for b in range(2):
        for row in range(GRID.rows):
            for col in range(GRID.cols):
                x1, y0 = GRID.ahead - row * GRID.cell, -GRID.aside + col * GRID.cell
                inside = (points[:, 0] <= x1) & (points[:, 0] > x1 - GRID.cell) & (frame == b)
                inside &= (points[:, 1] >= y0) & (points[:, 1] < y0 + GRID.cell)
                own = points[inside]
                if not len(own):
                    assert float(image[b, :, row, col].detach().abs().max()) == 0.0
                    continue
                filled += 1
                middle = torch.tensor([x1 - GRID.cell / 2, y0 + GRID.cell / 2])
                decorated = torch.cat([own, own[:, :3] - own[:, :3].mean(0), own[:, :2] - middle], dim=1)
                expected = encoder.layers(decorated).max(dim=0).values
                assert torch.allclose(image[b, :, row, col], expected, atol=1e-5)
    assert filled > 200


def test_pillars_do_not_depend_on_the_order_of_points_and_stand_an_empty_scan() -> None:
    encoder = PillarEncoder(GRID, 4, (6,)).eval()
    points = torch.randn(100, 4) * 3.0
    image = encoder(points, torch.zeros(100), 1)
    assert torch.allclose(image, encoder(points.flip(0), torch.zeros(100), 1), atol=1e-6)
    assert float(encoder(points[:0], torch.zeros(0), 1).abs().max()) == 0.0


def boxes_of(*boxes: tuple[float, float, float, float, float]) -> torch.Tensor:
    return torch.tensor([boxes])


def perfect(labels: object, grid: GridConfig) -> Seen:
    """What a network that has learnt these labels would say."""
    heat = labels.heat.clamp(1e-4, 1.0 - 1e-4)  # type: ignore[attr-defined]
    empty = torch.zeros(1, 3, grid.rows, grid.cols)
    return Seen(empty, torch.logit(heat), labels.size, labels.heading, empty)  # type: ignore[attr-defined]


def test_what_is_drawn_is_read_back() -> None:
    boxes = boxes_of((0.25, 0.25, 0.0, 2.4, 1.0), (-3.25, -4.25, 2.0, 2.2, 0.9), (3.25, 1.25, -0.5, 0.3, 0.25))
    labels = detection_labels(boxes, torch.tensor([[VEHICLE, VEHICLE, PEDESTRIAN]]), GRID, NEAR)
    found = decode(perfect(labels, GRID), GRID, VEHICLE)[0]
    assert len(found.boxes) == 2
    order = torch.argsort(found.boxes[:, 0])
    assert torch.allclose(found.boxes[order], boxes[0, [1, 0]], atol=1e-4)
    assert torch.allclose(without_ego(found).boxes, boxes[0, 1:2], atol=1e-4)
    walkers = decode(perfect(labels, GRID), GRID, PEDESTRIAN)[0]
    assert torch.allclose(walkers.boxes, boxes[0, 2:], atol=1e-4)
    best = float(detection_loss(perfect(labels, GRID), labels))
    blurred = perfect(labels, GRID)._replace(centre=torch.zeros_like(labels.heat))
    larger = perfect(labels, GRID)._replace(size=labels.size + 1.0)
    assert best < min(float(detection_loss(blurred, labels)), float(detection_loss(larger, labels)) - 0.4)


def test_beyond_the_radius_nothing_counts_and_beyond_the_ring_it_is_background() -> None:
    boxes = boxes_of((0.25, 0.25, 0.0, 2.0, 1.0), (7.25, 0.25, 0.0, 2.0, 1.0))
    kinds = torch.tensor([[VEHICLE, VEHICLE]])
    labels = detection_labels(boxes, kinds, GRID, NEAR)
    row, col = 16, 30
    assert labels.heat[0, VEHICLE, row, col] < 1e-3
    assert labels.weight[0, VEHICLE, row, col] == 0.0
    assert labels.weight[0, PEDESTRIAN, row, col] == 1.0
    narrow = NEAR.model_copy(update={"ring": 0.5})
    assert detection_labels(boxes, kinds, GRID, narrow).weight.min() == 1.0
    none = detection_labels(boxes, torch.tensor([[VEHICLE, -1]]), GRID, NEAR)
    assert none.weight.min() == 1.0


def test_the_centre_loss_of_one_cell_worked_by_hand() -> None:
    grid = GridConfig(behind=4.0, ahead=4.0, aside=4.0, cell=1.0)
    labels = detection_labels(boxes_of((0.5, 0.5, 0.0, 2.0, 1.0)), torch.tensor([[-1]]), grid, NEAR)
    logits = torch.full((1, 2, 8, 8), -20.0)
    logits[0, 1, 3, 3] = 1.0  # one false alarm: its own weight cancels
    same = torch.zeros(1, 2, 8, 8)
    seen = Seen(same, logits, labels.size, labels.heading, torch.zeros(1, 3, 8, 8))
    assert float(detection_loss(seen, labels)) == pytest.approx(math.log(1.0 + math.e), rel=1e-4)
    assert float(map_loss(torch.zeros(1, 3, 8, 8), torch.ones(1, 3, 8, 8))) == pytest.approx(2.0 * math.log(2.0))


def test_balanced_losses_worked_by_hand() -> None:
    """A kind's loss is per actor of it: two walkers half found cost as much as one; marks weigh four times."""
    heat = torch.zeros(1, 2, 8, 8)
    heat[0, PEDESTRIAN, 2, 2] = 1.0
    logits = torch.where(heat > 0.0, 0.0, -30.0)
    labels = DetectionLabels(heat, torch.ones_like(heat), heat, heat)
    alone = float(balanced_centre_loss(logits, labels))
    assert alone == pytest.approx(0.25 * math.log(2.0), rel=1e-5)
    heat[0, PEDESTRIAN, 5, 5] = 1.0
    logits[0, PEDESTRIAN, 5, 5] = 0.0
    assert float(balanced_centre_loss(logits, labels)) == pytest.approx(alone, rel=1e-5)
    heat[0, VEHICLE, 1, 1] = 1.0
    logits[0, VEHICLE, 1, 1] = 0.0
    assert float(balanced_centre_loss(logits, labels)) == pytest.approx(2.0 * alone, rel=1e-5)
    narrow = torch.zeros_like(heat, dtype=torch.bool)
    narrow[0, VEHICLE, 1, 1] = True
    weighed = float(balanced_centre_loss(logits, labels._replace(narrow=narrow)))
    assert weighed == pytest.approx((1.0 + 4.0) * alone, rel=1e-5), "a two-wheeler weighs four times"
    labels.weight[:] = 0.0
    assert float(balanced_centre_loss(logits, labels)) == 0.0, "nothing counts"
    layers, known = torch.ones(1, 3, 2, 2), torch.tensor([[[1.0, 0.0], [0.0, 0.0]]])
    wanted = 2.0 * math.log(2.0) * (1.0 + 4.0 + 4.0) / 3.0
    assert float(map_loss(torch.zeros(1, 3, 2, 2), layers, known, balanced=True)) == pytest.approx(wanted)


def test_two_wheelers_are_told_by_their_width() -> None:
    config = find_preset("tiny")
    boxes = torch.tensor([[[0.0, -10.0, 0.0, 0.9, 0.35], [8.0, -10.0, 0.0, 2.4, 1.0], [-8.0, -10.0, 0.0, 0.2, 0.2]]])
    kinds = torch.tensor([[VEHICLE, VEHICLE, PEDESTRIAN]])
    labels = detection_labels(boxes, kinds, config.grid, config.backbone)
    assert labels.narrow is not None
    near = labels.heat > 0.05
    rows, cols = torch.nonzero(labels.narrow[0, VEHICLE], as_tuple=True)
    assert len(rows) > 4
    assert not labels.narrow[0, PEDESTRIAN].any()
    place = cols.float().mean() * config.grid.cell - config.grid.aside
    assert abs(float(place)) < 0.5
    assert int(near[0, VEHICLE].sum()) > len(rows)


def test_tags_become_classes() -> None:
    tags = torch.tensor([[int(Tag.ROAD), int(Tag.VEHICLE), int(Tag.SKY), int(Tag.PEDESTRIAN), int(Tag.ROAD_LINE)]])
    assert classes_of_tags(tags).tolist() == [[3, 4, 0, 1, 2]]
    image = torch.zeros(1, 16, 16)
    image[0, 3, 6], image[0, 0, 4] = int(Tag.TRAFFIC_LIGHT), int(Tag.VEHICLE)
    labels = auxiliary_labels(image)
    assert labels.shape == (1, 4, 4)
    assert labels[0, 0].tolist() == [0, 3, 0, 0], "a lamp of a pixel is found in its square"
    assert float(auxiliary_loss(torch.zeros(1, 4, 4, 4), image)) == pytest.approx(math.log(4.0))


def test_the_brake_network_sees_both_images() -> None:
    config = find_preset("micro")
    cameras = config.cameras
    for attention in (False, True):
        brake = BrakeNetwork(config, attention).eval()
        wide = torch.rand(2, 3, cameras.height, 3 * cameras.width)
        tele = torch.rand(2, 3, cameras.telephoto_height, cameras.telephoto_width)
        logit, first, second = brake(wide, tele, with_tags=True)
        assert torch.equal(logit, brake(wide, tele))
        assert not torch.allclose(logit, brake(wide, 1.0 - tele))
        assert not torch.allclose(logit, brake(1.0 - wide, tele))
        assert first.shape[1] == second.shape[1] == 4
