"""Every stage the sequencer knows, on one screen: when it may run, what it changes, how it is sampled and checked."""

from __future__ import annotations

from dataclasses import dataclass

from robots.workcell import SIDES, Side, other
from tamp.plan import Role, StageName, Template
from tamp.symbols import PREDICATES, Atom, State


@dataclass(frozen=True, slots=True)
class Operator:
    """A stage before it is bound to an arm. ``arm`` is the acting arm, ``partner`` the other one.

    Attributes:
        name: The stage.
        role: Which role the acting arm plays.
        needs: Facts before, as ``predicate``, ``predicate arm`` or ``predicate partner``.
        adds: Facts after.
        deletes: Facts no longer true after.
        sampler: Method of the proposer whose candidates it refines; empty for none.
        motions: How the arm moves, in order; ``open`` and ``close`` move the fingers.
        monitor: The fact that execution checks when the stage ends.
    """

    name: StageName
    role: Role
    needs: tuple[str, ...]
    adds: tuple[str, ...]
    deletes: tuple[str, ...]
    sampler: str
    motions: tuple[Template | str, ...]
    monitor: str


ARTICULATED: tuple[Operator, ...] = (
    Operator(
        "pregrasp",
        "assistant",
        needs=("free arm", "resting"),
        adds=("holds arm",),
        deletes=("free arm",),
        sampler="pregrasp",
        motions=("free", "approach", "close"),
        monitor="holds arm",
    ),
    Operator(
        "lift",
        "assistant",
        needs=("holds arm", "resting"),
        adds=("lifted",),
        deletes=("resting",),
        sampler="",
        motions=("lift",),
        monitor="lifted",
    ),
    Operator(
        "reorient",
        "assistant",
        needs=("holds arm", "lifted"),
        adds=("exposed",),
        deletes=(),
        sampler="object_pose",
        motions=("free",),
        monitor="exposed",
    ),
    Operator(
        "operate",
        "primary",
        needs=("free arm", "holds partner", "exposed"),
        adds=("operated", "engaged arm"),
        deletes=("free arm",),
        sampler="goal",
        motions=("free", "approach", "close", "pull|twist|press"),
        monitor="operated",
    ),
    Operator(
        "release",
        "primary",
        needs=("engaged arm",),
        adds=("disengaged arm",),
        deletes=("engaged arm",),
        sampler="",
        motions=("open",),
        monitor="disengaged arm",
    ),
    Operator(
        "retreat",
        "primary",
        needs=("disengaged arm", "holds partner"),
        adds=("clear arm", "free arm"),
        deletes=("disengaged arm",),
        sampler="",
        motions=("retreat",),
        monitor="holds partner",
    ),
)

INITIAL: State = frozenset({Atom("resting"), *(Atom("free", side) for side in SIDES)})
"""Before anything moves."""


def solved(state: State) -> bool:
    """The goal of an ``articulated`` task: operated and let go by one arm while the other still holds."""
    return Atom("operated") in state and any(
        Atom("clear", side) in state and Atom("holds", other(side)) in state for side in SIDES
    )


def ground(fact: str, arm: Side) -> Atom:
    """The atom that ``fact`` of an operator means when ``arm`` acts."""
    predicate, _, who = fact.partition(" ")
    return Atom(predicate, {"": None, "arm": arm, "partner": other(arm)}[who])


def applicable(operator: Operator, arm: Side, state: State) -> bool:
    """Whether the operator may run with ``arm`` in ``state``."""
    return all(ground(fact, arm) in state for fact in operator.needs)


def successor(operator: Operator, arm: Side, state: State) -> State:
    """The state after the operator ran with ``arm``."""
    removed = {ground(fact, arm) for fact in operator.deletes}
    return (state - removed) | {ground(fact, arm) for fact in operator.adds}


def to_pddl(operators: tuple[Operator, ...] = ARTICULATED) -> str:
    """The operators as a PDDL domain, for other planners and for reading."""
    about_arm = {
        fact.partition(" ")[0]
        for operator in operators
        for fact in (*operator.needs, *operator.adds, *operator.deletes)
        if " " in fact
    }
    lines = ["(define (domain preparatory)", "  (:requirements :strips :typing)", "  (:types arm)", "  (:predicates"]
    lines += ["    (partner ?a - arm ?b - arm)"]
    lines += [f"    ({name}{' ?a - arm' if name in about_arm else ''})  ; {text}" for name, text in PREDICATES.items()]
    lines += ["  )"]
    for operator in operators:
        lines += [
            f"  (:action {operator.name}  ; by the {operator.role}",
            "    :parameters (?a - arm ?b - arm)",
            f"    :precondition (and (partner ?a ?b) {' '.join(map(_literal, operator.needs))})",
            f"    :effect (and {' '.join(map(_literal, operator.adds))}"
            + "".join(f" (not {_literal(fact)})" for fact in operator.deletes)
            + "))",
        ]
    return "\n".join([*lines, ")"]) + "\n"


def _literal(fact: str) -> str:
    predicate, _, who = fact.partition(" ")
    return f"({predicate}{ {'': '', 'arm': ' ?a', 'partner': ' ?b'}[who] })"
