"""How a plan gets shorter: while one arm still acts, the other already moves to where it acts next.

A stage of the other arm that begins by shaping its fingers and moving freely can do both before its turn: as late as
possible, or earlier where it would meet the acting arm, then waiting there. The curves stay what they were and only
their times change; where no time is free, a curve between the same ends is asked for that passes the acting arm. Both
arms are checked together, a millisecond at a time, in the state in which they will be.
"""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import replace as replaced

import numpy as np
from msgspec.structs import replace

from planners.beside import plan_beside
from planners.clock import Beside
from robots.spatial import Array
from robots.trajectory import Trajectory
from robots.workcell import Side, other
from tamp.drafts import Setting
from tamp.plan import Await, Grip, Meanwhile, Motion, Stage
from tamp.stages.cell import FREE_SPEED, HELD_SPEED, Cell
from tamp.timeline import StagePlans

STEP = 0.001
"""Time between checked states [s]: both arms together come less than the planner's margin nearer in it."""

EARLIER = 0.25
"""By how much earlier the next try begins [s]."""

LONGEST_WAIT = 6.0
"""Longest time for which an arm waits where it acts next [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Way:
    """What an arm does before its turn: its fingers move, then the arm.

    Attributes:
        side: The arm.
        stage: Number of its stage.
        steps: How many leading steps of the stage it replaces.
        curve: Standing while the fingers move, then the motion.
        waited: How long it stands at first [s].
        opening: Opening to which the fingers move [m]; ``None`` where they need not.
    """

    side: Side
    stage: int
    steps: int
    curve: Trajectory
    waited: float
    opening: float | None


@dataclass(frozen=True, slots=True, eq=False)
class _Slot:
    """A step of the acting arm before the other's turn.

    Attributes:
        stage, step: Its numbers.
        begin: When it begins, counted from the first of these steps [s].
        duration: [s].
        curve: Of a motion; ``None`` while the arm keeps still.
        q: Where the acting arm is when it begins ``(7,)`` [rad].
        setting: The collision world.
    """

    stage: int
    step: int
    begin: float
    duration: float
    curve: Trajectory | None
    q: Array
    setting: Setting


def overlapped(cell: Cell, plans: StagePlans) -> list[Stage]:
    """The stages with every arm's way to its turn moved before it where both arms stay clear of each other."""
    stages = list(plans.stages)
    for number in range(1, len(stages)):
        way = _leading(cell, stages, number)
        if way is None:
            continue
        slots = _before(stages, plans.settings, number)
        begin = _latest(cell, way, slots)
        if begin is None and (another := _another(cell, way, slots)) is not None:
            way, begin = another, _latest(cell, another, slots)
        if begin is not None:
            stages = _moved(stages, way, slots, begin)
    return stages


def _leading(cell: Cell, stages: list[Stage], number: int) -> _Way | None:
    """What a stage begins with that could be done before it; ``None`` where its arm has just acted."""
    stage, side = stages[number], stages[number].arm
    if stages[number - 1].arm == side:
        return None
    grips = [step for step in stage.steps[:1] if isinstance(step, Grip)]
    following = stage.steps[len(grips)]
    if not (isinstance(following, Motion) and following.template == "free" and following.meanwhile is None):
        return None
    waited = sum(grip.duration for grip in grips)
    opening = grips[0].opening if grips else None
    return _Way(side, number, len(grips) + 1, _delayed(following.trajectory(), waited), waited, opening)


def _delayed(curve: Trajectory, wait: float) -> Trajectory:
    """A curve after a time of standing at its begin [s]."""
    if not wait:
        return curve
    return Trajectory(
        np.concatenate([[0.0], curve.times + wait]),
        np.concatenate([curve.positions[:1], curve.positions]),
        np.concatenate([np.zeros((1, 7)), curve.velocities]),
    )


def _another(cell: Cell, way: _Way, slots: list[_Slot]) -> _Way | None:
    """A way between the same ends past the acting arm's longest motion; ``None`` where there is none."""
    moving = [slot for slot in slots if slot.curve is not None]
    if not moving or slots[-1].begin + slots[-1].duration < way.curve.duration:
        return None
    longest = max(moving, key=lambda slot: slot.duration)
    assert longest.curve is not None
    cell.apply(longest.setting)
    speed = HELD_SPEED if longest.setting.holder == way.side else FREE_SPEED
    start, goal = way.curve.positions[[0, -1]]
    found = plan_beside(cell.world, cell.arms[way.side], start, goal, longest.curve, seed=way.stage, speed=speed)
    return replaced(way, curve=_delayed(found.trajectory, way.waited)) if isinstance(found, Beside) else None


