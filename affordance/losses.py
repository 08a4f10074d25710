"""How wrong is a prediction? The paper's losses, with the numbers of ``affordance.settings``.

Rows that a loss must not see are masked by booleans; a mean over no row is zero. Angles are in radians.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from torch import Tensor
from torch.nn import functional

from affordance.flow import Flow
from affordance.frames import CODE, code_of, flipped, rotation_of
from affordance.heads import CVAE, Head, drawn
from affordance.networks import WIDEST, Operation
from affordance.settings import Losses, Weights

CLAMP = 1e-6
"""How far a cosine is kept from one before its arccosine is taken, whose gradient is infinite there."""


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """The losses of all networks, each a number; those of an absent one are zero.

    Attributes:
        orientation_goal: Of the primary's hand.
        orientation_pre: Of the assistant's hand.
        pose_object: Of the object's motion.
        pose_hand: Of the holding hand's motion.
        opening_goal: Of how wide the primary's fingers are open.
        opening_pre: Of how wide the assistant's are.
        reach_goal: Of where the primary's finger tips are.
        reach_pre: Of where the assistant's are.
        operation: Of what the primary does.
        push: Of where a push goes.
        place_goal: Of where the primary acts.
        place_pre: Of where the assistant does.
        affordance_goal: Of the primary's map.
        affordance_pre: Of the assistant's map.
        critic_goal: Of the judge of primary actions.
        critic_pre: Of the judge of assistant actions.
        critic_pose: Of the judge of object motions.
        feasibility: Of the judge of what the planner accepts.
    """

    orientation_goal: Tensor
    orientation_pre: Tensor
    pose_object: Tensor
    pose_hand: Tensor
    opening_goal: Tensor
    opening_pre: Tensor
    reach_goal: Tensor
    reach_pre: Tensor
    operation: Tensor
    push: Tensor
    place_goal: Tensor
    place_pre: Tensor
    sort_goal: Tensor
    affordance_goal: Tensor
    affordance_pre: Tensor
    critic_goal: Tensor
    critic_pre: Tensor
    critic_pose: Tensor
    feasibility: Tensor


def total(parts: Parts, losses: Losses) -> Tensor:
    """The number that is minimised: the paper's weighted sum."""
    kinds = {
        "orientation": losses.w_orientation,
        "pose": losses.w_pose,
        "opening": losses.w_opening,
        "reach": losses.w_reach,
        "operation": losses.w_operation,
        "push": losses.w_push,
        "place": losses.w_place,
        "sort": losses.w_sort,
        "affordance": losses.w_affordance,
        "critic": losses.w_critic,
        "feasibility": losses.w_feasibility,
    }
    named = [(field.name.partition("_")[0], getattr(parts, field.name)) for field in fields(parts)]
    return torch.stack([kinds[kind] * value for kind, value in named]).sum()


def masked_mean(values: Tensor, mask: Tensor) -> Tensor:
    """Mean of ``values`` ``(...)`` where ``mask`` ``(...)`` is true; zero, gradient included, where it never is."""
    if mask.dtype != torch.bool:
        raise TypeError(f"a mask is boolean, not {mask.dtype}: an integer one would pick rows 0 and 1")
    if mask.shape != values.shape:
        raise ValueError(f"a mask of shape {tuple(mask.shape)} does not fit values of shape {tuple(values.shape)}")
    kept = torch.where(mask, values, torch.zeros_like(values))
    return kept.sum() / mask.sum().clamp(min=1)


def geodesic(Ra: Tensor, Rb: Tensor, form: str = "atan2") -> Tensor:
    """Angle ``(...)`` in ``[0, pi]`` between rotations ``(..., 3, 3)``; its gradient is finite everywhere.

    Args:
        Ra: One rotation.
        Rb: The other.
        form: ``atan2`` of twice the sine and twice the cosine, or the paper's ``arccos``, clamped.
    """
    between = Ra.mT @ Rb
    cosine = between.diagonal(dim1=-2, dim2=-1).sum(-1) - 1.0
    if form == "arccos":
        return torch.arccos((0.5 * cosine).clamp(-1.0 + CLAMP, 1.0 - CLAMP))
    skew = between - between.mT
    sine = torch.linalg.vector_norm(torch.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], dim=-1), dim=-1)
    return torch.atan2(sine, cosine)


def hand_angle(R: Tensor, R_true: Tensor, losses: Losses, spins: Tensor | None = None) -> Tensor:
    """Angle ``(...)`` between hands ``(..., 3, 3)``; if both ways to hold count as one, the lesser of the two.

    In rows of ``spins`` ``(...)``, where a turn about the approach means nothing, that between the approaches.
    """
    angle = geodesic(R, R_true, losses.geodesic)
    if losses.flip:
        angle = torch.minimum(angle, geodesic(flipped(R), R_true, losses.geodesic))
    if spins is None:
        return angle
    approach, approach_true = R[..., :, 2], R_true[..., :, 2]
    sine = torch.linalg.vector_norm(torch.linalg.cross(approach, approach_true.expand_as(approach)), dim=-1)
    return torch.where(spins, torch.atan2(sine, (approach * approach_true).sum(-1)), angle)


