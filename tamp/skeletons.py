"""Which sequences of stages reach the symbolic goal, cheapest first."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count

from affordance.candidates import Roles
from robots.workcell import SIDES, Side, other
from tamp.operators import INITIAL, OPERATORS, Operator, applicable, solved, successor, times
from tamp.plan import Role
from tamp.symbols import State
from worlds.tasks import TaskType


@dataclass(frozen=True, slots=True)
class BoundStage:
    """An operator bound to an arm."""

    operator: Operator
    arm: Side

    def __str__(self) -> str:
        return f"{self.operator.name}({self.arm})"


Skeleton = tuple[BoundStage, ...]


def skeletons(
    task: TaskType = "articulated",
    initial: State = INITIAL,
    *,
    operators: tuple[Operator, ...] | None = None,
    longest: int = 10,
    repeats: int = 1,
) -> Iterator[Skeleton]:
    """Every sequence of at most ``longest`` stages to the goal that visits no state twice, shortest first.

    Uniform-cost forward search over paths (Russell and Norvig, "Artificial Intelligence", section 3.4.2); equal costs
    come in the order of operators and arms. Each role is played by one arm throughout.

    Args:
        task: Whose operators and goal.
        initial: Where the search begins.
        operators: Instead of the task's own.
        longest: Most stages.
        repeats: How often a stage that counts itself may run.
    """
    number = count()
    known = OPERATORS[task] if operators is None else operators
    queue: list[tuple[int, int, State, Skeleton, frozenset[State]]] = [
        (0, next(number), initial, (), frozenset({initial}))
    ]
    while queue:
        cost, _, state, stages, visited = heapq.heappop(queue)
        if solved(task, state):
            yield stages
            continue
        if cost == longest:
            continue
        for operator in known:
            for arm in SIDES:
                if not applicable(operator, arm, state) or not _one_arm_a_role(stages, operator, arm):
                    continue
                if operator.counts and times(operator.counts, state) >= repeats:
                    continue
                after = successor(operator, arm, state)
                if after not in visited:
                    bound = (*stages, BoundStage(operator, arm))
                    heapq.heappush(queue, (cost + 1, next(number), after, bound, visited | {after}))


def _one_arm_a_role(stages: Skeleton, operator: Operator, arm: Side) -> bool:
    """Whether ``arm`` may play the operator's role after ``stages``."""
    return all((stage.arm == arm) == (stage.operator.role == operator.role) for stage in stages)


def roles_of(skeleton: Skeleton) -> Roles:
    """Which arm plays which role in a skeleton; where only one role is played, the other arm has the other."""
    played: dict[Role, Side] = {stage.operator.role: stage.arm for stage in skeleton}
    assistant = played["assistant"] if "assistant" in played else other(played["primary"])
    return Roles(assistant=assistant, primary=played.get("primary", other(assistant)))
