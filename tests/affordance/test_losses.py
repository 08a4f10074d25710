"""Laws of the losses."""
# ruff: noqa: E402 - what needs torch is imported once it is known to be there

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from affordance.flow import Flow
from affordance.frames import IDENTITY, code_of, flipped, rotation_of
from affordance.heads import CVAE
from affordance.losses import (
    Parts,
    affordance_loss,
    affordance_target,
    critic_loss,
    divergence,
    feasibility_loss,
    geodesic,
    hand_angle,
    masked_mean,
    opening_loss,
    operation_loss,
    orientation_loss,
    place_loss,
    pose_loss,
    prior_angles,
    push_loss,
    reach_loss,
    relay_label,
    sort_loss,
    total,
    warmed,
)
from affordance.networks import Operation
from affordance.settings import PRESETS, losses_of
from robots.errors import UnknownName
from robots.spatial import angle_between
from tests.affordance.clouds import rotations, seeded

DEFAULT, PRINTED = PRESETS["default"], PRESETS["printed"]


def about_x(angle: float) -> torch.Tensor:
    c, s = math.cos(angle), math.sin(angle)
    return torch.tensor([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]], dtype=torch.float64)


@pytest.mark.parametrize("form", ["atan2", "arccos"])
def test_the_geodesic_is_the_angle_between_rotations(form: str) -> None:
    Ra, Rb = rotations(40), rotations(40, seed=1)
    truth = [angle_between(a, b) for a, b in zip(Ra.numpy(), Rb.numpy(), strict=True)]
    assert np.allclose(geodesic(Ra, Rb, form).numpy(), truth, atol=1e-6)
    assert torch.allclose(geodesic(Ra, Rb, form), geodesic(Rb, Ra, form))


@pytest.mark.parametrize("form", ["atan2", "arccos"])
@pytest.mark.parametrize("angle", [0.0, 1e-7, 1e-3, 1.0, math.pi - 1e-3, math.pi - 1e-7, math.pi])
def test_the_gradient_is_finite_at_every_angle(form: str, angle: float) -> None:
    code = code_of(about_x(angle)).requires_grad_()
    found = geodesic(rotation_of(code), torch.eye(3, dtype=torch.float64), form)
    found.backward()
    assert float(found.detach()) == pytest.approx(angle, abs=2e-3)
    assert bool(torch.isfinite(code.grad).all())


def test_only_atan2_still_learns_close_to_the_answer() -> None:
    slopes = {}
    for form in ("atan2", "arccos"):
        code = code_of(about_x(1e-4)).requires_grad_()
        geodesic(rotation_of(code), torch.eye(3, dtype=torch.float64), form).backward()
        slopes[form] = float(code.grad.norm())
    assert slopes["atan2"] > 0.5
    assert slopes["arccos"] == 0.0


def test_half_a_turn_about_the_approach_costs_nothing_unless_the_preset_says_so() -> None:
    R, other = rotations(30), rotations(30, seed=2)
    assert torch.allclose(hand_angle(flipped(R), R, DEFAULT), torch.zeros(30, dtype=torch.float64), atol=1e-7)
    assert torch.allclose(hand_angle(flipped(R), other, DEFAULT), hand_angle(R, other, DEFAULT))
    assert torch.allclose(hand_angle(R, flipped(other), DEFAULT), hand_angle(R, other, DEFAULT))
    assert bool((hand_angle(R, other, DEFAULT) <= geodesic(R, other)).all())
    assert float(hand_angle(flipped(R), R, PRINTED).min()) > 3.1


