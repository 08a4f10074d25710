"""Every stage the sequencer knows, on one screen: when it may run, what it changes, how it is sampled and checked."""

from __future__ import annotations

from dataclasses import dataclass

from robots.workcell import SIDES, Side, other
from tamp.plan import Role, StageName, Template
from tamp.symbols import PREDICATES, Atom, State
from worlds.tasks import TaskType


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
        counts: A fact whose count grows by one each time the stage runs; empty for none.
    """

    name: StageName
    role: Role
    needs: tuple[str, ...]
    adds: tuple[str, ...]
    deletes: tuple[str, ...]
    sampler: str
    motions: tuple[Template | str, ...]
    monitor: str
    counts: str = ""


PREGRASP = Operator(
    "pregrasp",
    "assistant",
    needs=("free arm", "resting"),
    adds=("holds arm",),
    deletes=("free arm",),
    sampler="pregrasp",
    motions=("free", "approach", "close"),
    monitor="holds arm",
)
LIFT_HELD = Operator(
    "lift",
    "assistant",
    needs=("holds arm", "resting"),
    adds=("lifted",),
    deletes=("resting",),
    sampler="",
    motions=("lift",),
    monitor="lifted",
)
REORIENT = Operator(
    "reorient",
    "assistant",
    needs=("holds arm", "lifted"),
    adds=("exposed",),
    deletes=(),
    sampler="object_pose",
    motions=("free",),
    monitor="exposed",
)
OPERATE = Operator(
    "operate",
    "primary",
    needs=("free arm", "holds partner", "exposed"),
    adds=("operated", "engaged arm"),
    deletes=("free arm",),
    sampler="goal",
    motions=("free", "approach", "close", "pull|twist|press|flip"),
    monitor="operated",
)
RELEASE_PART = Operator(
    "release",
    "primary",
    needs=("engaged arm",),
    adds=("disengaged arm",),
    deletes=("engaged arm",),
    sampler="",
    motions=("open",),
    monitor="disengaged arm",
)
RETREAT_FROM_PART = Operator(
    "retreat",
    "primary",
    needs=("disengaged arm", "holds partner"),
    adds=("clear arm", "free arm"),
    deletes=("disengaged arm",),
    sampler="",
    motions=("retreat",),
    monitor="holds partner",
)
PUSH = Operator(
    "push",
    "assistant",
    needs=("free arm", "free partner", "resting"),
    adds=("overhanging", "touching arm"),
    deletes=("free arm",),
    sampler="push",
    motions=("close", "free", "approach", "descend", "drag"),
    monitor="overhanging",
    counts="pushed",
)
RETREAT_FROM_PUSH = Operator(
    "retreat",
    "assistant",
    needs=("touching arm", "overhanging"),
    adds=("free arm",),
    deletes=("touching arm",),
    sampler="",
    motions=("retreat", "free"),
    monitor="overhanging",
)
GRASP_EDGE = Operator(
    "grasp",
    "primary",
    needs=("free arm", "free partner", "overhanging"),
    adds=("holds arm",),
    deletes=("free arm",),
    sampler="goal",
    motions=("open", "free", "approach", "close"),
    monitor="holds arm",
)
LIFT_ALONE = Operator(
    "lift",
    "primary",
    needs=("holds arm", "free partner", "resting"),
    adds=("lifted",),
    deletes=("resting", "overhanging", "tilted"),
    sampler="",
    motions=("lift",),
    monitor="lifted",
)
PRESS = Operator(
    "press",
    "assistant",
    needs=("free arm", "resting"),
    adds=("tilted", "touching arm"),
    deletes=("free arm",),
    sampler="press",
    motions=("close", "free", "approach", "descend"),
    monitor="tilted",
)
GRASP_RAISED = Operator(
    "grasp",
    "primary",
    needs=("free arm", "touching partner", "tilted"),
    adds=("holds arm",),
    deletes=("free arm",),
    sampler="goal",
    motions=("open", "free", "approach", "close"),
    monitor="holds arm",
)
RELEASE_PRESSED = Operator(
    "release",
    "assistant",
    needs=("touching arm", "holds partner"),
    adds=("free arm",),
    deletes=("touching arm",),
    sampler="",
    motions=("retreat",),
    monitor="holds partner",
)
PRESENT = Operator(
    "present",
    "assistant",
    needs=("holds arm", "lifted"),
    adds=("presented",),
    deletes=(),
    sampler="present",
    motions=("free",),
    monitor="presented",
)
RELEASE_TO_HUMAN = Operator(
    "release",
    "assistant",
    needs=("holds arm", "presented"),
    adds=("handed", "free arm"),
    deletes=("holds arm",),
    sampler="",
    motions=("wait", "open"),
    monitor="handed",
)

OPERATE_ALONE = Operator(
    "operate",
    "primary",
    needs=("free arm", "free partner", "resting"),
    adds=("operated", "engaged arm"),
    deletes=("free arm",),
    sampler="goal",
    motions=("free", "approach", "close", "pull|twist|press|flip"),
    monitor="operated",
)
RETREAT_ALONE = Operator(
    "retreat",
    "primary",
    needs=("disengaged arm", "free partner"),
    adds=("clear arm", "free arm"),
    deletes=("disengaged arm",),
    sampler="",
    motions=("retreat",),
    monitor="holds partner",
)
GRASP_ALONE = Operator(
    "grasp",
    "primary",
    needs=("free arm", "free partner", "resting"),
    adds=("holds arm",),
    deletes=("free arm",),
    sampler="goal",
    motions=("open", "free", "approach", "close"),
    monitor="holds arm",
)

OPERATORS: dict[TaskType, tuple[Operator, ...]] = {
    "articulated": (PREGRASP, LIFT_HELD, REORIENT, OPERATE, RELEASE_PART, RETREAT_FROM_PART),
    "edge_push": (PUSH, RETREAT_FROM_PUSH, GRASP_EDGE, LIFT_ALONE),
    "plate_lift": (PRESS, GRASP_RAISED, RELEASE_PRESSED, LIFT_ALONE),
    "handover": (PREGRASP, LIFT_HELD, PRESENT, RELEASE_TO_HUMAN),
}

ALONE: dict[TaskType, tuple[Operator, ...]] = {
    "articulated": (OPERATE_ALONE, RELEASE_PART, RETREAT_ALONE),
    "edge_push": (GRASP_ALONE, LIFT_ALONE),
    "plate_lift": (GRASP_ALONE, LIFT_ALONE),
    "handover": (),
}
"""The same for one arm that has no assistant, as Where2Act acts; success is judged as for two."""

INITIAL: State = frozenset({Atom("resting"), *(Atom("free", side) for side in SIDES)})
"""Before anything moves."""


def solved(task: TaskType, state: State) -> bool:
    """Whether a state reaches the goal of a task type.

    Articulated: operated and let go by one arm while the other still holds, or nobody ever did. Edge push and plate:
    one arm alone holds the lifted object. Handover: the human holds it.
    """
    match task:
        case "articulated":
            return Atom("operated") in state and any(
                Atom("clear", side) in state
                and (Atom("holds", other(side)) in state or {Atom("resting"), Atom("free", other(side))} <= state)
                for side in SIDES
            )
        case "edge_push" | "plate_lift":
            return Atom("lifted") in state and any(
                Atom("holds", side) in state and Atom("free", other(side)) in state for side in SIDES
            )
        case "handover":
            return Atom("handed") in state


def ground(fact: str, arm: Side) -> Atom:
    """The atom that ``fact`` of an operator means when ``arm`` acts."""
    predicate, _, who = fact.partition(" ")
    return Atom(predicate, {"": None, "arm": arm, "partner": other(arm)}[who])


def applicable(operator: Operator, arm: Side, state: State) -> bool:
    """Whether the operator may run with ``arm`` in ``state``."""
    return all(ground(fact, arm) in state for fact in operator.needs)


def times(predicate: str, state: State) -> int:
    """The count of a counting fact in ``state``."""
    return max((atom.count for atom in state if atom.predicate == predicate), default=0)


def successor(operator: Operator, arm: Side, state: State) -> State:
    """The state after the operator ran with ``arm``."""
    removed = {ground(fact, arm) for fact in operator.deletes}
    after = (state - removed) | {ground(fact, arm) for fact in operator.adds}
    if operator.counts:
        count = times(operator.counts, state)
        others = frozenset(atom for atom in after if atom.predicate != operator.counts)
        return others | {Atom(operator.counts, None, count + 1)}
    return after


def to_pddl(task: TaskType = "articulated") -> str:
    """The operators of a task type as a PDDL domain, for other planners and for reading; counts are left out."""
    operators = OPERATORS[task]
    facts = {fact for operator in operators for fact in (*operator.needs, *operator.adds, *operator.deletes)}
    about_arm = {fact.partition(" ")[0] for fact in facts if " " in fact}
    used = {fact.partition(" ")[0] for fact in facts}
    lines = ["(define (domain preparatory)", "  (:requirements :strips :typing)", "  (:types arm)", "  (:predicates"]
    lines += ["    (partner ?a - arm ?b - arm)"]
    lines += [
        f"    ({name}{' ?a - arm' if name in about_arm else ''})  ; {text}"
        for name, text in PREDICATES.items()
        if name in used
    ]
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