def _before(stages: list[Stage], settings: list[list[Setting]], number: int) -> list[_Slot]:
    """The steps just before a stage's turn during which the other arm may move: none with a force to feel."""
    acting = other(stages[number].arm)
    found: list[tuple[int, int, Motion | Grip]] = []
    for k in range(number - 1, -1, -1):
        for n in range(len(stages[k].steps) - 1, -1, -1):
            step = stages[k].steps[n]
            felt = isinstance(step, Await) or (isinstance(step, Motion) and (step.guard or step.force))
            if stages[k].arm != acting or felt or step.meanwhile is not None:
                return _slots(found[::-1], stages, settings)
            if not isinstance(step, Await):
                found.append((k, n, step))
    return _slots(found[::-1], stages, settings)


def _slots(
    found: list[tuple[int, int, Motion | Grip]], stages: list[Stage], settings: list[list[Setting]]
) -> list[_Slot]:
    slots: list[_Slot] = []
    begin = 0.0
    for k, n, step in found:
        curve = step.trajectory() if isinstance(step, Motion) else None
        q = curve.positions[0] if curve is not None else _standing(stages, k, n)
        slots.append(_Slot(k, n, begin, step.duration, curve, q, settings[k][n]))
        begin += step.duration
    return slots


def _standing(stages: list[Stage], number: int, step: int) -> Array:
    """Where a stage's arm is before one of its steps that is no motion: at the end of its last, or before its next."""
    steps, side = stages[number].steps, stages[number].arm
    before = [s for stage in stages[:number] if stage.arm == side for s in stage.steps] + list(steps[:step])
    ends = [s.positions[-1] for s in before if isinstance(s, Motion)]
    if ends:
        return np.array(ends[-1])
    return np.array(next(s.positions[0] for s in steps[step:] if isinstance(s, Motion)))


def _latest(cell: Cell, way: _Way, slots: list[_Slot]) -> float | None:
    """The latest begin [s] at which the way is free and done in time; ``None`` where there is none."""
    if not slots:
        return None
    total = slots[-1].begin + slots[-1].duration
    begin = total - way.curve.duration
    earliest = max(0.0, begin - LONGEST_WAIT)
    while begin >= earliest - 1e-9:
        if _free(cell, way, slots, begin):
            return begin
        begin -= EARLIER
    return None


def _free(cell: Cell, way: _Way, slots: list[_Slot], begin: float) -> bool:
    """Whether both arms stay clear from the begin of the way to the end of the slots."""
    for slot in slots:
        end = slot.begin + slot.duration
        if end <= begin:
            continue
        cell.apply(slot.setting)
        times = np.arange(max(begin, slot.begin), end + STEP / 2, STEP)
        waiting = way.curve.sample(times - begin)[0]
        acting = np.broadcast_to(slot.q, waiting.shape)
        if slot.curve is not None:
            acting = slot.curve.sample(times - slot.begin)[0]
        for q, q_other in zip(waiting, acting, strict=True):
            if not cell.world.free(cell.both(way.side, q, q_other)):
                return False
    return True


def _moved(stages: list[Stage], way: _Way, slots: list[_Slot], begin: float) -> list[Stage]:
    """The stages with the way cut into the steps during which it happens."""
    changed = list(stages)
    opening = way.opening
    for slot in slots:
        first, last = max(begin, slot.begin), min(begin + way.curve.duration, slot.begin + slot.duration)
        if last - first < 1e-6:
            continue
        piece = _piece(way, first - begin, last - begin, first - slot.begin, opening)
        opening = None
        steps = list(changed[slot.stage].steps)
        steps[slot.step] = replace(steps[slot.step], meanwhile=piece)
        changed[slot.stage] = replace(changed[slot.stage], steps=steps)
    turn = changed[way.stage]
    changed[way.stage] = replace(turn, steps=turn.steps[way.steps :])
    return changed


def _piece(way: _Way, first: float, last: float, begin: float, opening: float | None) -> Meanwhile:
    """The part of a way between two of its times [s]: a part of a cubic is the cubic through its ends."""
    inside = way.curve.times[(way.curve.times > first + 1e-9) & (way.curve.times < last - 1e-9)]
    times = np.concatenate([[first], inside, [last]])
    positions, velocities, _ = way.curve.sample(times)
    return Meanwhile(
        arm=way.side,
        begin=max(0.0, float(begin)),
        times=[0.0, *(float(t - first) for t in times[1:])],
        positions=positions.tolist(),
        velocities=velocities.tolist(),
        opening=opening,
    )