def divergence(mean: Tensor, log_variance: Tensor) -> Tensor:
    """Kullback-Leibler divergence ``(...)`` from the standard normal, summed over the latent ``(..., latent)``."""
    return 0.5 * (mean.square() + log_variance.exp() - 1.0 - log_variance).sum(-1)


def warmed(weight: float, step: int | Tensor, losses: Losses) -> float | Tensor:
    """The weight of the divergence at a step of training: it rises from zero over the warm-up."""
    if not losses.kl_warmup:
        return weight
    share = step / losses.kl_warmup
    return weight * (share.clamp(max=1.0) if isinstance(share, Tensor) else min(1.0, share))


def orientation_loss(
    head: CVAE | Flow,
    condition: Tensor,
    R_true: Tensor,
    mask: Tensor,
    losses: Losses,
    step: int | Tensor,
    generator: torch.Generator,
    spins: Tensor | None = None,
) -> Tensor:
    """Loss of a head that draws orientations of a hand.

    Args:
        head: The head.
        condition: ``(..., C)`` what it was told.
        R_true: ``(..., 3, 3)`` how the hand was turned, in network coordinates.
        mask: ``(...)`` rows that count: successes only.
        losses: The weights.
        step: Of training.
        generator: Decides the latents.
        spins: ``(...)`` rows in which a turn about the approach means nothing, as in ``hand_angle``.
    """
    if isinstance(head, Flow):
        if losses.flip:
            coin = torch.rand(mask.shape, generator=generator, device=generator.device) < 0.5
            R_true = torch.where(coin[..., None, None], flipped(R_true), R_true)
        return losses.orientation.angle * masked_mean(head.errors(condition, code_of(R_true), generator), mask)
    out, kl = _reconstructed(head, condition, code_of(R_true), generator)
    angle = hand_angle(rotation_of(out), R_true, losses, spins)
    return _weighted(angle, torch.zeros_like(angle), kl, mask, losses.orientation, losses, step)


def pose_loss(
    head: CVAE | Flow,
    condition: Tensor,
    move_true: Tensor,
    mask: Tensor,
    losses: Losses,
    step: int | Tensor,
    generator: torch.Generator,
) -> Tensor:
    """Loss of a head that draws rigid motions ``(..., 9)``; the arguments are those of ``orientation_loss``."""
    if isinstance(head, Flow):
        return losses.pose.angle * masked_mean(head.errors(condition, move_true, generator), mask)
    out, kl = _reconstructed(head, condition, move_true, generator)
    angle = geodesic(rotation_of(out[..., :CODE]), rotation_of(move_true[..., :CODE]), losses.geodesic)
    shift = (out[..., CODE:] - move_true[..., CODE:]).abs().mean(-1)
    return _weighted(angle, shift, kl, mask, losses.pose, losses, step)


def opening_loss(opening: Tensor, true: Tensor, mask: Tensor) -> Tensor:
    """Mean absolute error of openings ``(...)`` [m], as a share of the widest."""
    return masked_mean((opening - true).abs(), mask) / WIDEST


def reach_loss(reach: Tensor, true: Tensor, mask: Tensor) -> Tensor:
    """Mean absolute error of offsets ``(..., 3)`` in units of ``SCALE``."""
    return masked_mean((reach - true).abs().mean(-1), mask)


def push_loss(
    push: tuple[Tensor, Tensor, Tensor], heading: Tensor, length: Tensor, behind: Tensor, pushed: Tensor, mask: Tensor
) -> Tensor:
    """Error of pushes and presses.

    Args:
        push: What ``PreAffordance.push`` says.
        heading: True unit vectors ``(..., 2)``; one less the cosine counts, where it was a push.
        length: True lengths ``(...)`` in units of ``SCALE``; the absolute error counts.
        behind: Booleans ``(...)``, whether it came from behind; the cross entropy counts, where it was a push.
        pushed: Booleans ``(...)``, whether it was a push and not a press.
        mask: ``(...)`` rows that were either, and successes.
    """
    way, far, logit = push
    cross = functional.binary_cross_entropy_with_logits(logit, behind.to(logit.dtype), reduction="none")
    aside = torch.where(pushed, 1.0 - (way * heading).sum(-1) + 0.2 * cross, torch.zeros_like(far))
    return masked_mean(aside + (far - length).abs(), mask)


def operation_loss(found: Operation, true: Operation, mask: Tensor, losses: Losses) -> Tensor:
    """Error of what is done at the goal.

    The kind's cross entropy, one less the cosine of both directions, the mean absolute error of the point, and the
    quantile loss of the amount (Koenker and Bassett, "Regression Quantiles", Econometrica 1978, eq. 2.1).

    Args:
        found: What the network says, of the kind that was done.
        true: What was done; ``kinds`` is one-hot.
        mask: ``(...)`` rows that count: successes.
        losses: Which quantile of the amounts is learned.
    """
    kinds = -(functional.log_softmax(found.kinds, dim=-1) * true.kinds).sum(-1)
    ways = 2.0 - (found.direction * true.direction).sum(-1) - (found.outward * true.outward).sum(-1)
    short = true.amount - found.amount
    amount = torch.maximum(losses.enough * short, (losses.enough - 1.0) * short)
    point = (found.point - true.point).abs().mean(-1)
    return masked_mean(0.3 * kinds + ways + 4.0 * point + 2.0 * amount, mask)


