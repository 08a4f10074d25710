"""Which actions are wrong on purpose? Critics learn from them beside what was done, and are tested with them."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from affordance.frames import canonical, code_of
from affordance.heads import drawn
from affordance.networks import Contact, Model
from affordance.outlook import Look
from affordance.pointnet2 import gathered
from affordance.tokens import Tokens
from affordance.views import Done

ELSEWHERE = 0.16
"""A wrong point is at least this far from the right one, in units of ``affordance.settings.SCALE``: 4 cm."""

OTHERS = 32
"""Wrong points of each row: with four, critics hardly told the ends of a pen apart."""

TURNED = (0.9, np.pi)
"""A hand turned away on purpose is turned by this much [rad]."""


def judged_token(tokens: Tokens, view: Look, index: Tensor, R: Tensor) -> Tensor:
    """What critics are told of hands turned by ``(B, 3, 3)`` at the points ``(B,)``."""
    contact = gathered(view.cloud[..., :3], index)
    return tokens.action(view.judged.at(index), contact, code_of(R))


def turned_away(R: Tensor, generator: torch.Generator) -> Tensor:
    """Rotations ``(B, 3, 3)`` turned about random axes across the approach, so that the flip does not undo it."""
    count, device = len(R), R.device
    around = 2.0 * np.pi * torch.rand(count, generator=generator, device=device)
    axis = torch.cos(around)[:, None] * R[:, :, 0] + torch.sin(around)[:, None] * R[:, :, 1]
    angle = TURNED[0] + (TURNED[1] - TURNED[0]) * torch.rand(count, generator=generator, device=device)
    return _about(axis, angle) @ R


def _about(axis: Tensor, angle: Tensor) -> Tensor:
    """Rotations ``(B, 3, 3)`` about unit vectors ``(B, 3)`` by ``(B,)`` [rad] (Rodrigues' formula)."""
    zero = torch.zeros_like(angle)
    x, y, z = axis.unbind(-1)
    K = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).reshape(-1, 3, 3)
    s, c = torch.sin(angle)[:, None, None], torch.cos(angle)[:, None, None]
    return torch.eye(3, device=axis.device) + s * K + (1.0 - c) * (K @ K)


def drawn_elsewhere(
    model: Model, net: Contact, view: Look, act: Done, given: Tensor, generator: torch.Generator
) -> Tensor:
    """Tokens ``(B, OTHERS, 192)`` to the critics of what an actor would do at points where the hand did not act."""
    with torch.no_grad():
        index = _elsewhere(view, act, generator)
        contact = gathered(view.cloud[..., :3], index)
        condition = net.condition(view.seen.at(index), model.tokens.contact(contact), given)
        codes = canonical(drawn(net.orientation, condition, 1, generator)[..., 0, :])
    return model.critics.tokens.action(view.judged.at(index), contact, codes)


def _elsewhere(view: Look, act: Done, generator: torch.Generator) -> Tensor:
    """``(B, OTHERS)`` points of the object away from where the hand acted; the farthest ones where all are near."""
    away = torch.linalg.vector_norm(view.cloud[..., :3] - act.contact[:, None], dim=-1)
    is_object = view.cloud[..., 3] > 0.5
    draws = torch.rand(away.shape, generator=generator, device=away.device)
    order = torch.where(is_object & (away > ELSEWHERE), draws + 10.0, torch.where(is_object, away, -1.0))
    return order.topk(OTHERS, dim=1).indices
