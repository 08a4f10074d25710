"""How a closed loop runs: execute until something must be seen, look again, and plan from what is seen."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from affordance.candidates import Proposer
from affordance.maps import MAPS_FILE
from robots.workcell import Workcell
from tamp import plan as plan_file
from tamp import trace as trace_file
from tamp.drive import Camera
from tamp.execute import Execution, Outcome
from tamp.folder import EARLIER
from tamp.operators import INITIAL
from tamp.plan import Plan
from tamp.rounds import Round, Watch
from tamp.symbols import Atom, State
from tamp.trace import Cause
from worlds import observe
from worlds.bullet.world import BulletWorld
from worlds.observe import Observation
from worlds.tasks import Task

MOST_ROUNDS = 6
"""How often it looks and plans at the most."""

HOPELESS: frozenset[Cause] = frozenset({"fell", "diverged"})
"""Failures after which nothing is tried again."""

IN_VAIN: frozenset[Cause] = frozenset({"not_moved", "force"})
"""Failures of the goal action that speak for another kind of it: a cap that cannot be pulled off may be unscrewed."""


@dataclass(frozen=True, slots=True)
class Spent:
    """How a closed loop went.

    Attributes:
        outcome: Of the last execution.
        plan_seconds: Wall time spent looking and planning again [s].
    """

    outcome: Outcome
    plan_seconds: float


def closed_loop(
    rounds: list[Round],
    world: BulletWorld,
    propose: Callable[[Observation], Proposer],
    look: Callable[[BulletWorld], Observation | None],
    watch: Watch,
    camera: Camera | None,
) -> Spent:
    """Execute the plan of the last round, look again after a push and after a failure, plan again, and so on.

    Args:
        rounds: The first round with its plan; grows.
        world: The world as it was observed.
        propose: A proposer for an observation.
        look: An observation of the world, both arms waiting; ``None`` when too little is in view.
        watch: Shows progress.
        camera: Records meanwhile.
    """
    spent, pushes = 0.0, 0
    while True:
        current = rounds[-1]
        subject, plan = current.subject, current.plan
        if plan is None:
            raise ValueError("a round without a plan cannot be executed")
        execution = Execution(plan, world, subject.arms, subject.task, camera)
        outcome = execution.run(_until(plan))
        pushes += sum(check.stage == "push" for check in outcome.checked)
        finished = outcome.verdict is not None and outcome.success
        hopeless = outcome.failure is not None and outcome.failure.reason in HOPELESS
        if finished or hopeless or len(rounds) == MOST_ROUNDS:
            return Spent(outcome, spent)
        if outcome.failure is not None:
            watch.note(f"{outcome.failure.stage} failed ({outcome.failure.reason}): looking again")
            execution.retreat() if outcome.failure.stage == "push" else execution.undo()
        started = time.perf_counter()
        following = _next_round(current, outcome, world, look)
        if following is None:
            return Spent(outcome, spent)
        initial = seen_state(subject.workcell, subject.task, following.observation, pushes)
        following.seek(propose(following.observation), initial, world.object_pose())
        spent += time.perf_counter() - started
        if following.plan is None:
            rounds.append(following)
            return Spent(outcome, spent)
        rounds.append(following)


def _until(plan: Plan) -> int | None:
    """How many stages to run before looking again: all, unless the object is pushed first."""
    names = [stage.name for stage in plan.stages]
    return names.index("retreat") + 1 if "push" in names else None


def _next_round(
    current: Round, outcome: Outcome, world: BulletWorld, look: Callable[[BulletWorld], Observation | None]
) -> Round | None:
    """A round on a new observation, the files of the one before moved aside; ``None`` when too little is in view."""
    observation = look(world)
    if observation is None:
        return None
    current.save_trace("success" if outcome.success else "execution_failed", 0.0, outcome.failure)
    aside = current.folder / f"{EARLIER}{current.number}"
    aside.mkdir(exist_ok=True)
    for name in (plan_file.PLAN_FILE, trace_file.TRACE_FILE, observe.OBSERVATION_FILE, MAPS_FILE):
        if (current.folder / name).is_file():
            shutil.move(current.folder / name, aside / name)
    observe.save(observation, current.folder)
    failed = current.failed
    fault = outcome.failure
    if current.plan is not None and fault is not None and fault.stage == "operate" and fault.reason in IN_VAIN:
        failed = (*failed, current.plan.operation.kind)
    return Round(current.subject, observation, current.folder, current.number + 1, failed)


def seen_state(workcell: Workcell, task: Task, observation: Observation, pushes: int) -> State:
    """What is true at the beginning of a round, from the observation alone; both arms wait at home."""
    state = set(INITIAL)
    if task.type == "edge_push":
        low, high = task.overhang
        if low <= reach_over(workcell, observation) <= high:
            state.add(Atom("overhanging"))
        if pushes:
            state.add(Atom("pushed", None, pushes))
    return frozenset(state)


def reach_over(workcell: Workcell, observation: Observation) -> float:
    """How far the seen points reach over the table's edges [m]; negative while they lie inside."""
    table = workcell.table
    beyond = np.abs(observation.cloud[:, :2] - np.asarray(table.centre)) - np.asarray(table.size) / 2
    return float(beyond.max())
