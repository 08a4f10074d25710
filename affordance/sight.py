"""What do the networks see of a view, and what are they told of hands in it?"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
import torch
from torch import Tensor

from affordance.candidates import SceneView
from affordance.dataset import HAND, spots_of, thinned
from affordance.frames import ROLES, Frame, cloud_of, frame_of, heading_of
from affordance.networks import Model
from affordance.outlook import Look, look
from affordance.pointnet2 import gathered
from affordance.stations import surroundings
from robots.spatial import Array
from robots.workcell import Side
from worlds.tasks import TaskType

REMEMBERED = 6
"""Views of which an eye remembers what was seen."""


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """A view as the networks see it.

    Attributes:
        view: The view.
        points: ``(N, 3)`` what is left of its cloud, in the world frame [m]; the hand's last, where there is one.
        look: What actors and critics see of them.
        frame: Network coordinates.
        scene: ``(1, 64)`` token of instruction and edge to the actors; ``scene_judged`` to the critics.
        is_object: ``(N,)`` booleans.
    """

    view: SceneView
    points: Array
    look: Look
    frame: Frame
    scene: Tensor
    scene_judged: Tensor
    is_object: Tensor

    def spot(self, T_world_hand: pin.SE3, opening: float) -> Tensor:
        """``(1,)`` the point at which a hand acts: of those between its pads the nearest to its tips."""
        T = T_world_hand.homogeneous
        tip_offset = self.view.workcell.arm("left").gripper.tip_offset
        mine = spots_of(self.points, T, opening, tip_offset) & self.is_object.numpy()
        tip = T[:3, 3] + tip_offset * T[:3, 2]
        away = np.linalg.norm(self.points - tip, axis=1)
        return torch.tensor([int(np.where(mine, away, away + 1e3).argmin())])

    def code(self, T_world_hand: pin.SE3) -> Tensor:
        """``(1, 6)`` how a hand is turned, in network coordinates."""
        return self.frame.codes(torch.from_numpy(T_world_hand.rotation.astype(np.float32))[None])

    def contact(self, index: Tensor) -> Tensor:
        """Where the points numbered ``(1, ...)`` are ``(1, ..., 3)``, in network coordinates."""
        return gathered(self.look.cloud[..., :3], index)


@dataclass
class Eye:
    """Views and actions as tokens of the networks.

    Attributes:
        model: The networks.
        text: ``(1, 512)`` the embedded instruction.
        task: Type of the task.
    """

    model: Model
    text: Tensor
    task: TaskType
    _sights: list[Sight] = field(default_factory=list)

    def sight(self, view: SceneView) -> Sight:
        """What the networks see of a view; the latest few are remembered."""
        for known in self._sights:
            if known.view.cloud is view.cloud and known.view.hand is view.hand:
                return known
        sight = self._looked(view)
        self._sights = [sight, *self._sights[: REMEMBERED - 1]]
        return sight

    def _looked(self, view: SceneView) -> Sight:
        count = self.model.settings.profile.points
        points = thinned(view.cloud, count, np.random.default_rng(0))
        roles = np.zeros(count, dtype=np.int64)
        if len(view.hand):
            points[-HAND:], roles[-HAND:] = view.hand, ROLES.index("gripper")
        world, role = torch.from_numpy(points)[None], torch.from_numpy(roles)[None]
        frame = frame_of(world, role, heading_of(world, role))
        near = surroundings(view.workcell, self.task, None).edge
        edge = torch.zeros(1, 4)
        if near is not None:
            on_edge, outward = torch.from_numpy(near.astype(np.float32))[:, None]
            edge = frame.edges(on_edge, outward)
        seen = look(self.model, cloud_of(frame, world, role), self.text, edge)
        tokens, critics = self.model.tokens, self.model.critics
        scene, judged = tokens.scene(self.text, edge), critics.tokens.scene(self.text, edge)
        return Sight(view, points.astype(float), seen, frame, scene, judged, role[0] == 0)

    def token(self, sight: Sight, index: Tensor, code: Tensor) -> Tensor:
        """Token to the actors of a hand at a point ``(1,)``, turned as ``(1, 6)`` says."""
        return self.model.tokens.action(sight.look.seen.at(index), sight.contact(index), code)

    def judged_token(self, sight: Sight, index: Tensor, code: Tensor) -> Tensor:
        """Token to the critics of ``(1, K)`` points with ``(1, K, D, 6)`` codes, or of ``(1,)`` with ``(1, 6)``."""
        features, contact = sight.look.judged.at(index), sight.contact(index)
        if code.dim() > features.dim():
            features, contact = (
                part[..., None, :].expand(*code.shape[:-1], part.shape[-1]) for part in (features, contact)
            )
        return self.model.critics.tokens.action(features, contact, code)

    def place(self, sight: Sight, primary: Side | None) -> Tensor:
        """``(1, 5)`` where an object is brought to."""
        place = surroundings(sight.view.workcell, self.task, primary).place
        if place is None:
            return torch.zeros(1, 5)
        middle, towards = torch.from_numpy(place.astype(np.float32))[:, None]
        return sight.frame.places(middle, towards)
