"""What a check of a plan can find, and the whole finding."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

Kind = Literal[
    "asset_changed", "structure", "roles", "start", "jump", "not_at_rest", "position_limit", "velocity_limit",
    "acceleration_limit", "force_limit", "unguarded", "allows_too_much", "contact", "closes_on_nothing",
    "misses_object", "drops_object", "not_held", "holder", "object_frame", "not_a_slide", "off_table", "not_a_tilt",
    "on_table",
]  # fmt: skip


class Violation(Struct, frozen=True, kw_only=True):
    """One thing that is wrong.

    Attributes:
        kind: For counting.
        stage: Stage name, or ``plan``.
        step: Number of the step in the stage.
        time: When in the step it is worst [s].
        detail: What, with names and numbers.
    """

    kind: Kind
    stage: str
    step: int
    time: float
    detail: str


class Verification(Struct, frozen=True, kw_only=True):
    """What an independent check of a plan found.

    Attributes:
        ok: Nothing is wrong.
        violations: Everything that is.
        min_clearance: Smallest distance between bodies that may not touch [m], at most ``contacts.CLEARANCE_CAP``:
            measured at every ``contacts.CLEARANCE_EVERY``-th state, and at every state in which bodies nearly touch.
        max_velocity_ratio: Largest joint velocity over its limit.
        max_acceleration_ratio: Largest joint acceleration over its limit.
        checked_states: Configurations checked for contact.
        seconds: Wall time [s].
    """

    ok: bool
    violations: list[Violation]
    min_clearance: float
    max_velocity_ratio: float
    max_acceleration_ratio: float
    checked_states: int
    seconds: float
