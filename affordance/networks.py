"""Where would each arm act, how, and where must the object be for it? The paper's four networks over one encoder.

Goal Affordance looks at the object before and after the preparation with the same weights; Pre-Affordance, the Object
Pose Predictor and the Reorient Actor follow from what it says. Widths in comments are those of the default settings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import torch
from torch import Tensor, nn

from affordance.candidates import OperationKind
from affordance.critics import Critics
from affordance.flow import Flow
from affordance.frames import CODE, IDENTITY
from affordance.heads import CVAE, joined, mlp
from affordance.pointnet2 import POINT, WHOLE, Encoded, Encoder, Indices
from affordance.settings import Settings
from affordance.tokens import ACTION, SCENE, TOKEN, Tokens

WIDEST = 0.04
"""Largest opening of one finger [m]: the Franka hand's."""

KINDS: tuple[OperationKind, ...] = get_args(OperationKind)
"""What can be done at the goal, in the order of the network's answers."""

STROKE = 0.05
"""Length that is one where a motion of the primary is told [m]; turns are told in radians."""

ANY_ORIENTATION = (0.0,) * CODE
"""Orientations at a contact are drawn around no one in particular."""

NO_MOVE = (*IDENTITY, 0.0, 0.0, 0.0)
"""Motions are drawn around staying where one is."""


@dataclass(frozen=True, slots=True, eq=False)
class Operation:
    """What is done at a contact; vectors are in the frame of the hand, whichever way it is turned.

    A network says it for each of the six ``KINDS``, since what it sees may leave open which of them it is: a cap that
    is pulled off can look like one that is unscrewed. ``of`` picks one, and drops the dimension ``K``.

    Attributes:
        kinds: Logits ``(..., 6)`` of ``KINDS``.
        direction: Unit vectors ``(..., K, 3)`` as in ``GoalCandidate``.
        outward: Unit vectors ``(..., K, 3)`` as in ``GoalCandidate``.
        point: ``(..., K, 3)`` as in ``GoalCandidate``, from between the finger tips, in units of ``SCALE``.
        amount: ``(..., K)`` in units of ``STROKE``, or radians.
    """

    kinds: Tensor
    direction: Tensor
    outward: Tensor
    point: Tensor
    amount: Tensor

    def of(self, kind: Tensor) -> Operation:
        """What is done if it is the kind of that number ``(...)``."""

        def picked(values: Tensor) -> Tensor:
            index = kind[..., None, None].expand(*kind.shape, 1, values.shape[-1])
            return values.gather(-2, index).squeeze(-2)

        amount = self.amount.gather(-1, kind[..., None]).squeeze(-1)
        return Operation(self.kinds, picked(self.direction), picked(self.outward), picked(self.point), amount)


class Contact(nn.Module):
    """Where one arm acts, how its hand is turned there, where its tips are and how wide it is open."""

    def __init__(self, settings: Settings, given: int) -> None:
        """Build it for ``given`` features of whatever is known beforehand."""
        super().__init__()
        self.scorer, self.finder = mlp(POINT + given, 1), mlp(POINT + given, 1)
        self.orientation = _head(settings, POINT + TOKEN + given, ANY_ORIENTATION)
        self.spread = mlp(POINT + 2 * TOKEN + given, 1)
        self.offset = mlp(POINT + 2 * TOKEN + given, 3)

    def scores(self, points: Tensor, given: Tensor) -> Tensor:
        """Affordance ``(B, P)`` in ``[0, 1]`` of points ``(B, P, 128)``; ``given`` is ``(B, ...)``."""
        logits: Tensor = self.scorer(joined(points, given))
        return torch.sigmoid(logits.squeeze(-1))

    def places(self, points: Tensor, given: Tensor) -> Tensor:
        """Logits ``(B, P)``, whose softmax over a cloud is the chance of each of its points that a hand acts there."""
        logits: Tensor = self.finder(joined(points, given))
        return logits.squeeze(-1)

    def condition(self, point: Tensor, contact: Tensor, given: Tensor) -> Tensor:
        """Orientations are drawn under this: features ``(..., 128)`` and token ``(..., 32)`` of a point, the given."""
        return joined(point, contact, given)

    def opening(self, condition: Tensor, direction: Tensor) -> Tensor:
        """Opening of one finger ``(...)`` [m] for a condition and the token ``(..., 32)`` of an orientation."""
        out: Tensor = self.spread(joined(condition, direction))
        return WIDEST * torch.sigmoid(out.squeeze(-1))

    def reach(self, condition: Tensor, direction: Tensor) -> Tensor:
        """From the point to between the finger tips ``(..., 3)``, in the frame of the hand and units of ``SCALE``."""
        out: Tensor = self.offset(joined(condition, direction))
        return out


