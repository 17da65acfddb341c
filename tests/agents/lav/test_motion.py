"""Windows, recurrences and losses of LAV's motion networks, against plain formulas."""

from __future__ import annotations

import math

import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn

from agents.lav.config import COMMANDS, CropConfig, GridConfig, MotionConfig, ResNetConfig, find_preset
from agents.lav.models.crop import crop_rois, planner_points, to_own, to_planner, window
from agents.lav.models.motion import (
    CommandGrus,
    Embedding,
    MotionHead,
    Refiner,
    chosen,
    command_loss,
    nearest_branch_loss,
    path_loss,
)
from agents.lav.models.teacher import make_teacher

GRID = GridConfig(behind=16.0, ahead=16.0, aside=16.0, cell=0.5)
CROP = CropConfig(side=16.0, behind=4.0, cell=1.0, teacher_cell=0.5)


def scene(points: torch.Tensor) -> torch.Tensor:
    """(..., 2) planner points -> smooth values, nowhere symmetric, fading before the grid's edge."""
    x, y = points[..., 0], points[..., 1]
    fade = torch.exp(-(x**2 + y**2) / 60.0)
    return fade * (torch.sin(0.5 * x) + torch.cos(0.3 * y) + 0.1 * x + 0.05 * y)


def image_of(angle: float) -> torch.Tensor:
    """(1, 1, H, W) the scene turned clockwise by `angle`, drawn on the grid."""
    rows, cols = torch.meshgrid(torch.arange(GRID.rows), torch.arange(GRID.cols), indexing="ij")
    x, y = (cols + 0.5) * GRID.cell - GRID.aside, (rows + 0.5) * GRID.cell - GRID.ahead
    back = torch.stack([math.cos(angle) * x + math.sin(angle) * y, math.cos(angle) * y - math.sin(angle) * x], dim=-1)
    return scene(back)[None, None].float()


@settings(max_examples=20, deadline=None)
@given(angle=st.floats(-3.0, 3.0), x=st.floats(-4.0, 4.0), y=st.floats(-4.0, 4.0), heading=st.floats(-math.pi, math.pi))
def test_the_window_of_a_turned_scene_is_the_turned_window(angle: float, x: float, y: float, heading: float) -> None:
    still = torch.tensor([[[x, y, heading]]])
    cos, sin = math.cos(angle), math.sin(angle)
    turned = torch.tensor([[[cos * x - sin * y, sin * x + cos * y, heading + angle]]])
    first = crop_rois(image_of(0.0), still, GRID, CROP, CROP.cell)
    second = crop_rois(image_of(angle), turned, GRID, CROP, CROP.cell)
    assert torch.allclose(first, second, atol=0.06)
    truth = scene(planner_points(still, window(CROP, 16)))
    assert torch.allclose(first[:, :, 0], truth, atol=0.06)


def test_a_window_looks_ahead_with_its_vehicle_where_the_paper_puts_it() -> None:
    image = torch.zeros(1, 1, GRID.rows, GRID.cols)
    image[0, 0, 32 - 8 : 32 - 6, 32 : 32 + 2] = 1.0  # 3 to 4 m ahead of the ego, 0 to 1 m right
    found = crop_rois(image, torch.zeros(1, 1, 3), GRID, CROP, CROP.cell)[0, 0, 0]
    row, col = divmod(int(found.argmax()), 16)
    assert (row, col) == (8, 8)  # 12 m ahead of the vehicle lie above row 12
    empty = crop_rois(image, torch.tensor([[[0.0, 60.0, 0.0]]]), GRID, CROP, CROP.cell)
    assert float(empty.abs().max()) == 0.0, "outside the grid there is nothing"


def test_windows_of_a_frame_are_cut_together_as_alone() -> None:
    image = torch.randn(2, 3, GRID.rows, GRID.cols, generator=torch.Generator().manual_seed(1))
    poses = torch.randn(2, 4, 3, generator=torch.Generator().manual_seed(2)) * torch.tensor([4.0, 4.0, 1.0])
    together = crop_rois(image, poses, GRID, CROP, CROP.cell)
    for b in range(2):
        for r in range(4):
            alone = crop_rois(image[b : b + 1], poses[b : b + 1, r : r + 1], GRID, CROP, CROP.cell)
            assert torch.equal(together[b, r], alone[0, 0])


