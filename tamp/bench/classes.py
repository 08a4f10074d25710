"""Which of the paper's five classes of failure does a failed episode belong to?

The paper (supplement, "Failure Case Analysis") describes its classes by one example each:

- ``small parts``: the assistant must hold a body so short that the hold is unstable (USB drives).
- ``one-shot push instability``: the object does not come to rest as a single push should leave it.
- ``occlusion``: the part to be operated is not seen well enough to decide.
- ``near-table geometry``: the hand that should grasp cannot, because of the table (small bowls).
- ``interaction-pose sensitivity``: the action was carried out, a little off (wide, shallow lids).

Our causes are finer and about geometry and physics, so the mapping is a reading, kept in this one table; what is about
time, software or arms in each other's way has no class of the paper's and stays ``other``.
"""

from __future__ import annotations

from typing import Literal, get_args

FailureClass = Literal[
    "small parts",
    "one-shot push instability",
    "occlusion",
    "near-table geometry",
    "interaction-pose sensitivity",
    "other",
]
CLASSES: tuple[FailureClass, ...] = get_args(FailureClass)

SMALL = frozenset({"USB", "Pen-Button", "Pen-Cap", "Lighter", "Switch"})
"""Columns whose objects' fixed bodies or parts are shorter than a finger is wide or little longer."""

GEOMETRIC = frozenset({"unreachable", "collision", "no_path", "cartesian", "uncertified"})
"""Causes found by a check before anything moves."""

UNCLASSED = frozenset({"budget", "timing", "tracking", "diverged", "error", "crashed", "timed_out"})
"""Causes that are about time, arms or software. What is in neither set was found while the object was handled."""

ASSISTANT_STAGES = frozenset({"pregrasp", "lift", "reorient"})
"""Stages in which the assistant's hold is at stake."""


def failure_class(category: str, stage: str | None, reason: str, detail: str) -> FailureClass:
    """The paper's class of a failure, from our cause, its stage and whether its words name the table."""
    if reason in UNCLASSED:
        return "other"
    if reason == "proposal":
        return "occlusion"
    if reason in GEOMETRIC:
        if "table" in detail:
            return "near-table geometry"
        return "small parts" if category in SMALL else "other"
    if stage == "push" or (stage == "retreat" and reason == "fell"):  # it slid on when the hand withdrew
        return "one-shot push instability"
    return "small parts" if category in SMALL and stage in ASSISTANT_STAGES else "interaction-pose sensitivity"
