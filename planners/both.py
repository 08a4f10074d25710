"""Which collision-free joint path leads both arms, moving at once, from one configuration to another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planners.collision import CollisionWorld
from planners.compiled.cell import Motion
from planners.compiled.layout import FREE
from planners.given import numbers
from planners.motion import (
    INSET,
    RANGE,
    SAMPLES_PER_ITERATION,
    SLACK,
    Exhausted,
    GoalInCollision,
    JointPath,
    NoPath,
    OutOfLimits,
    StartInCollision,
    past_limit,
)
from planners.shorten import SHORTCUTS, rounded
from robots.model import DualArm
from robots.spatial import Array, frozen
from robots.workcell import SIDES, Side


@dataclass(frozen=True, slots=True, eq=False)
class BothPath:
    """Joint positions of both arms, joined by straight lines along which both move at once.

    Attributes:
        points: ``(n, 14)`` [rad], left then right, ``n >= 2``; ``timing.retime_together`` times them.
    """

    points: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points))
        if self.points.ndim != 2 or self.points.shape[0] < 2 or self.points.shape[1] != 14:
            raise ValueError(f"a path of both arms needs points (n, 14), n >= 2; got {self.points.shape}")
        numbers(self.points, (-1, 14), "the points of a path of both arms")

    def of(self, side: Side) -> JointPath:
        """One arm's part of it."""
        return JointPath(self.points[:, 7 * SIDES.index(side) :][:, :7])


def plan_both(
    world: CollisionWorld,
    arms: DualArm,
    start: Array,
    goals: Array,
    *,
    seed: int,
    iterations: int = 8000,
) -> BothPath | NoPath:
    """Find a collision-free joint path of both arms, which move at once; either hand may hold the object.

    Searched, proven and shortened as one arm's path is by ``motion.plan``, in fourteen joints.

    Args:
        world: Collisions, already set up (object, fingers, allowed contacts).
        arms: Both arms.
        start: ``(14,)`` [rad], left then right.
        goals: ``(m, 14)`` [rad], any of which will do.
        seed: Makes the call repeatable.
        iterations: Of RRT-Connect.

    Returns:
        The path, from exactly ``start`` to exactly one of the goals, or why there is none.
    """
    start, goals = numbers(start, (14,), "the start"), numbers(np.atleast_2d(goals), (-1, 14), "the goals")
    if refused := _refused(world, arms, start, goals):
        return NoPath(refused)
    usable = [goal for goal in goals if _past(arms, "goal", goal) is None and world.free(goal)]
    usable.sort(key=lambda goal: float(np.linalg.norm(goal - start)))
    motion, margin = world.motion(SIDES, start), world.margin
    slack = SLACK * margin
    found = motion.connect(
        start,
        np.array(usable),
        _bounds(arms, [start, *usable]),
        seed=seed,
        margin=margin,
        slack=slack,
        longest=RANGE,
        samples=SAMPLES_PER_ITERATION * iterations,
    )
    if not len(found.points):
        return NoPath(Exhausted(found.states, found.samples))
    return BothPath(_shortened(motion, found.points, margin, slack, seed))


def _shortened(motion: Motion, path: Array, margin: float, slack: float, seed: int) -> Array:
    """A proven path with detours and corners cut."""
    if len(path) == 2:
        return path

    def edge(a: Array, b: Array) -> bool:
        return motion.path(np.stack([a, b]), margin, slack)[1] == FREE

    short = motion.shorten(path, seed=seed, margin=margin, slack=slack, attempts=2 * SHORTCUTS)
    return rounded(edge, short)


def _bounds(arms: DualArm, ends: Sequence[Array]) -> Array:
    """Where samples are drawn ``(2, 14)`` [rad]: inside the limits, start and goals included."""
    lower, upper = (np.concatenate([getattr(arms[side], end) for side in SIDES]) for end in ("lower", "upper"))
    return np.stack([np.minimum(lower + INSET, np.min(ends, axis=0)), np.maximum(upper - INSET, np.max(ends, axis=0))])


def _refused(
    world: CollisionWorld, arms: DualArm, start: Array, goals: Array
) -> StartInCollision | GoalInCollision | OutOfLimits | None:
    """What makes a search pointless."""
    if past := _past(arms, "start", start):
        return past
    beyond = [_past(arms, "goal", goal) for goal in goals]
    legal = [goal for goal, past in zip(goals, beyond, strict=True) if past is None]
    if not legal:
        return beyond[0]
    if contact := world.contact(start):
        return StartInCollision(contact)
    first = world.contact(legal[0])
    return GoalInCollision(first) if first and not any(world.free(goal) for goal in legal) else None


def _past(arms: DualArm, which: str, q: Array) -> OutOfLimits | None:
    """The limit that ``q`` ``(14,)`` [rad] is past, if any."""
    for side, part in zip(SIDES, np.split(q, 2), strict=True):
        if not arms[side].within_limits(part):
            return OutOfLimits(which, *past_limit(arms[side], part))
    return None
