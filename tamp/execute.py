"""What happens when a plan runs: stage after stage, each watched and checked, the end judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from robots.errors import SimulationDiverged
from robots.model import DualArm
from tamp.drive import Camera, Drive
from tamp.monitors import Checked, Monitors
from tamp.plan import Plan
from tamp.trace import Failure
from worlds.bullet.world import BulletWorld
from worlds.success import AnyVerdict
from worlds.tasks import Task


@dataclass(frozen=True, slots=True)
class Outcome:
    """How an execution went.

    Attributes:
        success: The paper's criterion, judged at the end.
        verdict: The judgement; ``None`` when a stage failed before the end.
        checked: The monitors' verdicts, one a stage.
        failure: Why it ended early or was not a success.
        seconds: Simulated time [s].
    """

    success: bool
    verdict: AnyVerdict | None
    checked: tuple[Checked, ...]
    failure: Failure | None
    seconds: float


Moment = Callable[[str], None]
"""Called when a stage has ended, with its name."""


def execute(
    plan: Plan,
    world: BulletWorld,
    arms: DualArm,
    task: Task,
    camera: Camera | None = None,
    *,
    until: int | None = None,
    moment: Moment | None = None,
) -> Outcome:
    """Run the stages in the simulated world, which must stand as it was observed, and judge the end.

    Args:
        plan: What to run.
        world: The world, moved by this.
        arms: Kinematics of both arms.
        task: The limits.
        camera: Records meanwhile.
        until: Run only so many stages; the outcome then has no verdict, and ``success`` says whether all monitors
            agreed.
        moment: Called after each stage.
    """
    return Execution(plan, world, arms, task, camera).run(until, moment)


class Execution:
    """One execution in progress: stages forward, and back when something must be tried again."""

    def __init__(self, plan: Plan, world: BulletWorld, arms: DualArm, task: Task, camera: Camera | None) -> None:
        self.plan, self.world = plan, world
        self.monitors = Monitors(plan, world, arms, task)
        self.drive = self.monitors.drive = Drive(plan, world, arms, camera, self.monitors.watch)
        self.checked: list[Checked] = []

    def run(self, until: int | None = None, moment: Moment | None = None) -> Outcome:
        """As ``execute``."""
        try:
            return self._stages(len(self.plan.stages) if until is None else until, moment)
        except SimulationDiverged as error:
            failure = Failure(stage=self.monitors.stage.name, reason="diverged", detail=str(error))
            return Outcome(False, None, tuple(self.checked), failure, self.world.time)

    def undo(self) -> None:
        """Go back the way everything came; see ``Drive.undo``."""
        self.drive.undo()

    def retreat(self) -> None:
        """Do the stage after the last one that was checked, whatever its monitor said."""
        self.drive.retreat(self.plan.stages[len(self.checked)])

    def _stages(self, count: int, moment: Moment | None) -> Outcome:
        """The first ``count`` stages; all of them are judged."""
        for stage in self.plan.stages[:count]:
            self.monitors.begin(stage)
            self.drive.do(stage)
            said, cause = self.monitors.check(stage)
            self.checked.append(said)
            if moment is not None:
                moment(stage.name)
            if not said.true:
                failure = Failure(stage=stage.name, reason=cause, detail=said.detail)
                return Outcome(False, None, tuple(self.checked), failure, self.world.time)
        if count < len(self.plan.stages):
            return Outcome(True, None, tuple(self.checked), None, self.world.time)
        verdict, cause = self.monitors.judge()
        last = self.plan.stages[-1].name
        lost = None if verdict.success else Failure(stage=last, reason=cause, detail=verdict.reason)
        return Outcome(verdict.success, verdict, tuple(self.checked), lost, self.world.time)
