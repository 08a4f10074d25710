"""How do instruction, table edge, place, contact and orientation enter the networks? Each through one linear map."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from affordance.frames import CODE, EDGE, PLACE
from affordance.heads import joined
from affordance.pointnet2 import POINT, WHOLE
from affordance.text import TEXT

TOKEN = 32
"""Features of each of them; the width of DualAfford's and BiAssembly's."""

SCENE = 2 * TOKEN
"""Features of instruction and table edge."""

ACTION = POINT + 2 * TOKEN
"""Features of an action: its point, where that is and how the hand is turned there."""


class Tokens(nn.Module):
    """The linear maps, and what stands in for that which is not known."""

    def __init__(self) -> None:
        super().__init__()
        self.text, self.edge = nn.Linear(TEXT, TOKEN), nn.Linear(EDGE, TOKEN)
        self.place = nn.Linear(PLACE, TOKEN)
        self.contact, self.direction = nn.Linear(3, TOKEN), nn.Linear(CODE, TOKEN)
        self.no_action = nn.Parameter(torch.zeros(ACTION))
        self.no_cloud = nn.Parameter(torch.zeros(WHOLE))

    def scene(self, text: Tensor, edge: Tensor) -> Tensor:
        """``(B, 64)`` of embedded instructions ``(B, 512)`` and table edges ``(B, 4)``."""
        return joined(self.text(text), self.edge(edge))

    def action(self, point: Tensor, contact: Tensor, code: Tensor) -> Tensor:
        """``(..., 192)`` of features ``(..., 128)``, position ``(..., 3)`` and orientation code ``(..., 6)``."""
        return joined(point, self.contact(contact), self.direction(code))

    def action_or_none(self, action: Tensor, known: Tensor) -> Tensor:
        """``(B, ..., 192)`` actions, those of rows that are not ``known`` ``(B,)`` replaced by a learned stand-in."""
        return _or(action, self.no_action, known)

    def cloud_or_none(self, whole: Tensor, known: Tensor) -> Tensor:
        """``(B, ..., 128)`` features of clouds, those of rows that are not ``known`` replaced by a learned stand-in."""
        return _or(whole, self.no_cloud, known)


def _or(values: Tensor, stand_in: Tensor, known: Tensor) -> Tensor:
    if known.dtype != torch.bool:
        raise TypeError(f"what is known is said by booleans, not {known.dtype}")
    return torch.where(known.reshape(-1, *[1] * (values.dim() - 1)), values, stand_in)