def test_paths_go_to_the_planner_frame_and_back() -> None:
    paths, poses = torch.randn(5, 7, 2), torch.randn(5, 3)
    there = to_planner(paths, poses)
    assert torch.allclose(to_own(there, poses), paths, atol=1e-5)
    assert torch.allclose(there[:, 0], planner_points(poses, paths[:, 0])[torch.arange(5), torch.arange(5)], atol=1e-5)


def test_six_recurrences_in_one_equal_six_of_torch() -> None:
    ours = CommandGrus(features=12, hidden=8, steps=5)
    vectors = torch.randn(3, 12)
    found = ours(vectors)
    assert found.shape == (3, COMMANDS, 5, 2)
    for command in range(COMMANDS):
        gru = nn.GRU(12, 8, batch_first=True)
        with torch.no_grad():
            gru.weight_ih_l0.copy_(ours.input_weight[command])
            gru.weight_hh_l0.copy_(ours.hidden_weight[command])
            gru.bias_ih_l0.copy_(ours.input_bias[command])
            gru.bias_hh_l0.copy_(ours.hidden_bias[command])
        states, _ = gru(vectors[:, None].expand(-1, 5, -1))
        steps = states @ ours.out_weight[command].T + ours.out_bias[command]
        assert torch.allclose(found[:, command], torch.cumsum(steps, dim=1), atol=1e-5)


def test_refinement_adds_to_the_plan_and_keeps_its_gradient_from_the_coarse_one() -> None:
    refiner = Refiner(6, 4)
    coarse = torch.randn(2, COMMANDS, 3, 2, requires_grad=True)
    plans = refiner(torch.randn(2, 6), torch.randn(2, 1, 2), coarse, 3)
    assert plans.shape == (2, 3, COMMANDS, 3, 2)
    plans[:, -1].sum().backward()
    assert coarse.grad is None
    assert refiner.gru.weight_ih_l0.grad is not None
    nn.init.zeros_(refiner.out.weight)
    nn.init.zeros_(refiner.out.bias)
    still = refiner(torch.randn(2, 6), torch.randn(2, 1, 2), coarse, 2)
    assert torch.equal(still[:, 1], coarse.detach())


def test_without_refinements_there_are_no_plans() -> None:
    head = MotionHead(MotionConfig(embedding=ResNetConfig(depth=10, width=4), refinements=0))
    vectors = torch.randn(2, 32)
    assert head.refine(vectors, torch.zeros(2, 1, 2), head(vectors).coarse).shape == (2, 0, COMMANDS, 10, 2)


def test_losses_of_a_case_worked_by_hand() -> None:
    target = torch.tensor([[[0.0, -1.0], [0.0, -2.0]]])
    paths = torch.zeros(1, COMMANDS, 2, 2)
    paths[0, 4] = torch.tensor([[0.5, -1.0], [0.5, -2.5]])
    assert path_loss(paths[:, 0], target).item() == pytest.approx((1.0 + 2.0) / 4)
    assert nearest_branch_loss(paths, target).item() == pytest.approx((0.5 + 0.5 + 0.5) / 4)
    assert torch.equal(chosen(paths, torch.tensor([4])), paths[:, 4])
    assert chosen(paths[:, None].expand(-1, 3, -1, -1, -1), torch.tensor([4])).shape == (1, 3, 2, 2)
    logits = torch.zeros(1, COMMANDS)
    logits[0, 2] = 2.0
    right = math.log(1.0 + math.exp(-2.0))
    assert command_loss(logits, torch.tensor([2]), 0.0).item() == pytest.approx((right + 5 * math.log(2.0)) / 6)
    label = 0.8 + 0.2 / 6
    smooth = label * right + (1.0 - label) * (right + 2.0) + 5 * math.log(2.0)
    assert command_loss(logits, torch.tensor([2]), 0.2).item() == pytest.approx(smooth / 6)


def test_the_papers_teacher_has_the_papers_size() -> None:
    teacher = make_teacher(find_preset("paper"))
    count = {name: sum(p.numel() for p in part.parameters()) for name, part in teacher.named_children()}
    refiner = 3 * 512 * (4 + 512) + 2 * 3 * 512 + 512 * 2 + 2
    assert count["embedding"] == 11_176_512 + 2 * 64 * 49  # torch's ResNet-18 without classifier, with five inputs
    assert count["motion"] == 6 * 110_976 + 780 + refiner + 3_078
    assert sum(count.values()) == pytest.approx(13.16e6 - 0.513e6, rel=1e-3)