def test_where_a_spin_means_nothing_only_the_approach_counts() -> None:
    R, other = rotations(30), rotations(30, seed=2)
    c, s = math.cos(1.1), math.sin(1.1)
    spun = R @ torch.tensor([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
    spins = torch.arange(30) % 2 == 0
    angle = hand_angle(spun, R, DEFAULT, spins)
    assert torch.allclose(angle[spins], torch.zeros(15, dtype=torch.float64), atol=1e-7)
    assert torch.allclose(angle[~spins], torch.full((15,), 1.1, dtype=torch.float64))
    truth = [math.acos(float(a[:, 2] @ b[:, 2])) for a, b in zip(R, other, strict=True)]
    free = hand_angle(R, other, DEFAULT, torch.ones(30, dtype=torch.bool))
    assert np.allclose(free.numpy(), truth, atol=1e-6)


def test_the_divergence_is_that_of_two_normal_distributions() -> None:
    mean, log_variance = torch.randn(2, 6, 32, generator=seeded(), dtype=torch.float64)
    normal = torch.distributions.Normal
    truth = torch.distributions.kl_divergence(normal(mean, (0.5 * log_variance).exp()), normal(0.0, 1.0)).sum(-1)
    assert torch.allclose(divergence(mean, log_variance), truth)
    assert float(divergence(torch.zeros(32), torch.zeros(32))) == 0.0


def test_the_weight_of_the_divergence_warms_up() -> None:
    assert [warmed(0.2, step, DEFAULT) for step in (0, 250, 500, 9000)] == pytest.approx([0.0, 0.1, 0.2, 0.2])
    assert warmed(0.02, 0, PRESETS["sxy"]) == 0.02


def test_only_booleans_mask() -> None:
    values = torch.arange(4.0)
    assert float(masked_mean(values, torch.tensor([False, True, False, True]))) == 2.0
    with pytest.raises(TypeError, match=r"a mask is boolean, not torch\.int64"):
        masked_mean(values, torch.tensor([0, 1, 0, 1]))
    with pytest.raises(ValueError, match="does not fit"):
        masked_mean(values, torch.tensor([True]))


@pytest.mark.parametrize("kept", [[True, False, True], [False, False, False]])
def test_masked_rows_have_neither_influence_nor_gradient(kept: list[bool]) -> None:
    values = torch.tensor([1.0, torch.inf, 3.0], requires_grad=True)
    mean = masked_mean(values, torch.tensor(kept))
    mean.backward()
    assert float(mean.detach()) == (2.0 if any(kept) else 0.0)
    assert values.grad.tolist() == ([0.5, 0.0, 0.5] if any(kept) else [0.0, 0.0, 0.0])


@pytest.mark.parametrize("kind", ["cvae", "flow"])
def test_failed_rows_teach_no_orientation(kind: str) -> None:
    torch.manual_seed(0)
    head = CVAE(8, (0.0,) * 6, 4) if kind == "cvae" else Flow(8, (0.0,) * 6, 5)
    condition = torch.randn(6, 8, generator=seeded())
    R = rotations(6).float()
    mask = torch.tensor([True, True, False, True, False, True])
    changed = torch.where(mask[:, None, None], R, rotations(6, seed=5).float())
    every = torch.ones(6, dtype=torch.bool)
    with torch.no_grad():
        found, same, unmasked = (
            float(orientation_loss(head, condition, truth, kept, DEFAULT, 5000, seeded(3)))
            for truth, kept in ((R, mask), (changed, mask), (changed, every))
        )
    assert found == same > 0.0
    assert unmasked != found


def test_a_pose_loss_is_zero_only_at_the_answer() -> None:
    class Sure(CVAE):
        def encode(self, condition: torch.Tensor, target: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            return torch.zeros(len(target), 4), torch.zeros(len(target), 4)

        def decode(self, condition: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
            return condition

    head, mask = Sure(9, (*IDENTITY, 0.0, 0.0, 0.0), 4), torch.ones(3, dtype=torch.bool)
    R = rotations(3).float()
    true = torch.cat([code_of(R), torch.randn(3, 3, generator=seeded())], dim=-1)
    assert float(pose_loss(head, true, true, mask, DEFAULT, 5000, seeded())) == pytest.approx(0.0, abs=1e-5)
    shifted = true + torch.tensor([0.0] * 6 + [0.3, 0.0, 0.0])
    assert float(pose_loss(head, shifted, true, mask, DEFAULT, 5000, seeded())) == pytest.approx(0.1, abs=1e-5)
    half_turn = torch.cat([code_of(flipped(R)), true[:, 6:]], dim=-1)
    assert float(pose_loss(head, half_turn, true, mask, DEFAULT, 5000, seeded())) == pytest.approx(math.pi, abs=1e-3)
    ten = float(pose_loss(head, half_turn, true, mask, PRESETS["biassembly"], 5000, seeded()))
    assert ten == pytest.approx(10 * math.pi, abs=2e-2)


def test_openings_and_pushes_are_judged_on_a_common_scale() -> None:
    mask = torch.tensor([True, False])
    opening = torch.tensor([0.01, 0.0])
    assert float(opening_loss(opening, torch.tensor([0.03, 0.04]), mask)) == pytest.approx(0.5)
    ahead, aside = torch.tensor([[1.0, 0.0]] * 2), torch.tensor([[0.0, 1.0]] * 2)
    length, sure, behind = torch.tensor([0.5, 0.5]), torch.tensor([100.0, 100.0]), torch.tensor([True, True])
    press = torch.tensor([False, False])

    def push(way: torch.Tensor, far: torch.Tensor, pushed: torch.Tensor = behind) -> float:
        return float(push_loss((ahead, length, sure), way, far, behind, pushed, mask))

    assert push(ahead, length) == pytest.approx(0.0, abs=1e-9)
    assert push(aside, length + 0.2) == pytest.approx(1.2)
    assert push(-ahead, length) == pytest.approx(2.0)
    assert push(-ahead, length + 0.2, press) == pytest.approx(0.2)
    assert float(reach_loss(torch.zeros(2, 3), torch.full((2, 3), 0.3), mask)) == pytest.approx(0.3)


def test_an_operation_is_judged_by_kind_directions_point_and_amount() -> None:
    up, kinds = torch.tensor([[0.0, 0.0, 1.0]]), torch.tensor([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    true = Operation(kinds, up, up, torch.zeros(1, 3), torch.tensor([1.0]))
    sure, every = 100.0 * kinds, torch.tensor([True])

    def error(found: Operation) -> float:
        return float(operation_loss(found, true, every, DEFAULT))

    assert error(Operation(sure, up, up, torch.zeros(1, 3), torch.tensor([1.0]))) == pytest.approx(0.0, abs=1e-6)
    assert error(Operation(sure, -up, up, torch.zeros(1, 3), torch.tensor([1.0]))) == pytest.approx(2.0)
    assert error(Operation(sure, up, up, torch.ones(1, 3), torch.tensor([1.0]))) == pytest.approx(4.0)
    less, more = (error(Operation(sure, up, up, torch.zeros(1, 3), torch.tensor([a]))) for a in (0.5, 1.5))
    assert less == pytest.approx(2.0 * 0.7 * 0.5) and more == pytest.approx(2.0 * 0.3 * 0.5)


def test_an_operation_is_picked_by_its_kind() -> None:
    kinds, amount = torch.zeros(2, 6), torch.arange(12.0).reshape(2, 6)
    ways = torch.nn.functional.one_hot(torch.arange(6) % 3, 3).float().expand(2, 6, 3)
    picked = Operation(kinds, ways, -ways, 2.0 * ways, amount).of(torch.tensor([1, 5]))
    assert picked.direction.tolist() == [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    assert picked.outward.tolist() == (-picked.direction).tolist()
    assert picked.point.tolist() == (2.0 * picked.direction).tolist()
    assert picked.amount.tolist() == [1.0, 11.0]


def test_a_place_is_judged_by_the_chance_of_all_points_where_the_hand_acted() -> None:
    logits = torch.log(torch.tensor([[0.1, 0.2, 0.3, 0.4], [0.1, 0.2, 0.3, 0.4], [0.7, 0.1, 0.1, 0.1]]))
    acted = torch.tensor([[True, True, False, False], [False, False, False, True], [False] * 4])
    allowed = torch.tensor([[True] * 4, [False, True, False, True], [True] * 4])
    every, one = torch.tensor([True, True, True]), torch.tensor([False, True, False])
    assert float(place_loss(logits, acted, allowed, one)) == pytest.approx(-math.log(0.4 / 0.6), rel=1e-5)
    both = -0.5 * (math.log(0.3) + math.log(0.4 / 0.6))  # the last row was seen acting nowhere
    assert float(place_loss(logits, acted, allowed, every)) == pytest.approx(both, rel=1e-5)
    learned = logits.clone().requires_grad_()
    place_loss(learned, acted, allowed, every).backward()
    assert bool((learned.grad[0, :2] < 0.0).all()) and bool((learned.grad[0, 2:] > 0.0).all())
    assert not bool(learned.grad[2].any()) and float(learned.grad[1, 0]) == 0.0


def test_affordance_is_the_mean_of_the_best_judgements_and_teaches_no_critic() -> None:
    probability = torch.tensor([[0.9, 0.1, 0.5, 0.7], [0.2, 0.2, 0.2, 0.2]])
    logits = torch.logit(probability).requires_grad_()
    best = msgspec.structs.replace(DEFAULT, top=2)
    assert not affordance_target(logits, best).requires_grad
    assert affordance_target(logits, best).tolist() == pytest.approx([0.8, 0.2])
    assert affordance_target(logits, PRESETS["sxy"]).tolist() == pytest.approx([0.55, 0.2])
    scores = torch.tensor([0.5, 0.5], requires_grad=True)
    loss = affordance_loss(scores, affordance_target(logits, best), torch.tensor([True, True]))
    loss.backward()
    assert float(loss.detach()) == pytest.approx(0.3)
    assert logits.grad is None
    assert scores.grad.tolist() == [-0.5, 0.5]


def test_a_critic_is_least_wrong_at_its_soft_label() -> None:
    labels, mask = torch.full((1,), 0.3), torch.ones(1, dtype=torch.bool)
    right = float(critic_loss(torch.logit(labels), labels, mask))
    for other in (0.2, 0.4):
        assert float(critic_loss(torch.logit(torch.tensor([other])), labels, mask)) > right


def test_every_point_where_a_hand_acted_says_the_kind_and_no_other_point_does() -> None:
    kind = torch.tensor([2, 0])
    acted = torch.zeros(2, 5, dtype=torch.bool)
    acted[0, 1:3] = True
    logits = torch.zeros(2, 5, 6, requires_grad=True)
    loss = sort_loss(logits, kind, acted, torch.tensor([True, True]))
    assert float(loss.detach()) == pytest.approx(
        np.log(6.0)
    )  # the second row, in which no point was acted at, does not count
    loss.backward()
    assert torch.equal(logits.grad.abs().sum(-1) > 0.0, acted)
    assert float(logits.grad[0, 1, 2]) == pytest.approx(0.5 * (1.0 / 6.0 - 1.0))
    right = torch.nn.functional.one_hot(kind, 6).float()[:, None].expand(2, 5, 6)
    assert float(sort_loss(50.0 * right, kind, acted, torch.tensor([True, False]))) == pytest.approx(0.0, abs=1e-6)
    assert float(sort_loss(torch.zeros(2, 5, 6), kind, acted, torch.tensor([False, True]))) == 0.0


def test_checks_that_were_not_reached_teach_nothing() -> None:
    logits = torch.randn(4, 3, 3, generator=seeded(), requires_grad=True)
    known = torch.tensor([[True, False, False], [True, True, False], [True, True, True], [False, False, False]])
    feasibility_loss(logits, torch.ones(4, 3), known).backward()
    taught = logits.grad != 0.0
    assert torch.equal(taught, known[:, None].expand(4, 3, 3))


def test_a_preparation_is_worth_half_the_outcome_and_half_the_outlook() -> None:
    prepared, success = torch.tensor([True, True, False]), torch.tensor([True, False, False])
    assert relay_label(prepared, success, torch.tensor([0.6, 0.6, 0.6])).tolist() == pytest.approx([0.8, 0.3, 0.0])


def test_the_total_weighs_every_part() -> None:
    ones = Parts(*(torch.tensor(1.0) for _ in range(19)))
    assert float(total(ones, DEFAULT)) == 14 + 2 * DEFAULT.w_reach + 2 * DEFAULT.w_place + DEFAULT.w_sort
    assert float(total(ones, PRESETS["biassembly"])) == pytest.approx(
        9 + 2 * DEFAULT.w_reach + 2 * DEFAULT.w_place + DEFAULT.w_sort + 5 * 0.01
    )
    names = ("orientation", "pose", "opening", "reach", "operation", "push", "place", "sort", "critic", "feasibility")
    off = {f"w_{name}": 0.0 for name in names}
    alone = msgspec.structs.replace(DEFAULT, **off)
    assert float(total(ones, alone)) == 2.0


def test_an_unknown_preset_names_those_there_are() -> None:
    with pytest.raises(UnknownName, match=r'No loss preset "defalt"\. Did you mean "default"\?'):
        losses_of("defalt")


def test_validation_sees_what_reconstruction_hides() -> None:
    """With too weak a divergence term a cVAE keeps the answer in its latent: it rebuilds all, and draws wrong."""
    kinds, rebuilt, drawn_errors = 16, {}, {}
    R, every = rotations(kinds).float(), torch.eye(kinds)
    R_true, condition, mask = R.repeat(4, 1, 1), every.repeat(4, 1), torch.ones(4 * kinds, dtype=torch.bool)
    for kl in (0.002, 0.2):
        weights = msgspec.structs.replace(DEFAULT.orientation, kl=kl)
        losses = msgspec.structs.replace(DEFAULT, orientation=weights, kl_warmup=0, flip=False)
        torch.manual_seed(0)
        head, generator = CVAE(kinds, (0.0,) * 6, 8), seeded(1)
        optimiser = torch.optim.Adam(head.parameters(), 3e-3)
        for step in range(300):
            optimiser.zero_grad()
            orientation_loss(head, condition, R_true, mask, losses, step, generator).backward()
            optimiser.step()
        with torch.no_grad():
            mean, _ = head.encode(every, code_of(R))
            rebuilt[kl] = float(geodesic(rotation_of(head.decode(every, mean)), R).mean())
        drawn_errors[kl] = float(prior_angles(head, every, R, losses, 100, generator).mean())
    assert max(rebuilt.values()) < 0.1
    assert drawn_errors[0.2] < 0.15
    assert drawn_errors[0.002] > 0.5
