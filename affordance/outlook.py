"""How well could an action at a point go? Draw many there, let the critic judge, take the mean of the best.

That is the label of an affordance map, and the value of a preparation: the outlook it makes for the goal action.
Whoever trains asks a running mean of the weights, not the weights that learn from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from affordance.frames import canonical
from affordance.heads import drawn, joined
from affordance.losses import affordance_target
from affordance.networks import Model
from affordance.pointnet2 import Encoded, Indices, gathered, indices_of


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Clouds with an instruction, as actors and critics see them.

    Attributes:
        cloud: ``(B, N, 6)``.
        seen: Features to the actors.
        judged: Features to the critics.
        text: ``(B, 512)`` embedded instructions.
        edge: ``(B, 4)`` table edges.
    """

    cloud: Tensor
    seen: Encoded
    judged: Encoded
    text: Tensor
    edge: Tensor


def look(model: Model, cloud: Tensor, text: Tensor, edge: Tensor, indices: Indices | None = None) -> Look:
    """Encode clouds ``(B, N, 6)`` for actors and critics, who see the same neighbourhoods."""
    known = indices_of(cloud[..., :3].contiguous(), model.settings.profile) if indices is None else indices
    seen: Encoded = model.encoder(cloud, known)
    return Look(cloud, seen, model.seen_by_critics(cloud, seen, known), text, edge)


def goal_outlook(model: Model, view: Look, index: Tensor, generator: torch.Generator) -> Tensor:
    """Outlook ``(B, K)`` in ``[0, 1]`` of the primary acting at the points numbered ``(B, K)``."""
    critics, losses = model.critics, model.settings.losses
    with torch.no_grad():
        contact = gathered(view.cloud[..., :3], index)
        scene = model.tokens.scene(view.text, view.edge)
        condition = model.goal.condition(view.seen.at(index), model.tokens.contact(contact), scene)
        codes = canonical(drawn(model.goal.orientation, condition, losses.draws, generator))
        action = critics.tokens.action(view.judged.at(index), contact, codes)
        return affordance_target(critics.goal(action, critics.tokens.scene(view.text, view.edge)), losses)


def pre_outlook(
    model: Model, view: Look, index: Tensor, goal_index: Tensor, goal_code: Tensor, generator: torch.Generator
) -> Tensor:
    """Outlook ``(B, K)`` in ``[0, 1]`` of the assistant acting at the points numbered ``(B, K)``.

    Args:
        model: Who draws and who judges.
        view: What is seen.
        index: The points.
        goal_index: ``(B,)`` the point where the primary will act.
        goal_code: ``(B, 6)`` how its hand will be turned, in network coordinates.
        generator: Decides the draws.
    """
    critics, losses = model.critics, model.settings.losses
    with torch.no_grad():
        contact, goal_contact = (gathered(view.cloud[..., :3], which) for which in (index, goal_index))
        goal = model.goal_shown(model.tokens.action(view.seen.at(goal_index), goal_contact, goal_code))
        given = joined(model.tokens.scene(view.text, view.edge), goal)
        condition = model.pre.condition(view.seen.at(index), model.tokens.contact(contact), given)
        codes = canonical(drawn(model.pre.orientation, condition, losses.draws, generator))
        action = critics.tokens.action(view.judged.at(index), contact, codes)
        aim = critics.tokens.action(view.judged.at(goal_index), goal_contact, goal_code)
        return affordance_target(critics.pre(action, critics.tokens.scene(view.text, view.edge), aim), losses)
