"""Laws of the head that carries noise to answers."""
# ruff: noqa: E402 - what needs torch is imported once it is known to be there

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from affordance.flow import Flow
from affordance.frames import code_of, flipped, rotation_of
from affordance.heads import CVAE, drawn
from affordance.losses import geodesic
from tests.affordance.clouds import rotations, seeded


def straight(velocity: torch.Tensor) -> Flow:
    """A flow with the same velocity everywhere."""
    flow = Flow(2, (0.0,) * 6, 7)
    with torch.no_grad():
        flow.velocity[-1].weight.zero_()
        flow.velocity[-1].bias.copy_(velocity)
    return flow


def test_a_straight_flow_is_integrated_exactly() -> None:
    velocity, z = torch.randn(6, generator=seeded()), torch.randn(5, 6, generator=seeded(1))
    assert torch.allclose(straight(velocity).decode(torch.zeros(5, 2), z), z - velocity, atol=1e-6)


def test_the_error_of_the_true_velocity_is_zero() -> None:
    flow = Flow(2, (0.0,) * 6, 5)
    answer = torch.full((1, 6), 0.4)

    def true_velocity(condition: torch.Tensor, state: torch.Tensor, time: torch.Tensor) -> torch.Tensor:
        return (state - answer) / time

    flow._velocity = true_velocity  # type: ignore[method-assign]
    assert float(flow.errors(torch.zeros(1, 2), answer, seeded())) == pytest.approx(0.0, abs=1e-8)
    assert torch.allclose(flow.decode(torch.zeros(1, 2), torch.randn(1, 6, generator=seeded())), answer, atol=1e-5)


@pytest.mark.parametrize("kind", ["flow", "cvae"])
def test_draws_have_the_dimensions_of_their_conditions_and_repeat_with_the_seed(kind: str) -> None:
    torch.manual_seed(0)
    head = Flow(4, (0.0,) * 9, 5) if kind == "flow" else CVAE(4, (0.0,) * 9, 32)
    condition = torch.randn(2, 3, 4, generator=seeded())
    found = drawn(head, condition, 6, seeded(2), middle_first=True)
    assert found.shape == (2, 3, 6, 9)
    assert torch.equal(found, drawn(head, condition, 6, seeded(2), middle_first=True))
    other = drawn(head, condition, 6, seeded(3), middle_first=True)
    assert torch.equal(found[..., 0, :], other[..., 0, :])
    assert not torch.equal(found[..., 1, :], other[..., 1, :])
    single = head.decode(condition[1, 2], torch.zeros(head.latent))
    assert torch.allclose(found[1, 2, 0], single, atol=1e-6)


def test_it_learns_both_of_two_answers() -> None:
    torch.manual_seed(0)
    flow, generator = Flow(2, (0.0,) * 6, 10), seeded(1)
    R = rotations(1, seed=4).float()
    modes = torch.cat([R, flipped(R)])
    target, condition = code_of(modes).repeat(128, 1), torch.zeros(256, 2)
    optimiser = torch.optim.Adam(flow.parameters(), 3e-3)
    for _ in range(400):
        optimiser.zero_grad()
        flow.errors(condition, target, generator).mean().backward()
        optimiser.step()
    with torch.no_grad():
        found = rotation_of(drawn(flow, torch.zeros(2), 500, generator))
    angles = geodesic(found[:, None], modes)
    near = angles < 0.35
    assert float(near.any(dim=-1).float().mean()) > 0.85
    assert float(near.float().mean(dim=0).min()) > 0.3
