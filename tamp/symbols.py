"""What the symbolic state is made of: atoms over arms and the object."""

from __future__ import annotations

from dataclasses import dataclass

from robots.workcell import Side

PREDICATES: dict[str, str] = {
    "free": "the arm holds nothing and its fingers touch nothing",
    "resting": "the object rests on the table",
    "holds": "the arm holds the object by friction",
    "lifted": "the object is clear of the table",
    "exposed": "the functional part faces free space that the other arm reaches",
    "engaged": "the arm has operated the functional part and still touches it",
    "operated": "the functional joint has moved past its threshold",
    "disengaged": "the arm's fingers have let go of the functional part",
    "clear": "the arm has withdrawn after the operation",
}


@dataclass(frozen=True, slots=True, order=True)
class Atom:
    """A ground fact.

    Attributes:
        predicate: A key of ``PREDICATES``.
        arm: The arm it is about; ``None`` for facts of the object alone.
    """

    predicate: str
    arm: Side | None = None

    def __post_init__(self) -> None:
        if self.predicate not in PREDICATES:
            raise ValueError(f"no predicate {self.predicate}; there are {', '.join(PREDICATES)}")

    def __str__(self) -> str:
        return f"{self.predicate}({self.arm or 'object'})"


State = frozenset[Atom]
"""Every fact that holds; what is absent is false."""
