"""What do the networks see of a batch, and where and how did the hands act in what they see?"""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from torch import Tensor

from affordance.dataset import Batch, Hands
from affordance.frames import Frame, cloud_of, frame_of, heading_of, moved_cloud, rotation_of, turned
from affordance.networks import KINDS, Model
from affordance.outlook import Look
from affordance.pointnet2 import Encoded, Indices, gathered
from affordance.settings import SCALE


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What is seen of a batch.

    Attributes:
        frame, frame_after: Network coordinates before and after the preparation.
        before, after: The object where it lay, and where it is expected, with the assistant's hand.
        moved: ``(B, 128)`` features to the actors of the object where it should be, in the coordinates of ``before``.
        move: ``(B, 9)`` that motion.
        place: ``(B, 5)``.
    """

    frame: Frame
    frame_after: Frame
    before: Look
    after: Look
    moved: Tensor
    move: Tensor
    place: Tensor


@dataclass(frozen=True, slots=True, eq=False)
class Done:
    """One hand's action in the coordinates of a view.

    Attributes:
        index: ``(B,)`` a point where it acted.
        contact: ``(B, 3)`` where that point is.
        R: ``(B, 3, 3)`` how the hand was turned, one of its two equal ways.
        reach: ``(B, 3)`` from the point to between the tips, in the frame of the hand.
        truth: The action, its vectors in the frame of the hand.
    """

    index: Tensor
    contact: Tensor
    R: Tensor
    reach: Tensor
    truth: Hands


def seen(model: Model, batch: Batch) -> Scene:
    """Encode a batch: before and after the preparation, and the object alone where it should be."""
    all_object = torch.zeros_like(batch.roles)
    frame = frame_of(batch.points, all_object, heading_of(batch.points, all_object) + batch.yaw)
    frame_after = frame_of(batch.after, batch.roles, heading_of(batch.after, batch.roles) + batch.yaw)
    cloud = cloud_of(frame, batch.points, all_object)
    cloud_after = cloud_of(frame_after, batch.after, batch.roles)
    move = frame.moves(batch.T_move, frame.centre)
    both = _stacked(batch.indices, batch.indices_after)
    actors = model.encoder(torch.cat([cloud, cloud_after, moved_cloud(cloud, move)]), _stacked(both, batch.indices))
    before, after, moved = _split(actors, 3)
    if model.critics.encoder is None:
        judges = [before, after]
    else:
        judges = _split(model.critics.encoder(torch.cat([cloud, cloud_after]), both), 2)
    looks = [
        Look(which, as_actor, as_critic, batch.text, _edges(at, batch))
        for which, as_actor, as_critic, at in (
            (cloud, before, judges[0], frame),
            (cloud_after, after, judges[1], frame_after),
        )
    ]
    place = torch.where(batch.has_place[:, None], frame.places(batch.place[:, 0], batch.place[:, 1]), 0.0)
    return Scene(frame, frame_after, looks[0], looks[1], moved.whole, move, place)


def _edges(frame: Frame, batch: Batch) -> Tensor:
    return torch.where(batch.has_edge[:, None], frame.edges(batch.edge[:, 0], batch.edge[:, 1]), 0.0)


def _stacked(first: Indices, second: Indices) -> Indices:
    return Indices(
        *(
            tuple(torch.cat(pair) for pair in zip(getattr(first, f.name), getattr(second, f.name), strict=True))
            for f in fields(Indices)
        )
    )


def _split(encoded: Encoded, parts: int) -> list[Encoded]:
    return [Encoded(*pair) for pair in zip(encoded.points.chunk(parts), encoded.whole.chunk(parts), strict=True)]


def done_in(scene: Scene, batch: Batch, generator: torch.Generator) -> tuple[Done, Done, Done]:
    """The goal action before and after, and the assistant's: at one of its points and in one of the hand's two ways.

    Both goal actions are at the same point, so that one row teaches the same thing twice.
    """
    visible = batch.roles == 0
    at_goal, at_pre = _one_of(batch.goal.spots & visible, generator), _one_of(batch.pre.spots, generator)
    coin = torch.rand(len(batch.yaw), generator=generator, device=batch.yaw.device) < 0.5
    goal, pre = _turned_over(batch.goal, coin), _turned_over(batch.pre, coin)
    R_move, t_move = batch.T_move[:, :3, :3], batch.T_move[:, :3, 3]
    moved = Hands(
        **{f.name: getattr(goal, f.name) for f in fields(Hands)}
        | {
            "R": R_move @ goal.R,
            "tip": turned(R_move, goal.tip) + t_move,
            "tool": turned(R_move, goal.tool) + t_move,
        }
    )
    return (
        _placed(scene.frame, batch.points, at_goal, goal),
        _placed(scene.frame_after, batch.after, at_goal, moved),
        _placed(scene.frame, batch.points, at_pre, pre),
    )


def _one_of(mask: Tensor, generator: torch.Generator) -> Tensor:
    """``(B,)`` a true entry of each row of ``(B, N)``; any where there is none."""
    draws = torch.rand(mask.shape, generator=generator, device=mask.device)
    return torch.where(mask, draws + 1.0, draws).argmax(dim=1)


def _turned_over(hands: Hands, coin: Tensor) -> Hands:
    """Rows of the coin with the hand turned by half a turn about its approach: the same to two equal fingers."""
    sign = 1.0 - 2.0 * coin.to(hands.R.dtype)
    flip = torch.stack([sign, sign, torch.ones_like(sign)], dim=-1)
    local = {name: getattr(hands, name) * flip for name in ("outward", "point")}
    is_goal = hands.outward.any(dim=-1, keepdim=True)  # an assistant's direction is in the world frame
    direction = torch.where(is_goal, hands.direction * flip, hands.direction)
    return Hands(
        **{f.name: getattr(hands, f.name) for f in fields(Hands)}
        | {"R": hands.R * flip[:, None, :], "direction": direction, **local}
    )


def _placed(frame: Frame, points: Tensor, index: Tensor, hands: Hands) -> Done:
    contact = gathered(points, index)
    reach = turned(hands.R.mT, hands.tip - contact) / SCALE
    R = rotation_of(frame.codes(hands.R))
    return Done(index, frame.points(contact[:, None])[:, 0], R, reach, hands)


def spins(hands: Hands) -> Tensor:
    """``(B,)`` booleans: whether a turn about the approach means nothing, as the hand presses with its tips."""
    return hands.kind == KINDS.index("press")
