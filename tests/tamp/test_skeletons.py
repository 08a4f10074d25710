"""Laws of the symbolic search."""

from __future__ import annotations

import pytest

from robots.workcell import SIDES
from tamp.operators import ARTICULATED, INITIAL, applicable, solved, successor, to_pddl
from tamp.skeletons import Skeleton, roles_of, skeletons
from tamp.symbols import Atom

FOUND = list(skeletons())


def test_both_role_assignments_are_found_and_nothing_else_is_shorter() -> None:
    assert {roles_of(skeleton).assistant for skeleton in FOUND} == set(SIDES)
    assert [len(skeleton) for skeleton in FOUND] == sorted(len(skeleton) for skeleton in FOUND)


@pytest.mark.parametrize("skeleton", FOUND, ids=lambda s: str(s[0]))
def test_a_skeleton_replays_to_the_goal(skeleton: Skeleton) -> None:
    state = INITIAL
    for stage in skeleton:
        assert applicable(stage.operator, stage.arm, state)
        assert not solved(state)
        state = successor(stage.operator, stage.arm, state)
    assert solved(state)


@pytest.mark.parametrize("skeleton", FOUND, ids=lambda s: str(s[0]))
def test_an_arm_plays_one_role(skeleton: Skeleton) -> None:
    roles = roles_of(skeleton)
    assert roles.assistant != roles.primary
    assert all(stage.arm == getattr(roles, stage.operator.role) for stage in skeleton)


def test_a_second_hand_is_needed_to_operate() -> None:
    operate = next(operator for operator in ARTICULATED if operator.name == "operate")
    state = frozenset({Atom("free", "left"), Atom("exposed")})
    assert not applicable(operate, "left", state)
    assert applicable(operate, "left", state | {Atom("holds", "right")})


def test_without_an_operator_that_exposes_there_is_no_skeleton() -> None:
    rest = tuple(operator for operator in ARTICULATED if operator.name != "reorient")
    assert list(skeletons(rest)) == []


def test_an_unknown_predicate_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="no predicate flying; there are free"):
        Atom("flying")


def test_the_pddl_domain_is_balanced_and_names_every_operator() -> None:
    text = to_pddl()
    code = "\n".join(line.partition(";")[0] for line in text.splitlines())
    assert code.count("(") == code.count(")")
    assert all(f"(:action {operator.name}" in code for operator in ARTICULATED)
