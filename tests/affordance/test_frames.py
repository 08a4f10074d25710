"""Laws of the coordinates that the networks share."""
# ruff: noqa: E402 - what needs torch is imported once it is known to be there

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from affordance.frames import (
    IDENTITY,
    ROLES,
    Frame,
    carried,
    cloud_of,
    code_of,
    flipped,
    frame_of,
    heading_of,
    homogeneous,
    moved_cloud,
    rotation_of,
    turned,
)
from affordance.settings import SCALE
from robots.spatial import hand_rotation
from tests.affordance.clouds import rotations, seeded

B = 5


def random_frame(seed: int = 1) -> Frame:
    g = seeded(seed)
    return Frame(
        torch.rand(B, 3, generator=g, dtype=torch.float64), 6.0 * torch.rand(B, generator=g, dtype=torch.float64)
    )


def random_poses(seed: int) -> torch.Tensor:
    shift = torch.randn(B, 3, generator=seeded(seed), dtype=torch.float64)
    return homogeneous(rotations(B, seed=seed), shift)


def applied(T: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
    return turned(T[:, :3, :3], points) + T[:, None, :3, 3]


def about_vertical(angle: float) -> torch.Tensor:
    frame = Frame(torch.zeros(1, 3, dtype=torch.float64), torch.tensor([angle], dtype=torch.float64))
    return frame.directions(torch.eye(3, dtype=torch.float64)[None])[0].T.expand(B, 3, 3)


def test_a_code_is_approach_then_opening_and_turns_back_into_its_rotation() -> None:
    R = rotations(4, 7)
    code = code_of(R)
    assert torch.equal(code[..., :3], R[..., :, 2])
    assert torch.equal(code[..., 3:], R[..., :, 1])
    assert torch.allclose(rotation_of(code), R, atol=1e-12)
    assert torch.equal(rotation_of(torch.tensor(IDENTITY)), torch.eye(3))


def test_any_six_numbers_stand_for_the_rotation_that_the_planner_would_build() -> None:
    code = torch.randn(50, 6, generator=seeded(), dtype=torch.float64)
    R = rotation_of(code)
    assert torch.allclose(torch.linalg.det(R), torch.ones(50, dtype=torch.float64))
    for found, numbers in zip(R.numpy(), code.numpy(), strict=True):
        assert np.allclose(found, hand_rotation(numbers[:3], numbers[3:]), atol=1e-12)


def test_a_flip_keeps_the_approach_and_undoes_itself() -> None:
    R = rotations(9)
    assert torch.equal(flipped(R)[..., 2], R[..., 2])
    assert torch.equal(flipped(R)[..., 1], -R[..., 1])
    assert torch.allclose(torch.linalg.det(flipped(R)), torch.ones(9, dtype=torch.float64))
    assert torch.equal(flipped(flipped(R)), R)


def test_points_directions_and_rotations_come_back_from_network_coordinates() -> None:
    frame = random_frame()
    points = torch.randn(B, 11, 3, generator=seeded(2), dtype=torch.float64)
    R = rotations(B, 4, 2)
    assert torch.allclose(frame.points_world(frame.points(points)), points)
    assert torch.allclose(frame.directions_world(frame.directions(points)), points)
    assert torch.allclose(frame.rotations_world(frame.codes(R)), R)
    one = points[:, 0]
    assert torch.allclose(frame.points(one), frame.points(points)[:, 0])


def test_size_stays_visible_and_the_centre_is_zero() -> None:
    frame = random_frame()
    assert torch.allclose(frame.points(frame.centre), torch.zeros(B, 3, dtype=torch.float64))
    apart = frame.points(frame.centre + torch.tensor([0.0, 0.0, 0.1])) - frame.points(frame.centre)
    assert torch.allclose(apart.norm(dim=-1), torch.full((B,), 0.1 / SCALE, dtype=torch.float64))


def test_motions_come_back_about_any_pivot() -> None:
    frame, T_move = random_frame(), random_poses(3)
    for pivot in (frame.centre, torch.randn(B, 3, generator=seeded(4), dtype=torch.float64)):
        moves = frame.moves(T_move, pivot)
        assert torch.allclose(frame.moves_world(moves, pivot), T_move, atol=1e-9)
        many = frame.moves_world(moves[:, None].expand(B, 6, 9), pivot)
        assert torch.allclose(many, T_move[:, None].expand(B, 6, 4, 4), atol=1e-9)


def test_moving_the_cloud_of_a_network_is_moving_the_object_in_the_world() -> None:
    points = torch.rand(B, 20, 3, generator=seeded(5), dtype=torch.float64)
    roles = torch.zeros(B, 20, dtype=torch.long)
    frame = frame_of(points, roles, random_frame().yaw)
    T_move = random_poses(6)
    moved = moved_cloud(cloud_of(frame, points, roles), frame.moves(T_move, frame.centre))
    assert torch.allclose(moved, cloud_of(frame, applied(T_move, points), roles), atol=1e-9)


def test_turning_the_world_is_adding_to_the_yaw() -> None:
    turn, angle = about_vertical(0.7), 0.7
    frame = random_frame()
    points = torch.randn(B, 8, 3, generator=seeded(7), dtype=torch.float64)
    R, T_move = rotations(B, seed=8), random_poses(9)
    outward = torch.nn.functional.normalize(points[:, 0] * torch.tensor([1.0, 1.0, 0.0]), dim=-1)
    there = Frame(turned(turn, frame.centre), frame.yaw)
    here = Frame(frame.centre, frame.yaw + angle)
    T_turn = homogeneous(turn, torch.zeros(B, 3, dtype=torch.float64))
    assert torch.allclose(there.points(turned(turn, points)), here.points(points))
    assert torch.allclose(there.codes(turn @ R), here.codes(R))
    there_moves = there.moves(T_turn @ T_move @ T_turn.mT, there.centre)
    assert torch.allclose(there_moves, here.moves(T_move, frame.centre))
    there_edges = there.edges(turned(turn, points[:, 1]), turned(turn, outward))
    assert torch.allclose(there_edges, here.edges(points[:, 1], outward))
    assert not torch.allclose(here.codes(R), frame.codes(R))


def test_an_edge_tells_distance_direction_and_height_wherever_its_point_is_taken() -> None:
    frame = Frame(torch.tensor([[0.2, 0.0, 0.05]]), torch.zeros(1))
    outward = torch.tensor([[1.0, 0.0, 0.0]])
    token = frame.edges(torch.tensor([[0.5, 0.9, 0.0]]), outward)
    assert torch.allclose(token, torch.tensor([[1.0, 0.0, 0.3 / SCALE, 0.05 / SCALE]]))
    assert torch.allclose(frame.edges(torch.tensor([[0.5, -0.4, 0.0]]), outward), token)
    over = Frame(torch.tensor([[0.6, 0.0, 0.05]]), torch.zeros(1))
    assert over.edges(torch.tensor([[0.5, 0.0, 0.0]]), outward)[0, 2] < 0.0


def test_the_centre_is_the_object_whatever_the_gripper_does() -> None:
    points = torch.rand(2, 30, 3, generator=seeded(10))
    roles = torch.zeros(2, 30, dtype=torch.long)
    roles[:, 20:] = ROLES.index("gripper")
    frame = frame_of(points, roles, torch.zeros(2))
    assert torch.allclose(frame.centre, points[:, :20].mean(dim=1))
    points[:, 20:] += 3.0
    assert torch.equal(frame_of(points, roles, torch.zeros(2)).centre, frame.centre)
    cloud = cloud_of(frame, points, roles)
    assert cloud.shape == (2, 30, 6)
    assert torch.equal(cloud[..., 3:].argmax(-1), roles)
    with pytest.raises(ValueError, match="without points of the object"):
        frame_of(points, torch.full_like(roles, ROLES.index("support")), torch.zeros(2))


def test_an_anticipatory_label_keeps_the_hand_on_the_link() -> None:
    then, now, hand = random_poses(11), random_poses(12), random_poses(13)
    label = carried(then, now, hand)
    assert torch.allclose(torch.linalg.inv(now) @ label, torch.linalg.inv(then) @ hand)
    paper = now[:, :3, :3] @ then[:, :3, :3].mT @ hand[:, :3, :3]
    assert torch.allclose(label[:, :3, :3], paper)
    assert torch.allclose(carried(now, then, label), hand)
    assert torch.allclose(carried(then, then, hand), hand)


def shapes() -> torch.Tensor:
    """Long clouds ``(B, 60, 3)``, each with a longer tail at one end."""
    along = torch.rand(B, 60, 1, generator=seeded(11), dtype=torch.float64).square()
    return torch.cat([along, 0.2 * torch.rand(B, 60, 2, generator=seeded(12), dtype=torch.float64)], dim=-1)


def test_the_heading_follows_the_object_and_nothing_else() -> None:
    points, roles = shapes(), torch.zeros(B, 60, dtype=torch.long)
    for angle in (0.0, 0.4, 2.0, -3.0):
        there = turned(about_vertical(angle), points) + torch.tensor([3.0, -1.0, 0.5])
        seen = cloud_of(frame_of(there, roles, heading_of(there, roles)), there, roles)
        assert torch.allclose(seen, cloud_of(frame_of(points, roles, heading_of(points, roles)), points, roles))
    along = seen[..., 0]
    assert bool((along.var(dim=1) > 2.0 * seen[..., 1].var(dim=1)).all())
    assert bool((along.pow(3).mean(dim=1) > 0.0).all())


def test_a_gripper_in_view_does_not_turn_the_heading() -> None:
    points, roles = shapes(), torch.zeros(B, 60, dtype=torch.long)
    with_hand = torch.cat([points, 5.0 + torch.randn(B, 8, 3, generator=seeded(13), dtype=torch.float64)], dim=1)
    seen = torch.cat([roles, torch.ones(B, 8, dtype=torch.long)], dim=1)
    assert torch.allclose(heading_of(with_hand, seen), heading_of(points, roles))