@pytest.mark.parametrize("preset", ["micro", "tiny"])
def test_a_teacher_gives_every_vehicle_its_motion(preset: str) -> None:
    config = find_preset(preset)
    teacher = make_teacher(config)
    image = torch.rand(2, 5, config.grid.rows, config.grid.cols)
    motions = teacher(image, torch.zeros(2, 3, 3), torch.zeros(2, 2, 2))
    steps, rounds = config.motion.waypoints, config.motion.refinements
    assert motions.coarse.shape == (2, 3, COMMANDS, steps, 2)
    assert motions.commands.shape == (2, 3, COMMANDS)
    assert motions.refined.shape == (2, rounds, COMMANDS, steps, 2)
    assert torch.isfinite(motions.refined).all()


def test_a_speed_that_nobody_knows_is_no_speed() -> None:
    config = MotionConfig(embedding=ResNetConfig(depth=10, width=4), speeds=True)
    embedding = Embedding(config, 5, 30).eval()
    windows = torch.rand(3, 5, 30, 30)
    unknown = embedding(windows, torch.full((3,), torch.nan))
    assert torch.equal(unknown, embedding(windows))
    assert not torch.allclose(unknown, embedding(windows, torch.zeros(3)))
    assert not torch.allclose(embedding(windows, torch.full((3,), 8.0)), embedding(windows, torch.zeros(3)))
    blind = Embedding(config.model_copy(update={"speeds": False}), 5, 30).eval()
    assert torch.equal(blind(windows, torch.zeros(3)), blind(windows, torch.full((3,), 8.0)))


def test_paths_begin_with_the_speed_that_is_known() -> None:
    head = MotionHead(MotionConfig(embedding=ResNetConfig(depth=10, width=4), speeds=True))
    vectors, speeds = torch.randn(2, 32), torch.tensor([4.0, torch.nan])
    added = head(vectors, speeds).coarse - head(vectors).coarse
    assert torch.allclose(added[0, 2, :, 1], -torch.arange(1.0, 11.0), atol=1e-5)
    assert float(added[0, ..., 0].abs().max()) < 1e-6
    assert not added[1].any()


def test_a_grid_pooled_vector_knows_where_things_are() -> None:
    config = MotionConfig(embedding=ResNetConfig(depth=10, width=4), pooling="grid")
    for size in (30, 64, 80):  # sides that are no multiple of the stride too
        assert Embedding(config, 5, size)(torch.rand(2, 5, size, size)).shape == (2, 32)


def test_the_second_goal_counts_where_there_are_two() -> None:
    vectors, coarse = torch.randn(2, 6), torch.randn(2, COMMANDS, 3, 2)
    goals = torch.randn(2, 2, 2)
    moved = goals + torch.tensor([[0.0, 0.0], [5.0, 5.0]])
    both = Refiner(6, 4, goals=2)
    assert not torch.allclose(both(vectors, goals, coarse, 2), both(vectors, moved, coarse, 2))
    teacher = make_teacher(find_preset("micro")).eval()
    image, poses = torch.rand(2, 5, 32, 32), torch.zeros(2, 1, 3)
    assert torch.equal(teacher(image, poses, goals).refined, teacher(image, poses, moved).refined)


def test_goals_beside_the_window_begin_as_nothing_and_then_move_the_egos_plan_alone() -> None:
    torch.manual_seed(0)
    config = find_preset("micro")
    inputs = {"goals_embedded": True, "goals": 2}
    teacher = make_teacher(config.model_copy(update={"motion": config.motion.model_copy(update=inputs)})).eval()
    plain = make_teacher(config.model_copy(update={"motion": config.motion.model_copy(update={"goals": 2})})).eval()
    plain.load_state_dict({k: v for k, v in teacher.state_dict().items() if "embedding.goal" not in k})
    image = torch.rand(1, 5, config.grid.rows, config.grid.cols)
    poses = torch.tensor([[[0.0, 0.0, 0.0], [3.0, -6.0, 0.2]]])
    goals = torch.tensor([[[0.0, -40.0], [0.0, -90.0]]])
    assert torch.equal(teacher(image, poses, goals).coarse, plain(image, poses, goals).coarse)
    assert teacher.embedding.goal is not None
    nn.init.normal_(teacher.embedding.goal.second.weight)
    straight, aside = (teacher(image, poses, goals + torch.tensor([x, 0.0])).coarse for x in (0.0, 3.0))
    assert float((straight - aside)[:, 0].abs().max()) > 1e-3
    assert torch.equal(straight[:, 1], aside[:, 1]), "where others go nobody knows"
