"""In which coordinates the networks see and answer: where is zero, how long is one, how is a rotation written down?

A cloud is centred at the mean of the object's points, turned about the vertical by a yaw that only training draws, and
divided by ``SCALE``, so that size stays visible. A rotation is written as six numbers, the columns ``approach`` (z of
the hand) and ``opening`` (y of the hand) one after the other, never interleaved; the third column follows from them.
The paper's forward, left and up axes of a gripper are z, y and -x of this hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from affordance.settings import SCALE

ROLES = ("object", "gripper", "support")
"""What a point can belong to, in the order of its one-hot channels."""

CHANNELS = 3 + len(ROLES)
"""Numbers of a point as a network sees it: position, then role."""

CODE = 6
"""Numbers of a rotation."""

MOVE = CODE + 3
"""Numbers of a rigid motion: rotation, then shift of the pivot."""

EDGE = 4
"""Numbers of a table edge; all are zero where the task has none."""

PLACE = 5
"""Numbers of where an object is to be held: all are zero where the task does not lift it for the other hand."""

IDENTITY = (0.0, 0.0, 1.0, 0.0, 1.0, 0.0)
"""The code of no rotation."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Network coordinates of a batch of views: ``x' = Rz(yaw) (x - centre) / SCALE``.

    Attributes:
        centre: ``(B, 3)`` in the world frame [m].
        yaw: ``(B,)`` [rad].
    """

    centre: Tensor
    yaw: Tensor

    def points(self, points: Tensor) -> Tensor:
        """World points ``(B, ..., 3)`` [m] in network coordinates."""
        return turned(self._turn(), points - _spread(self.centre, points.dim() - 1)) / SCALE

    def points_world(self, points: Tensor) -> Tensor:
        """Points ``(B, ..., 3)`` of network coordinates in the world frame [m]."""
        return turned(self._turn().mT, points) * SCALE + _spread(self.centre, points.dim() - 1)

    def directions(self, directions: Tensor) -> Tensor:
        """World directions ``(B, ..., 3)``, turned."""
        return turned(self._turn(), directions)

    def directions_world(self, directions: Tensor) -> Tensor:
        """Directions ``(B, ..., 3)`` of network coordinates in the world frame."""
        return turned(self._turn().mT, directions)

    def codes(self, R_world_hand: Tensor) -> Tensor:
        """Codes ``(B, ..., 6)`` of the rotations ``(B, ..., 3, 3)``."""
        return code_of(_spread(self._turn(), R_world_hand.dim() - 2) @ R_world_hand)

    def rotations_world(self, codes: Tensor) -> Tensor:
        """``R_world_hand`` ``(B, ..., 3, 3)`` of codes ``(B, ..., 6)``."""
        rotations = rotation_of(codes)
        return _spread(self._turn().mT, rotations.dim() - 2) @ rotations

    def moves(self, T_move: Tensor, pivot: Tensor) -> Tensor:
        """A rigid motion in the world frame as the networks write it.

        Args:
            T_move: ``(B, 4, 4)``.
            pivot: ``(B, 3)`` point whose shift is written: the centre for an object, the point between the pads for a
                hand [m].

        Returns:
            ``(B, 9)``: rotation code, then shift of the pivot in units of ``SCALE``.
        """
        turn, R = self._turn(), T_move[:, :3, :3]
        shift = turned(R, pivot) + T_move[:, :3, 3] - pivot
        return torch.cat([code_of(turn @ R @ turn.mT), turned(turn, shift) / SCALE], dim=-1)

    def moves_world(self, moves: Tensor, pivot: Tensor) -> Tensor:
        """``T_move`` ``(B, ..., 4, 4)`` in the world of motions ``(B, ..., 9)`` about ``pivot`` ``(B, 3)`` [m]."""
        rotations = rotation_of(moves[..., :CODE])
        turn = _spread(self._turn(), rotations.dim() - 2)
        R = turn.mT @ rotations @ turn
        pivot = _spread(pivot, moves.dim() - 1)
        shift = turned(self._turn().mT, moves[..., CODE:]) * SCALE
        return homogeneous(R, pivot + shift - (R @ pivot[..., None])[..., 0])

    def edges(self, on_edge: Tensor, outward: Tensor) -> Tensor:
        """The edge of the table that an object is pushed over, as ``(B, 4)`` numbers.

        Args:
            on_edge: ``(B, 3)`` a point on the edge, in the world frame [m].
            outward: ``(B, 3)`` horizontal unit vectors from the table into free space.

        Returns:
            The first two coordinates of the direction, how far the centre is from the edge (positive on the table)
            and how high it is above the top, both in units of ``SCALE``.
        """
        offset = on_edge - self.centre
        inside = (offset * outward).sum(-1, keepdim=True)
        return torch.cat([self.directions(outward)[:, :2], inside / SCALE, -offset[:, 2:] / SCALE], dim=-1)

    def places(self, middle: Tensor, towards: Tensor) -> Tensor:
        """Where an object is to be held and for whom, as ``(B, 5)`` numbers.

        Args:
            middle: ``(B, 3)`` middle of the space that both arms, or the arm and the human, reach [m].
            towards: ``(B, 3)`` horizontal unit vectors from there to the primary arm's base, or to the human.

        Returns:
            From the centre to that middle in units of ``SCALE``, and the first two coordinates of the direction.
        """
        return torch.cat([self.points(middle[:, None])[:, 0], self.directions(towards)[:, :2]], dim=-1)

    def _turn(self) -> Tensor:
        """``(B, 3, 3)`` rotations about the vertical."""
        c, s = torch.cos(self.yaw), torch.sin(self.yaw)
        zero, one = torch.zeros_like(c), torch.ones_like(c)
        return torch.stack([c, -s, zero, s, c, zero, zero, zero, one], dim=-1).reshape(-1, 3, 3)


def frame_of(points: Tensor, roles: Tensor, yaw: Tensor) -> Frame:
    """The frame of a batch of views, centred at the visible points of the object, never of a gripper.

    Args:
        points: ``(B, N, 3)`` in the world frame [m].
        roles: ``(B, N)`` numbers in ``ROLES``.
        yaw: ``(B,)`` [rad].
    """
    is_object = (roles == ROLES.index("object"))[..., None]
    count = is_object.sum(dim=1)
    if not points.is_cuda and not bool((count > 0).all()):  # a GPU would have to wait for the answer
        raise ValueError("a view without points of the object has no centre")
    return Frame((points * is_object).sum(dim=1) / count, yaw)


def heading_of(points: Tensor, roles: Tensor) -> Tensor:
    """The yaw ``(B,)`` [rad] that lays the object's longest horizontal extent along x, its longer tail towards +x.

    Network coordinates that follow the object spare the networks to learn every turn of it about the vertical. The
    extent is the first principal axis of the object's horizontal coordinates; which of its ends comes first is decided
    by their third moment along it.

    Args:
        points: ``(B, N, 3)`` in the world frame [m].
        roles: ``(B, N)`` numbers in ``ROLES``; only the object counts.
    """
    is_object = (roles == ROLES.index("object"))[..., None].to(points.dtype)
    count = is_object.sum(dim=1, keepdim=True).clamp(min=1.0)
    level = points[..., :2]
    away = (level - (level * is_object).sum(dim=1, keepdim=True) / count) * is_object
    xx, yy = away.square().sum(dim=1).unbind(-1)
    xy = away.prod(dim=-1).sum(dim=1)
    angle = 0.5 * torch.atan2(2.0 * xy, xx - yy)
    along = away[..., 0] * torch.cos(angle)[:, None] + away[..., 1] * torch.sin(angle)[:, None]
    backwards = along.pow(3).sum(dim=1) < 0.0
    return torch.where(backwards, torch.pi - angle, -angle)


def cloud_of(frame: Frame, points: Tensor, roles: Tensor) -> Tensor:
    """What a network sees, ``(B, N, 6)``, of world points ``(B, N, 3)`` [m] with roles ``(B, N)``."""
    return torch.cat([frame.points(points), functional.one_hot(roles, len(ROLES)).to(points.dtype)], dim=-1)


def moved_cloud(cloud: Tensor, moves: Tensor) -> Tensor:
    """A cloud ``(B, N, 6)`` after the rigid motions ``(B, 9)`` about its centre: the paper's ``O' = T_obj O``."""
    R, shift = rotation_of(moves[:, :CODE]), moves[:, CODE:]
    return torch.cat([turned(R, cloud[..., :3]) + shift[:, None], cloud[..., 3:]], dim=-1)


def code_of(R: Tensor) -> Tensor:
    """The codes ``(..., 6)`` of rotations ``(..., 3, 3)``: column z, then column y."""
    return torch.cat([R[..., :, 2], R[..., :, 1]], dim=-1)


def rotation_of(code: Tensor) -> Tensor:
    """The rotations ``(..., 3, 3)`` closest to any six numbers ``(..., 6)``.

    Gram-Schmidt in the order approach, opening (Zhou et al., "On the Continuity of Rotation Representations in Neural
    Networks", CVPR 2019, eq. 15); defined unless the two halves are parallel.
    """
    z = functional.normalize(code[..., :3], dim=-1)
    opening = code[..., 3:CODE]
    y = functional.normalize(opening - (opening * z).sum(-1, keepdim=True) * z, dim=-1)
    return torch.stack([torch.linalg.cross(y, z), y, z], dim=-1)


def canonical(code: Tensor) -> Tensor:
    """The code ``(..., 6)`` of the rotation that six numbers stand for: two perpendicular unit vectors."""
    return code_of(rotation_of(code))


def flipped(R: Tensor) -> Tensor:
    """Hands ``(..., 3, 3)`` after half a turn about their approach: the same to two equal fingers."""
    return torch.cat([-R[..., :2], R[..., 2:]], dim=-1)


def homogeneous(R: Tensor, t: Tensor) -> Tensor:
    """Matrices ``(..., 4, 4)`` of rotations ``(..., 3, 3)`` and translations ``(..., 3)``."""
    top = torch.cat([R, t[..., None]], dim=-1)
    bottom = torch.zeros_like(top[..., :1, :])
    bottom[..., 3] = 1.0
    return torch.cat([top, bottom], dim=-2)


def carried(T_world_link_then: Tensor, T_world_link_now: Tensor, T_world_hand_then: Tensor) -> Tensor:
    """Where a hand that acted on a link ``then`` acts on the same link ``now``, ``(..., 4, 4)``.

    With ``then`` after the preparation and ``now`` before it this is the paper's label of the anticipatory stage, whose
    rotation is ``R_now R_then^T R_hand``; the same map ``T_now T_then^-1`` carries points.
    """
    R, t = T_world_link_then[..., :3, :3], T_world_link_then[..., :3, 3:]
    inverse = homogeneous(R.mT, -(R.mT @ t)[..., 0])
    return T_world_link_now @ inverse @ T_world_hand_then


def turned(R: Tensor, vectors: Tensor) -> Tensor:
    """Vectors ``(B, ..., 3)`` turned by one rotation ``(B, 3, 3)`` each row."""
    return (_spread(R, vectors.dim() - 1) @ vectors[..., None])[..., 0]


def _spread(rows: Tensor, leading: int) -> Tensor:
    """``(B, ...)`` with ones after the first dimension, so that it has ``leading`` dimensions before its entries."""
    return rows.reshape(rows.shape[0], *[1] * (leading - 1), *rows.shape[1:])
