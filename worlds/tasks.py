"""What each category asks for: its task type, its instruction and the numbers that decide success."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

from robots.errors import UnknownName

TaskType = Literal["articulated"]


class Task(Struct, frozen=True, kw_only=True):
    """One column of the benchmark.

    Success of an ``articulated`` task (paper, section 4.1): the functional joint moved past the asset's
    threshold by the primary arm while the assistant holds the object.
    """

    category: str
    type: TaskType
    instruction: str
    hold_slip: float = 0.020
    """Largest motion of the object in the assistant's hand that still counts as holding [m]."""
    hold_turn: float = 0.35
    """Largest turn of the object in the assistant's hand that still counts as holding [rad]."""
    press_force: float = 60.0
    """Largest force with which a part may be pressed [N]."""
    press_stop: float = 35.0
    """Force at which the primary arm stops pressing, as its joint torque sensors would tell [N]."""
    settle: float = 0.5
    """Time after the last motion before success is judged [s]."""


TASKS: dict[str, Task] = {
    "Bottle": Task(category="Bottle", type="articulated", instruction="open the lid of the bottle"),
    "Dispenser": Task(category="Dispenser", type="articulated", instruction="press the pump of the dispenser"),
    "Lighter": Task(category="Lighter", type="articulated", instruction="press the button of the lighter"),
    "Pen-Button": Task(category="Pen-Button", type="articulated", instruction="press the button of the pen"),
    "Pen-Cap": Task(category="Pen-Cap", type="articulated", instruction="pull the cap off the pen"),
    "Stapler": Task(category="Stapler", type="articulated", instruction="press the stapler shut"),
    "USB": Task(category="USB", type="articulated", instruction="pull the cap off the USB stick"),
}


def task_of(category: str) -> Task:
    """The task of a category; ``UnknownName`` with a suggestion when there is none."""
    if category not in TASKS:
        raise UnknownName("category", category, TASKS)
    return TASKS[category]
