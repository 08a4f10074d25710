"""Laws of the symbolic search, for every task type."""

from __future__ import annotations

import pytest

from robots.workcell import SIDES
from tamp.operators import INITIAL, OPERATORS, applicable, solved, successor, times, to_pddl
from tamp.skeletons import Skeleton, roles_of, skeletons
from tamp.symbols import Atom
from worlds.tasks import TASK_TYPES, TaskType

TYPICAL: dict[TaskType, str] = {
    "articulated": "pregrasp lift reorient operate release retreat",
    "edge_push": "push retreat grasp lift",
    "plate_lift": "press grasp release lift",
    "handover": "pregrasp lift present release",
}
FOUND = [(task, skeleton) for task in TASK_TYPES for skeleton in skeletons(task)]
PUSHED = list(skeletons("edge_push", repeats=3))


def names(skeleton: Skeleton) -> str:
    return " ".join(stage.operator.name for stage in skeleton)


def label(value: object) -> str:
    return str(value[0]) if isinstance(value, tuple) else str(value)


def pushes(skeleton: Skeleton) -> int:
    return sum(stage.operator.name == "push" for stage in skeleton)


@pytest.mark.parametrize("task", TASK_TYPES)
def test_both_role_assignments_are_found_and_nothing_else_is_shorter(task: TaskType) -> None:
    found = [skeleton for kind, skeleton in FOUND if kind == task]
    assert {roles_of(skeleton).assistant for skeleton in found} == set(SIDES)
    assert [len(skeleton) for skeleton in found] == sorted(len(skeleton) for skeleton in found)
    assert names(found[0]) == TYPICAL[task]


@pytest.mark.parametrize(("task", "skeleton"), [*FOUND, *(("edge_push", s) for s in PUSHED)], ids=label)
def test_a_skeleton_replays_to_the_goal(task: TaskType, skeleton: Skeleton) -> None:
    state = INITIAL
    for stage in skeleton:
        assert applicable(stage.operator, stage.arm, state)
        assert not solved(task, state)
        state = successor(stage.operator, stage.arm, state)
    assert solved(task, state)


@pytest.mark.parametrize(("task", "skeleton"), FOUND, ids=label)
def test_an_arm_plays_one_role(task: TaskType, skeleton: Skeleton) -> None:
    roles = roles_of(skeleton)
    assert roles.assistant != roles.primary
    assert all(stage.arm == getattr(roles, stage.operator.role) for stage in skeleton)


def test_a_second_push_costs_more_and_comes_by_itself_up_to_the_limit() -> None:
    assert {pushes(skeleton) for task, skeleton in FOUND if task == "edge_push"} == {1}
    counts = [pushes(skeleton) for skeleton in PUSHED]
    assert set(counts) == {1, 2, 3}
    assert counts == sorted(counts)


def test_a_push_counts_itself() -> None:
    push = OPERATORS["edge_push"][0]
    once = successor(push, "left", INITIAL)
    assert (times("pushed", INITIAL), times("pushed", once)) == (0, 1)
    assert times("pushed", successor(push, "left", once)) == 2


def test_what_overhangs_already_is_grasped_at_once() -> None:
    found = next(iter(skeletons("edge_push", INITIAL | {Atom("overhanging")})))
    assert names(found) == "grasp lift"


def test_a_second_hand_is_needed_to_operate() -> None:
    operate = next(operator for operator in OPERATORS["articulated"] if operator.name == "operate")
    state = frozenset({Atom("free", "left"), Atom("exposed")})
    assert not applicable(operate, "left", state)
    assert applicable(operate, "left", state | {Atom("holds", "right")})


def test_the_primary_lifts_only_what_the_assistant_has_let_go_of() -> None:
    lift = next(operator for operator in OPERATORS["plate_lift"] if operator.name == "lift")
    pressed = frozenset({Atom("resting"), Atom("tilted"), Atom("holds", "right"), Atom("touching", "left")})
    assert not applicable(lift, "right", pressed)
    assert applicable(lift, "right", pressed - {Atom("touching", "left")} | {Atom("free", "left")})


@pytest.mark.parametrize(
    ("task", "missing"),
    [("articulated", "reorient"), ("edge_push", "push"), ("plate_lift", "press"), ("handover", "present")],
)
def test_without_the_operator_that_prepares_there_is_no_skeleton(task: TaskType, missing: str) -> None:
    rest = tuple(operator for operator in OPERATORS[task] if operator.name != missing)
    assert list(skeletons(task, operators=rest)) == []


def test_an_unknown_predicate_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="no predicate flying; there are free"):
        Atom("flying")


@pytest.mark.parametrize("task", TASK_TYPES)
def test_the_pddl_domain_is_balanced_and_names_every_operator(task: TaskType) -> None:
    text = to_pddl(task)
    code = "\n".join(line.partition(";")[0] for line in text.splitlines())
    assert code.count("(") == code.count(")")
    assert all(f"(:action {operator.name}" in code for operator in OPERATORS[task])
