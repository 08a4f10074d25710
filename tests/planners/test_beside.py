"""Laws of one arm that moves beside the other: free at every instant on one clock, never later than after it."""

from __future__ import annotations

import numpy as np
import pytest

from planners import motion
from planners.beside import plan_beside
from planners.certify import Certificate, Uncertified, certify_beside
from planners.clock import Beside, Clock
from planners.collision import CollisionWorld
from planners.motion import GoalInCollision, JointPath, NoPath, OutOfLimits, StartInCollision
from planners.reasons import OtherInTheWay
from planners.timing import retime
from robots.model import DualArm
from robots.spatial import Array
from robots.trajectory import Trajectory
from robots.workcell import Workcell

AHEAD = np.array([0.0, 0.6, 0.0, -1.6, 0.0, 2.2, 0.785])
"""A left hand over the middle of the table [rad]."""


@pytest.fixture(scope="module")
def world(workcell: Workcell) -> CollisionWorld:
    return CollisionWorld(workcell)


def toward(arms: DualArm, q: Array, sign: float) -> Array:
    """A posture turned about the base towards the other arm [rad]."""
    turned = q.copy()
    turned[0] = sign
    return turned


def curve(workcell: Workcell, side: str, *points: Array, speed: float = 0.5) -> Trajectory:
    found = retime(JointPath(np.array(points)), workcell.arm(side), speed=speed)  # type: ignore[arg-type]
    assert isinstance(found, Trajectory)
    return found