class GoalAffordance(Contact):
    """Where and how the primary acts; ``given`` is the scene (64)."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings, SCENE)
        self.what = mlp(POINT + 2 * TOKEN + SCENE, 11 * len(KINDS))
        self.sorter = mlp(POINT + SCENE, len(KINDS))

    def sorts(self, points: Tensor, given: Tensor) -> Tensor:
        """Logits ``(..., 6)`` of what can be done at points ``(..., 128)`` however a hand is turned there.

        ``operation`` is told the hand's orientation, and where that was drawn for the wrong kind, it agrees with it.
        """
        logits: Tensor = self.sorter(joined(points, given))
        return logits

    def operation(self, condition: Tensor, direction: Tensor) -> Operation:
        """What is done there, for the token ``(..., 32)`` of a hand's orientation."""
        out: Tensor = self.what(joined(condition, direction))
        each = out.reshape(*out.shape[:-1], len(KINDS), 11)
        kinds, way, outward, point, amount = torch.split(each, [1, 3, 3, 3, 1], dim=-1)
        unit = nn.functional.normalize
        return Operation(
            kinds.squeeze(-1),
            unit(way, dim=-1),
            unit(outward, dim=-1),
            point,
            nn.functional.softplus(amount.squeeze(-1)),
        )


class PreAffordance(Contact):
    """Where and how the assistant acts; ``given`` is the scene (64) and the goal action (192)."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings, SCENE + ACTION)
        self.motion = mlp(POINT + 2 * TOKEN + SCENE + ACTION, 4)

    def push(self, condition: Tensor, direction: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """How a hand that pushes or presses moves on.

        Args:
            condition: Of the contact.
            direction: ``(..., 32)`` token of the hand's orientation.

        Returns:
            The horizontal unit vector ``(..., 2)`` along which it pushes, how far ``(...)`` it pushes or presses down
            in units of ``SCALE``, and the logit ``(...)`` of coming from behind instead of from above.
        """
        out: Tensor = self.motion(joined(condition, direction))
        return nn.functional.normalize(out[..., :2], dim=-1), nn.functional.softplus(out[..., 2]), out[..., 3]


class PosePredictor(nn.Module):
    """How the object should move from where it lies, about its centre."""

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        self.move = _head(settings, WHOLE + TOKEN + SCENE + 2 * ACTION, NO_MOVE)

    def condition(self, whole: Tensor, place: Tensor, scene: Tensor, goal: Tensor, pre: Tensor) -> Tensor:
        """What motions are drawn under (608): the cloud's features, the place, the scene and both actions."""
        return joined(whole, place, scene, goal, pre)


class ReorientActor(nn.Module):
    """How the hand that holds the object should move, about the point between its pads."""

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        aim = WHOLE + 2 * TOKEN if settings.object_pose else 2 * ACTION
        self.sees_pose = settings.object_pose
        self.move = _head(settings, WHOLE + TOKEN + aim, NO_MOVE)

    def condition(self, grasped: Tensor, text: Tensor, goal: Tensor, pre: Tensor, moved: Tensor) -> Tensor:
        """What motions are drawn under (352).

        Args:
            grasped: ``(B, 128)`` features of the held object.
            text: ``(B, 32)`` token of the instruction.
            goal: ``(B, ..., 192)`` goal action; read only in the ablation without object pose.
            pre: ``(B, ..., 192)`` action by which the object is held.
            moved: ``(B, ..., 128)`` features of the object where it should be, seen in the coordinates of ``grasped``;
                not read in the ablation without object pose.
        """
        if self.sees_pose:
            return joined(grasped, text, moved, pre[..., POINT:])
        return joined(grasped, text, pre, goal)


class Model(nn.Module):
    """All networks; ``goal`` is one set of weights however often it is asked.

    Attributes:
        settings: What decided their shapes.
        encoder: Through which the four networks see.
        tokens: Their maps of instruction, contact and orientation.
        critics: Who judges them.
    """

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        self.settings = settings
        self.encoder, self.tokens = Encoder(settings.profile), Tokens()
        self.goal, self.pre = GoalAffordance(settings), PreAffordance(settings)
        self.pose, self.reorient = PosePredictor(settings), ReorientActor(settings)
        self.critics = Critics(settings)

    def goal_shown(self, goal: Tensor, known: Tensor | None = None) -> Tensor:
        """The goal actions ``(B, ..., 192)`` as the preparing networks see them.

        Args:
            goal: Action tokens.
            known: ``(B,)`` booleans, false in rows where training hides the goal; ``None`` hides none. The ablation
                without anticipation hides all.
        """
        shown = torch.ones(len(goal), dtype=torch.bool, device=goal.device) if known is None else known
        return self.tokens.action_or_none(goal, shown & self.settings.anticipation)

    def seen_by_critics(self, cloud: Tensor, seen: Encoded, indices: Indices | None = None) -> Encoded:
        """What the critics see of clouds ``(B, N, 6)`` that the actors' encoder saw as ``seen``."""
        if self.critics.encoder is None:
            return seen
        encoded: Encoded = self.critics.encoder(cloud, indices)
        return encoded


def _head(settings: Settings, condition: int, offset: tuple[float, ...]) -> CVAE | Flow:
    if settings.head == "flow":
        return Flow(condition, offset, settings.euler_steps)
    return CVAE(condition, offset, settings.latent)