def place_loss(logits: Tensor, acted: Tensor, allowed: Tensor, mask: Tensor) -> Tensor:
    """Negative logarithm of the chance that a hand acts at one of the points where it did.

    Every point of a cloud has a say in this, which is what makes small parts seen: judged by a few points of each
    cloud alone, networks did not learn in thousands of steps at which end of a pen the button is, and did so in a
    hundred.

    Args:
        logits: ``(B, N)`` as ``Contact.places`` gives them.
        acted: Booleans ``(B, N)``: where it acted.
        allowed: Booleans ``(B, N)``: the object's points.
        mask: ``(B,)`` rows that count: successes that were seen acting somewhere.
    """
    chances = functional.log_softmax(logits.masked_fill(~allowed, -1e9), dim=-1)
    there = torch.logsumexp(chances.masked_fill(~(acted & allowed), -1e9), dim=-1)
    return -masked_mean(there, mask & (acted & allowed).any(dim=-1))


def sort_loss(logits: Tensor, kind: Tensor, acted: Tensor, mask: Tensor) -> Tensor:
    """Cross entropy of the kind of operation at every point where the hand acted.

    Args:
        logits: ``(B, N, 6)`` as ``GoalAffordance.sorts`` gives them.
        kind: ``(B,)`` number of what was done.
        acted: Booleans ``(B, N)``: where.
        mask: ``(B,)`` rows that count: successes.
    """
    cross = functional.cross_entropy(logits.mT, kind[:, None].expand(acted.shape), reduction="none")
    share = acted / acted.sum(dim=-1, keepdim=True).clamp(min=1)
    return masked_mean((cross * share).sum(-1), mask & acted.any(dim=-1))


def affordance_loss(scores: Tensor, targets: Tensor, mask: Tensor) -> Tensor:
    """Mean absolute error of scores ``(B, K)``; points without a label are masked."""
    return masked_mean((scores - targets.detach()).abs(), mask)


def critic_loss(logits: Tensor, labels: Tensor, mask: Tensor) -> Tensor:
    """Cross entropy of logits ``(...)`` with labels in ``[0, 1]``; rows whose stage was never reached are masked."""
    return masked_mean(functional.binary_cross_entropy_with_logits(logits, labels, reduction="none"), mask)


def feasibility_loss(logits: Tensor, labels: Tensor, known: Tensor) -> Tensor:
    """Cross entropy of every member of ``(..., M, C)`` with labels ``(..., C)``, those that are ``known``."""
    full = logits.shape
    return critic_loss(logits, labels[..., None, :].expand(full), known[..., None, :].expand(full))


def affordance_target(logits: Tensor, losses: Losses) -> Tensor:
    """Affordance ``(...)`` of points for whose actions ``(..., draws)`` a critic gave logits: the mean of the best."""
    best = torch.sigmoid(logits.detach()).topk(min(losses.top, logits.shape[-1]), dim=-1).values
    return best.mean(-1)


def relay_label(prepared: Tensor, success: Tensor, outlook: Tensor) -> Tensor:
    """What an assistant's action ``(B,)`` was worth in ``[0, 1]``: half the outcome, half the outlook it made.

    Args:
        prepared: Booleans: the assistant's stages went well; the label is zero where they did not.
        success: Booleans: the episode succeeded.
        outlook: Affordance of the goal action on the prepared object.
    """
    return torch.where(prepared, 0.5 * success.to(outlook.dtype) + 0.5 * outlook, torch.zeros_like(outlook))


def prior_angles(
    head: Head,
    condition: Tensor,
    R_true: Tensor,
    losses: Losses,
    draws: int,
    generator: torch.Generator,
    spins: Tensor | None = None,
) -> Tensor:
    """Angles ``(..., draws)`` between what a head draws from its prior and ``(..., 3, 3)``, for validation.

    A reconstruction error says nothing here: it is small for a latent that the prior never draws.
    """
    with torch.no_grad():
        out = drawn(head, condition, draws, generator)
        free = None if spins is None else spins[..., None]
        return hand_angle(rotation_of(out[..., :CODE]), R_true[..., None, :, :], losses, free)


def _reconstructed(head: CVAE, condition: Tensor, target: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """The decoder's answer with a latent drawn from what the encoder says, and the divergence of that."""
    mean, log_variance = head.encode(condition, target)
    noise = torch.randn(mean.shape, generator=generator, device=generator.device, dtype=mean.dtype)
    return head.decode(condition, mean + (0.5 * log_variance).exp() * noise), divergence(mean, log_variance)


def _weighted(
    angle: Tensor, shift: Tensor, kl: Tensor, mask: Tensor, weights: Weights, losses: Losses, step: int | Tensor
) -> Tensor:
    row = weights.angle * angle + weights.shift * shift + warmed(weights.kl, step, losses) * kl
    return masked_mean(row, mask)
