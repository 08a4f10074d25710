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
    "pushed": "the object has been pushed this many times",
    "overhanging": "the object reaches over the table's edge and does not fall",
    "touching": "the arm's fingers touch the object without holding it",
    "tilted": "the object is pressed down on one side and raised on the other",
    "presented": "the object is in the human's reach, functional part towards the human",
    "handed": "the human holds the object",
}


@dataclass(frozen=True, slots=True, order=True)
class Atom:
    """A ground fact.

    Attributes:
        predicate: A key of ``PREDICATES``.
        arm: The arm it is about; ``None`` for facts of the object alone.
        count: How often, for facts that count; else 0.
    """

    predicate: str
    arm: Side | None = None
    count: int = 0

    def __post_init__(self) -> None:
        if self.predicate not in PREDICATES:
            raise ValueError(f"no predicate {self.predicate}; there are {', '.join(PREDICATES)}")

    def __str__(self) -> str:
        times = f" x{self.count}" if self.count else ""
        return f"{self.predicate}({self.arm or 'object'}){times}"


State = frozenset[Atom]
"""Every fact that holds; what is absent is false."""
