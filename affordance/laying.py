"""What does a drawn hand become once it is laid onto what the camera saw? A goal action, a push or a press.

Networks say where a hand is, what it does there and how far; the seen points say where its fingers touch, and some of
what is done follows from that: what is lifted goes up, a lid turns about its seen edge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from affordance.candidates import ContactCandidate, GoalCandidate, OperationKind, SceneView
from affordance.dataset import TURNING
from affordance.fitting import (
    above_table,
    backed_off,
    behind,
    centred,
    deepened,
    farthest_push,
    hinge_of,
    raised,
    touching,
    unevenness,
)
from affordance.networks import STROKE
from affordance.preparing import BEHIND, LEAST_PUSH, LIFT, Edge
from affordance.settings import SCALE
from robots.spatial import Array
from robots.workcell import Gripper

SNAP = np.cos(np.radians(30.0))
"""An operation's direction within this of an axis of the hand is along that axis."""

DEEP, SHALLOW = 0.024, 0.010
"""How far finger tips reach at least past the front of an edge they lift by, and of a part they move [m].

A pushed object may lie a centimetre from where it was expected.
"""

TURN_ON, MOVE_ON = 1.2, 0.004
"""Share by which a part is turned, and length by which it is pressed or pulled, beyond what is drawn [m]. How far it
must move cannot be seen: too little leaves it shut, and too much is stopped by a force or by the end of its joint.
"""

OTHERWISE = 0.5
"""Worth of a lid that is turned about its other side, as a share of what it is worth as the networks say."""

UNEVEN = 0.010
"""Two fingers of which one meets the object so much later [m] are rated down to a third: the object will turn."""


@dataclass(frozen=True, slots=True, eq=False)
class Meant:
    """What networks say is done with a hand.

    Attributes:
        kind: What.
        direction, outward: As in ``GoalCandidate``, in the frame of the hand.
        point: As in ``GoalCandidate``, in the frame of the hand from between its tips, in units of ``SCALE``.
        amount: In units of ``STROKE``, or radians.
    """

    kind: OperationKind
    direction: Array
    outward: Array
    point: Array
    amount: float


def goal_on(view: SceneView, T_world_hand: pin.SE3, opening: float, meant: Meant, score: float) -> GoalCandidate | None:
    """The goal action of a drawn hand; ``None`` where its open fingers meet what was seen, however far back.

    Args:
        view: What was seen.
        T_world_hand: The hand as it was drawn.
        opening: Of one of its fingers [m].
        meant: What it does.
        score: Its worth.
    """
    gripper = view.workcell.arm("left").gripper
    laid = _laid(view, T_world_hand, opening, meant.kind, gripper)
    if laid is None:
        return None
    T, opening = laid
    tips = np.array([0.0, 0.0, gripper.tip_offset])
    amount = TURN_ON * meant.amount if meant.kind in TURNING else STROKE * meant.amount + MOVE_ON
    match meant.kind:
        case "grasp":
            direction, amount = np.array([0.0, 0.0, 1.0]), LIFT
            point = T.act(np.array([0.0, 0.0, gripper.tcp_offset]))
        case "flip":
            axis, hinge = hinge_of(T, opening, meant.point[0] - meant.direction[1], view.cloud, gripper)
            direction, point = T.rotation @ axis, T.act(hinge)
        case kind:
            direction = T.rotation @ _snapped(meant.direction)
            point = T.act(tips if kind == "unscrew" else tips + SCALE * meant.point)
    return GoalCandidate(meant.kind, T, opening, direction, point, amount, T.rotation @ _snapped(meant.outward), score)


def hinged_otherwise(view: SceneView, goal: GoalCandidate) -> GoalCandidate:
    """The same lid with its hinge at the other side: which it is, a few seen points of it must tell."""
    T, gripper = goal.T_world_hand, view.workcell.arm("left").gripper
    side = -float((T.rotation.T @ (goal.point - T.translation))[0])
    axis, hinge = hinge_of(T, goal.opening, side, view.cloud, gripper)
    return replace(goal, direction=T.rotation @ axis, point=T.act(hinge), score=OTHERWISE * goal.score)


def push_on(
    view: SceneView,
    edge: Edge,
    T_world_hand: pin.SE3,
    opening: float,
    heading: Array,
    length: float,
    score: float,
    *,
    from_behind: bool,
) -> ContactCandidate | None:
    """The push of a drawn hand; ``None`` where there is no way to go before the object would fall.

    Args:
        view: What was seen.
        edge: Of the table, over which the object is pushed.
        T_world_hand: The hand as it was drawn.
        opening: Of one of its fingers [m].
        heading: ``(3,)`` horizontal unit vector along which it pushes, in the world frame.
        length: How far [m]; it is less where the object would fall.
        score: Its worth; less where one finger meets the object long before the other.
        from_behind: Whether fingers push from behind the object, not from above.
    """
    length = min(length, farthest_push(heading, view.cloud, edge))
    if length < LEAST_PUSH:
        return None
    gripper, start = view.workcell.arm("left").gripper, None
    if from_behind:
        T = behind(T_world_hand, opening, heading, view.cloud, gripper)
        start, T = -BEHIND * heading, above_table(T, view.workcell.table.top, gripper)
        score *= float(np.exp(-unevenness(T, opening, heading, view.cloud, gripper) / UNEVEN))
    else:
        T = touching(T_world_hand, opening, view.cloud, gripper)
    travel = length * heading
    return ContactCandidate(T, opening, travel, pin.SE3(np.eye(3), travel), score, start)


def press_on(view: SceneView, T_world_hand: pin.SE3, opening: float, depth: float, score: float) -> ContactCandidate:
    """The press of a drawn hand by a depth [m], with the motion of its tips; how the object tilts is not told here."""
    T = touching(T_world_hand, opening, view.cloud, view.workcell.arm("left").gripper)
    travel = np.array([0.0, 0.0, -depth])
    return ContactCandidate(T, opening, travel, pin.SE3(np.eye(3), travel), score)


def _laid(
    view: SceneView, T_world_hand: pin.SE3, opening: float, kind: OperationKind, gripper: Gripper
) -> tuple[pin.SE3, float] | None:
    """Hand and opening where the fingers touch, or have the part between them."""
    if kind == "press":
        return touching(T_world_hand, 0.0, view.cloud, gripper), 0.0
    T, opening = centred(T_world_hand, opening, view.cloud, gripper)
    T = deepened(T, opening, view.cloud, gripper, DEEP if kind == "grasp" else SHALLOW)
    if kind == "grasp":
        T = raised(T, view.workcell.table, gripper)
    free = backed_off(T, opening, view.cloud, gripper)
    return None if free is None else (free, opening)


def _snapped(vector: Array) -> Array:
    """A direction in the frame of the hand, along the nearest axis of the hand where it is about along it."""
    k = int(np.abs(vector).argmax())
    if abs(vector[k]) < SNAP:
        return vector
    return np.asarray(np.sign(vector[k]) * np.eye(3)[k])
