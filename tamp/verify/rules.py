"""What each stage of each task type may do at all, whatever the plan claims: order, roles, holding, touching."""

from __future__ import annotations

import re
from dataclasses import dataclass

from robots.workcell import Side
from tamp.plan import Await, Grip, Motion, Plan, Role, Stage, StageName
from worlds.bullet.ghost import Names
from worlds.tasks import TaskType

ORDER: dict[TaskType, str] = {
    "articulated": "pregrasp lift reorient operate release retreat",
    "edge_push": "(push retreat )*grasp lift",
    "plate_lift": "press grasp release lift",
    "handover": "pregrasp lift present release",
}
"""The stages of a plan, as regular expressions over their names. An object may be pushed more than once, or, where it
reached over the edge from the beginning, not at all."""


@dataclass(frozen=True, slots=True)
class Rule:
    """What a stage may do.

    Attributes:
        role: Who acts.
        held: Who must hold the object when the stage begins; ``None`` for nobody.
        touch: What may touch the object: ``table``, or a role, whose fingers are meant. ``arrived`` before a role means
            from the end of its approach on, ``meeting`` from the end of its approach on or, where the hand does not
            descend onto the object, in the last part of it, ``leaving`` until it has moved straight away.
    """

    role: Role
    held: Role | None
    touch: tuple[str, ...]


PICK: dict[StageName, Rule] = {
    "pregrasp": Rule("assistant", None, ("table", "arrived assistant")),
    "lift": Rule("assistant", "assistant", ("table", "assistant")),
}
"""The assistant takes the object from the table."""

RULES: dict[TaskType, dict[StageName, Rule]] = {
    "articulated": PICK
    | {
        "reorient": Rule("assistant", "assistant", ("assistant",)),
        "operate": Rule("primary", "assistant", ("assistant", "arrived primary")),
        "release": Rule("primary", "assistant", ("assistant", "primary")),
        "retreat": Rule("primary", "assistant", ("assistant", "primary")),
    },
    "edge_push": {
        "push": Rule("assistant", None, ("table", "meeting assistant")),
        "retreat": Rule("assistant", None, ("table", "leaving assistant")),
        "grasp": Rule("primary", None, ("table", "arrived primary")),
        "lift": Rule("primary", "primary", ("table", "primary")),
    },
    "plate_lift": {
        "press": Rule("assistant", None, ("table", "arrived assistant")),
        "grasp": Rule("primary", None, ("table", "assistant", "arrived primary")),
        "release": Rule("assistant", "primary", ("table", "leaving assistant", "primary")),
        "lift": Rule("primary", "primary", ("table", "primary")),
    },
    "handover": PICK
    | {
        "present": Rule("assistant", "assistant", ("assistant",)),
        "release": Rule("assistant", "assistant", ("leaving assistant",)),
    },
}

HOLDS_LAST: dict[TaskType, Role | None] = {
    "articulated": "assistant",
    "edge_push": "primary",
    "plate_lift": "primary",
    "handover": None,
}
"""Who holds the object when the plan ends; ``None`` after it was handed to the human."""

GUARDED = ("descend",)
"""Motions that go further than the expected contact, and so must stop at a force."""

Step = Motion | Grip | Await


def rule_of(plan: Plan, stage: Stage) -> Rule:
    """What a stage of a plan may do; the stage must be one of its task's."""
    return RULES[plan.task][stage.name]


def in_order(plan: Plan) -> bool:
    """Whether the stages are those of the task, in order."""
    return re.fullmatch(ORDER[plan.task], " ".join(stage.name for stage in plan.stages)) is not None


def arm_of(plan: Plan, role: Role | None) -> Side | None:
    """The arm that plays a role."""
    return None if role is None else plan.assistant if role == "assistant" else plan.primary


def fingers(plan: Plan, side: Side) -> list[str]:
    """World-unique names of a hand's fingers."""
    return [f"{side}/{link}" for link in plan.workcell.arm(side).gripper.finger_links]


def pair_of(a: str, b: str) -> Names:
    """Two names in alphabetical order."""
    return (a, b) if a < b else (b, a)


def may_touch(plan: Plan, stage: Stage, number: int) -> set[Names]:
    """What may touch at all in a step of a stage, by what the stage is for."""
    touching: set[Names] = set()
    for word in rule_of(plan, stage).touch:
        when, _, who = word.rpartition(" ")
        if who == "table":
            touching.add(("object", "table"))
        elif _now(when, stage, number):
            side = plan.assistant if who == "assistant" else plan.primary
            touching |= {pair_of(finger, "object") for finger in fingers(plan, side)}
    return touching


def _now(when: str, stage: Stage, number: int) -> bool:
    match when:
        case "arrived":
            return arrived(stage, number)
        case "meeting":
            return arrived(stage, number) or meets_level(stage, number)
        case "leaving":
            return not any(_is(step, "free") for step in stage.steps[: number + 1])
        case _:
            return True


def arrived(stage: Stage, number: int) -> bool:
    """Whether the hand is where it acts: no way there is left in this step or after it."""
    return not any(_is(step, "free", "approach") for step in stage.steps[number:])


def meets_level(stage: Stage, number: int) -> bool:
    """Whether a hand comes up to an object from behind in a step, to push it without pressing on it."""
    level = stage.name == "push" and not presses_on(stage)
    return level and _is(stage.steps[number], "approach") and arrived(stage, number + 1)


def presses_on(stage: Stage) -> bool:
    """Whether a push presses on the object from above."""
    return any(_is(step, *GUARDED) for step in stage.steps)


def takes(stage: Stage, number: int) -> bool:
    """Whether a step closes the fingers on the object in order to hold it."""
    return stage.name in ("pregrasp", "grasp") and isinstance(stage.steps[number], Grip) and arrived(stage, number)


def hands_over(plan: Plan, stage: Stage, number: int) -> bool:
    """Whether a hand may open although it holds the object: the human has pulled at it."""
    waited = any(isinstance(step, Await) for step in stage.steps[:number])
    return plan.task == "handover" and stage.name == "release" and waited


def _is(step: Step, *templates: str) -> bool:
    return isinstance(step, Motion) and step.template in templates
