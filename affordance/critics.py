"""How likely does an action succeed, and would the planner accept it? Judges of what the actors draw.

Critics have an encoder and maps of their own, so that no loss of theirs reaches the actors, unless a preset shares one.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from affordance.frames import MOVE
from affordance.heads import joined, mlp
from affordance.pointnet2 import POINT, WHOLE, Encoder
from affordance.settings import Settings
from affordance.stations import STAGES
from affordance.tokens import ACTION, SCENE, TOKEN, Tokens

POSE = 64
"""Features of an object's motion."""

CHECKS = ("ik", "collision", "plan")
"""What the planner checks, in the order of the feasibility critic's answers; ``plan`` is everything after collision."""

PROBES = 8
"""Points of the gripper at which the distance to the nearest obstacle is told."""

MEMBERS = 3
"""Networks that judge feasibility; their spread says how sure they are."""

STATION = MOVE + len(STAGES) + PROBES
"""What is told of a candidate besides the look of its point."""


class Critics(nn.Module):
    """Every judge.

    Attributes:
        encoder: Through which they see; ``None`` where the preset shares the actors' encoder.
        tokens: Their own maps of instruction, contact and orientation.
        pose: ``None`` where the preset leaves it out.
    """

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        self.encoder = Encoder(settings.profile) if settings.losses.own_critic_encoder else None
        self.tokens = Tokens()
        self.goal, self.pre = GoalCritic(), PreCritic()
        self.pose = PoseCritic() if settings.losses.pose_critic else None
        self.feasibility = FeasibilityCritic()


class GoalCritic(nn.Module):
    """Whether the primary's action succeeds."""

    def __init__(self) -> None:
        super().__init__()
        self.judge = mlp(ACTION + SCENE, 1)

    def forward(self, action: Tensor, scene: Tensor) -> Tensor:
        """Logits ``(...)`` of actions ``(..., 192)`` in scenes ``(B, 64)``."""
        return _one(self.judge(joined(action, scene)))


class PreCritic(nn.Module):
    """Whether the assistant's action makes the primary's succeed."""

    def __init__(self) -> None:
        super().__init__()
        self.judge = mlp(2 * ACTION + SCENE, 1)

    def forward(self, action: Tensor, scene: Tensor, goal: Tensor) -> Tensor:
        """Logits ``(...)`` of the assistant's actions ``(..., 192)`` for goal actions ``(B, ..., 192)``."""
        return _one(self.judge(joined(action, scene, goal)))


class PoseCritic(nn.Module):
    """Whether an object's motion makes both actions succeed."""

    def __init__(self) -> None:
        super().__init__()
        self.move = nn.Linear(MOVE, POSE)
        self.judge = mlp(WHOLE + POSE + 2 * ACTION + 2 * TOKEN, 1)

    def forward(self, whole: Tensor, move: Tensor, text: Tensor, place: Tensor, goal: Tensor, pre: Tensor) -> Tensor:
        """Logits ``(...)`` of motions ``(..., 9)`` for cloud ``(B, 128)``, tokens ``(B, 32)`` and both actions."""
        return _one(self.judge(joined(whole, self.move(move), goal, pre, text, place)))


class FeasibilityCritic(nn.Module):
    """Whether the planner accepts a candidate: a few networks that were started differently."""

    def __init__(self) -> None:
        super().__init__()
        self.members = nn.ModuleList(mlp(STATION + POINT, len(CHECKS)) for _ in range(MEMBERS))

    def forward(self, station: Tensor, point: Tensor) -> Tensor:
        """Logits ``(..., members, checks)``.

        Args:
            station: ``(..., 25)``: the hand's pose in the frame of the arm's base as code and position in units of
                ``SCALE``, the stage one-hot, the distances at the gripper's probes in units of ``SCALE``.
            point: ``(..., 128)`` features of the contact.
        """
        seen = joined(station, point)
        return torch.stack([member(seen) for member in self.members], dim=-2)


def feasible(logits: Tensor) -> tuple[Tensor, Tensor]:
    """Probability that every check passes ``(...)``, and its standard deviation over the members of ``(..., M, C)``."""
    each = torch.sigmoid(logits).prod(dim=-1)
    return each.mean(dim=-1), each.std(dim=-1)


def _one(logits: Tensor) -> Tensor:
    return logits.squeeze(-1)
