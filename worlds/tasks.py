"""What each column asks for: its task type, its objects, its instruction and the numbers that decide success."""

from __future__ import annotations

from typing import Literal, get_args

from msgspec import Struct

from robots.errors import UnknownName

TaskType = Literal["articulated", "edge_push", "plate_lift", "handover"]

TASK_TYPES: tuple[TaskType, ...] = get_args(TaskType)


class Task(Struct, frozen=True, kw_only=True):
    """One column of the benchmark.

    Success by task type (the paper's section 4.1, with this project's numbers):

    - ``articulated``: the functional joint moved past the asset's threshold by the primary arm while the assistant
      holds the object.
    - ``edge_push``, ``plate_lift``: the primary gripper alone holds the object with both fingers, it has risen by
      ``lift_height``, and it stays so for ``hold_time`` without slipping more than ``lift_slip``.
    - ``handover``: the human's hand pulled with ``pull_force``, the assistant let go, and the human holds the object
      in the stated zone, functional part first, for ``hold_time``.
    """

    category: str
    """Name of the column, as on the command line."""
    type: TaskType
    instruction: str
    objects: str
    """The object category whose instances are used: the column's own name except for a handover."""
    hold_slip: float = 0.020
    """Largest motion of the object in the assistant's hand that still counts as holding [m]."""
    hold_turn: float = 0.35
    """Largest turn of the object in the assistant's hand that still counts as holding [rad]."""
    press_force: float = 60.0
    """Largest force with which a part may be pressed [N]."""
    lift_height: float = 0.10
    """How far the object must rise in the primary's grasp [m]; the paper's value."""
    lift_slip: float = 0.010
    """Largest motion of the object in the primary's hand while it is held up [m]."""
    hold_time: float = 1.0
    """Time for which it must stay held [s]; the paper's value."""
    overhang: tuple[float, float] = (0.008, 0.25)
    """How far a pushed object must and may reach over the table's edge [m]; more than this and it is about to fall."""
    tilt: float = 0.05
    """Least angle to which a pressed plate must be tilted [rad]."""
    facing: float = 0.6
    """Largest angle between the functional part and the way to the human when presented [rad]."""
    pull_force: tuple[float, float] = (5.0, 15.0)
    """Range of the human's pull in which the assistant must let go [N]."""
    settle: float = 0.5
    """Time after the last motion before success is judged [s]."""


def _tasks(type: TaskType, instructions: dict[str, str]) -> dict[str, Task]:
    return {name: Task(category=name, type=type, objects=name, instruction=text) for name, text in instructions.items()}


EDGE = _tasks(
    "edge_push",
    {
        "Bowl": "pick up the bowl",
        "Cap": "pick up the cap",
        "Keyboard": "pick up the keyboard",
        "Laptop": "pick up the laptop",
        "Phone": "pick up the phone",
        "Remote": "pick up the remote control",
        "Scissors": "pick up the scissors",
        "Switch": "pick up the switch",
        "Window": "pick up the window",
    },
)

ARTICULATED = _tasks(
    "articulated",
    {
        "Bottle": "open the lid of the bottle",
        "Dispenser": "press the pump of the dispenser",
        "Lighter": "operate the lighter",
        "Pen-Button": "press the button of the pen",
        "Pen-Cap": "pull the cap off the pen",
        "Pliers": "squeeze the handles of the pliers",
        "Stapler": "press the stapler shut",
        "USB": "pull the cap off the USB stick",
    },
)

PLATE = _tasks("plate_lift", {"Plate": "pick up the plate"})

HANDOVER = {
    f"Handover-{objects}": Task(
        category=f"Handover-{objects}",
        type="handover",
        objects=objects,
        instruction=f"hand over the {objects.lower()}",
    )
    for objects in ("Bottle", "Dispenser", "Pliers", "Stapler")
}

COLUMNS: tuple[str, ...] = (*EDGE, *ARTICULATED, *PLATE)
"""The paper's eighteen columns, in the order of its Table 1."""

TASKS: dict[str, Task] = EDGE | ARTICULATED | PLATE | HANDOVER


def task_of(category: str) -> Task:
    """The task of a column; ``UnknownName`` with a suggestion when there is none."""
    if category not in TASKS:
        raise UnknownName("category", category, TASKS)
    return TASKS[category]
