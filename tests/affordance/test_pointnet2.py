"""Laws of the encoder of clouds."""
# ruff: noqa: E402 - what needs torch is imported once it is known to be there

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from affordance.frames import Frame
from affordance.pointnet2 import (
    POINT,
    WHOLE,
    Encoder,
    farthest_points,
    gathered,
    indices_of,
    neighbours_in_ball,
)
from affordance.settings import PROFILES
from tests.affordance.clouds import clouds, seeded

TEST = PROFILES["test"]


@pytest.fixture(scope="module")
def encoder() -> Encoder:
    torch.manual_seed(0)
    encoder = Encoder(TEST)
    with torch.no_grad():
        encoder(clouds(8, TEST.points, seed=9))  # statistics of the normalisation
    return encoder.eval()


@pytest.mark.parametrize("name", PROFILES)
def test_every_profile_gives_features_of_points_and_of_the_whole(name: str) -> None:
    profile = PROFILES[name]
    with torch.no_grad():
        seen = Encoder(profile).eval()(clouds(1, profile.points))
    assert seen.points.shape == (1, profile.points, POINT)
    assert seen.whole.shape == (1, WHOLE)
    assert bool(torch.isfinite(seen.points).all() and torch.isfinite(seen.whole).all())


def test_the_order_of_points_does_not_matter(encoder: Encoder) -> None:
    cloud = clouds(2, TEST.points)
    order = torch.randperm(TEST.points, generator=seeded(3))
    with torch.no_grad():
        seen, shuffled = encoder(cloud), encoder(cloud[:, order])
    assert torch.allclose(seen.whole, shuffled.whole, atol=1e-4)
    assert torch.allclose(seen.points[:, order], shuffled.points, atol=1e-4)
    assert float(seen.whole.std(dim=0).max()) > 1e-3  # not a constant


def test_rows_of_a_batch_do_not_see_each_other(encoder: Encoder) -> None:
    cloud = clouds(3, TEST.points)
    with torch.no_grad():
        together, alone = encoder(cloud), encoder(cloud[1:2])
    assert torch.allclose(together.whole[1], alone.whole[0], atol=1e-5)
    assert torch.allclose(together.points[1], alone.points[0], atol=1e-5)


def test_indices_hold_for_turned_and_shifted_copies_and_change_nothing(encoder: Encoder) -> None:
    cloud = clouds(2, TEST.points)
    frame = Frame(torch.tensor([[0.3, -0.1, 0.2]]).expand(2, 3), torch.tensor([0.4, -2.0]))
    copy = torch.cat([frame.points_world(cloud[..., :3]) * 4.0, cloud[..., 3:]], dim=-1)
    stored, fresh = indices_of(cloud[..., :3], TEST), indices_of(copy[..., :3], TEST)
    for level in range(4):
        assert torch.equal(stored.centres[level], fresh.centres[level])
        assert torch.equal(stored.neighbours[level], fresh.neighbours[level])
    with torch.no_grad():
        assert torch.equal(encoder(copy, fresh).points, encoder(copy).points)


def test_farthest_points_cover_the_cloud_as_widely_as_they_are_apart() -> None:
    xyz = clouds(3, 400)[..., :3]
    kept = farthest_points(xyz, 40)
    assert all(len(set(row)) == 40 for row in kept.tolist())
    middle = gathered(xyz, kept)
    apart = torch.cdist(middle, middle) + 9.0 * torch.eye(40)
    covered = torch.cdist(xyz, middle).amin(dim=-1)
    assert bool((covered.amax(dim=-1) <= apart.flatten(1).amin(dim=-1) + 1e-5).all())


def test_a_ball_holds_the_nearest_points_within_its_radius_and_nothing_else() -> None:
    xyz = clouds(2, 200)[..., :3]
    centres = xyz[:, :10]
    found = neighbours_in_ball(xyz, centres, 0.2, 16)
    away = (centres[:, :, None] - xyz[:, None]).norm(dim=-1)
    for row in range(2):
        for k in range(10):
            inside = (away[row, k] <= 0.2).nonzero()[:, 0]
            nearest = inside[away[row, k][inside].argsort()][:16]
            assert set(found[row, k].tolist()) == set(nearest.tolist())


def test_an_empty_ball_holds_the_nearest_point() -> None:
    xyz = clouds(1, 50)[..., :3]
    centre = torch.full((1, 1, 3), 5.0)
    found = neighbours_in_ball(xyz, centre, 0.1, 8)
    assert set(found.flatten().tolist()) == {int((xyz[0] - 5.0).norm(dim=-1).argmin())}


def test_gathering_is_indexing() -> None:
    values = torch.randn(3, 20, 4, generator=seeded())
    index = torch.randint(20, (3, 5, 2), generator=seeded(1))
    assert torch.equal(gathered(values, index), torch.stack([values[b, index[b]] for b in range(3)]))


def test_every_weight_learns(encoder: Encoder) -> None:
    learner = Encoder(TEST).train()
    seen = learner(clouds(2, TEST.points))
    (seen.points.square().mean() + seen.whole[:, ::2].square().mean()).backward()
    assert all(weight.grad is not None and bool(weight.grad.any()) for weight in learner.parameters())


def test_a_cloud_that_is_too_small_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 64 points, not 63"):
        indices_of(torch.zeros(1, 63, 3), TEST)
