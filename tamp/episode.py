"""How one episode runs from a request to a run folder: build, observe, search, save, execute, report."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import msgspec
from msgspec import Struct

from affordance.candidates import Proposer
from affordance.variants import VARIANTS
from robots.cache import write_atomic
from robots.errors import BadInput, BadRunFolder
from robots.model import DualArm
from robots.spatial import from_list
from robots.workcell import Workcell, load_workcell
from tamp import folder as run_folder
from tamp import plan as plan_file
from tamp import trace as trace_file
from tamp.deploy import closed_loop
from tamp.drive import Camera
from tamp.execute import Moment, Outcome, execute
from tamp.folder import OUTCOME_FILE
from tamp.monitors import Checked
from tamp.plan import Plan, Role, StageName
from tamp.proposers import check_proposer, proposer_of
from tamp.refine import ONE_SHOT, Budget
from tamp.rounds import SILENT, Round, Subject, Watch, ready_cell
from tamp.trace import Failure, TraceStatus
from worlds import observe, scene
from worlds.assets import library
from worlds.assets.asset import Asset, Split
from worlds.bullet.world import BulletWorld
from worlds.observe import Observation
from worlds.tasks import Task, task_of

MIN_POINTS = 50
"""Observed points with which planning begins."""

Status = Literal["success", "planned", "no_plan", "execution_failed"]

Mode = Literal["E1", "E2", "E3"]
"""E1: the best candidate of each stage and no other (the paper's deployment rule). E2: resampling. E3: closed loop."""


class Request(Struct, frozen=True, kw_only=True):
    """What to plan."""

    category: str
    asset: str = "synthetic"
    """``synthetic``, ``partnet:DIR`` or ``mesh:DIR``."""
    instance: str | None = None
    """Instance name; ``None`` lets the seed choose."""
    split: Split | None = None
    seed: int = 0
    proposer: str = "heuristic"
    weights: Path | None = None
    """Weights of a learned proposer; ``None`` for those that are shipped."""
    workcell: str = "panda_pair"
    """Shipped name or TOML file."""
    execute: bool = True
    mode: Mode = "E2"
    overlap: bool = True
    """Whether one arm may already move to where it acts next while the other still acts."""
    max_pushes: int = 3
    """How often the object may be pushed."""
    timeout: float = 60.0
    """Wall time for the search [s]."""
    out: Path | None = None
    """Run folder; ``None`` makes one under ``runs/``."""
    video: bool = False
    page: bool = True
    """Whether ``plan.html`` is written."""


class StageReport(Struct, frozen=True, kw_only=True):
    """A stage in a report."""

    name: StageName
    arm: str
    role: Role
    duration: float
    """[s]"""
    candidates_tried: int


class Report(Struct, frozen=True, kw_only=True):
    """How an episode went; the JSON object of ``bipre plan`` and ``bipre run``."""

    status: Status
    success: bool
    category: str
    instance: str
    seed: int
    proposer: str
    mode: Mode
    plan_seconds: float
    """Wall time from the observation to the saved plan, over all rounds [s]."""
    execute_seconds: float | None
    """Wall time of the execution [s]."""
    rounds: int
    """How often it looked and planned."""
    stages: list[StageReport]
    failure: Failure | None
    run_dir: str
    verdict: dict[str, Any] | None
    """The success criterion's numbers, when the execution reached its end."""
    checked: list[Checked]
    """What each stage's monitor said."""


@dataclass
class Episode:
    """An episode in progress, and what is known of it at its end.

    Attributes:
        request: What was asked for.
        task: The column.
        asset: The object.
        folder: The run folder.
        rounds: One for each time it looked.
        outcome: How the last execution went.
    """

    request: Request
    task: Task
    asset: Asset
    folder: Path
    rounds: list[Round] = field(default_factory=list)
    outcome: Outcome | None = None
    plan_seconds: float = 0.0
    execute_seconds: float = 0.0

    @property
    def last(self) -> Round:
        """The latest round."""
        return self.rounds[-1]

    def failure(self) -> Failure | None:
        """Why it was not solved."""
        if self.last.plan is None:
            return self.last.no_plan()
        return None if self.outcome is None else self.outcome.failure

    def status(self) -> Status:
        """How it ended."""
        if self.last.plan is None:
            return "no_plan"
        if self.outcome is None:
            return "planned"
        return "success" if self.outcome.success else "execution_failed"

    def save_trace(self, status: TraceStatus) -> None:
        """Write what was tried until now."""
        if self.rounds:
            failure = None if status == "interrupted" else self.failure()
            self.last.save_trace(status, self.plan_seconds, failure)

    def report(self) -> Report:
        """The report of the present state."""
        return _report(
            self.last.plan,
            self.outcome,
            self.failure(),
            self.request,
            self.asset.instance,
            self.plan_seconds,
            self.execute_seconds,
            len(self.rounds),
            self.folder,
        )


def plan_episode(request: Request, watch: Watch = SILENT) -> Report:
    """Plan one episode, execute it unless told not to, and write its run folder.

    An interruption keeps the trace of what was tried until then, and the plan if there was one.

    Raises:
        BadInput: Something in the request cannot be used; nothing has been written then.
    """
    with opened(request, watch) as (episode, world, subject):
        try:
            run(episode, world, subject, watch)
        except KeyboardInterrupt:
            episode.save_trace("interrupted")
            raise
    watch.begin("write")
    return write(episode)


@contextmanager
def opened(request: Request, watch: Watch = SILENT) -> Iterator[tuple[Episode, BulletWorld, Subject]]:
    """The world of an episode and an empty run folder, after everything in the request was found usable."""
    task = _checked(request)
    workcell = load_workcell(request.workcell)
    if task.type == "handover" and workcell.human is None:
        raise BadInput(f"{task.category} needs a workcell with a [human] table; {workcell.name} has none.")
    watch.begin("world")
    asset = _asset(request, task)
    subject = subject_of(request, task, workcell, asset)
    with scene.build(workcell, asset, request.seed) as world:
        watch.begin("observe")
        observation = looked(world)
        source = asset.source.partition(":")[0]
        name = f"{request.category}-{source}-{asset.instance}-seed{request.seed}"
        folder = run_folder.prepared(request.out, name)
        observe.save(observation, folder)
        episode = Episode(request, task, asset, folder)
        episode.rounds.append(Round(subject, observation, folder))
        yield episode, world, subject


def subject_of(request: Request, task: Task, workcell: Workcell, asset: Asset) -> Subject:
    """What an episode is about."""
    budget = ONE_SHOT if request.mode == "E1" else Budget()
    budget = replace(budget, seconds=request.timeout)
    arms, pushes = DualArm(workcell), 1 if request.mode == "E1" else request.max_pushes
    cell = ready_cell(workcell, arms)
    alone = request.proposer in VARIANTS and not VARIANTS[request.proposer].prepares
    return Subject(
        task, workcell, arms, asset, request.seed, request.proposer, budget, pushes, request.overlap, alone, cell
    )


def run(
    episode: Episode, world: BulletWorld, subject: Subject, watch: Watch = SILENT, moment: Moment | None = None
) -> None:
    """Search, save the plan, execute it; in a closed loop, look again and go on."""
    request, first = episode.request, episode.last

    def proposer(observation: Observation) -> Proposer:
        return proposer_of(request.proposer, subject.task, subject.workcell, world, observation, request.weights)

    watch.begin("plan")
    started = time.perf_counter()
    first.seek(proposer(first.observation))
    episode.plan_seconds = time.perf_counter() - started
    if first.plan is None or not request.execute:
        return
    watch.begin("execute")
    started = time.perf_counter()
    with _recorder(world, episode.folder / "execution.mp4", request.video) as camera:
        if request.mode == "E3":
            spent = closed_loop(episode.rounds, world, proposer, looked_again, watch, camera)
            episode.outcome, episode.plan_seconds = spent.outcome, episode.plan_seconds + spent.plan_seconds
            started += spent.plan_seconds
        else:
            episode.outcome = execute(first.plan, world, subject.arms, subject.task, camera, moment=moment)
    episode.execute_seconds = time.perf_counter() - started


def looked(world: BulletWorld) -> Observation:
    """An observation with enough points to plan with; ``BadInput`` when there are too few."""
    observation = looked_again(world)
    if observation is None:
        raise BadInput(f"The cameras see too little of {world.asset.instance}: {MIN_POINTS} points are needed.")
    return observation


def looked_again(world: BulletWorld) -> Observation | None:
    """An observation, or ``None`` when it has too few points to plan with: what fell off the table is out of view."""
    observation = observe.observe(world)
    return observation if len(observation.cloud) >= MIN_POINTS else None


def write(episode: Episode) -> Report:
    """Write the rest of the run folder and report."""
    episode.save_trace(episode.status())
    last = episode.last
    if last.plan is not None and episode.request.page:
        from tamp.view.html import write_html

        trace = trace_file.load(last.folder)
        write_html(last.plan, last.observation.cloud, last.observation.colours, last.folder, trace)
    report = episode.report()
    write_atomic(episode.folder / OUTCOME_FILE, msgspec.json.format(msgspec.json.encode(report), indent=1))
    return report


def run_again(folder: Path, *, video: bool = False, watch: Watch = SILENT) -> Report:
    """Execute a saved plan in a freshly built world.

    Raises:
        BadRunFolder: The plan cannot be read, or its object is no longer what it was.
    """
    plan = plan_file.load(folder)
    watch.begin("world")
    asset = library.load(plan.asset.source, plan.asset.category, plan.asset.instance)
    if asset.content_hash != plan.asset.content_hash:
        raise BadRunFolder(
            f"{folder}: {plan.asset.instance} has changed since the plan was made "
            f"({plan.asset.content_hash} then, {asset.content_hash} now). Plan again."
        )
    with scene.build(plan.workcell, asset, plan.seed) as world:
        if plan.T_world_body is not None:
            world.put_object(from_list(plan.T_world_body))
        watch.begin("execute")
        executing = time.perf_counter()
        with _recorder(world, folder / "execution.mp4", video) as camera:
            outcome = execute(plan, world, DualArm(plan.workcell), task_of(plan.category), camera)
        spent = time.perf_counter() - executing
    planned = trace_file.load(folder).plan_seconds if (folder / trace_file.TRACE_FILE).is_file() else 0.0
    request = Request(category=plan.category, seed=plan.seed, proposer=plan.proposer)
    return _report(plan, outcome, outcome.failure, request, asset.instance, planned, spent, 1, folder)


def _checked(request: Request) -> Task:
    """The task, after refusing what cannot work."""
    task = task_of(request.category)
    check_proposer(request.proposer, request.weights)
    if task.type == "handover" and request.proposer in VARIANTS and not VARIANTS[request.proposer].prepares:
        raise BadInput(f"{task.category} is what an assistant does; the proposer {request.proposer} has none.")
    if request.max_pushes < 1:
        raise BadInput(f"--max-pushes {request.max_pushes} is too few; give 1 or more.")
    if request.video:
        from tamp.view.video import require_video

        require_video()
    return task


def _asset(request: Request, task: Task) -> Asset:
    if request.instance is None:
        return library.choose(request.asset, task.objects, request.split, request.seed)
    return library.load(request.asset, task.objects, request.instance)


@contextmanager
def _recorder(world: BulletWorld, path: Path, video: bool) -> Iterator[Camera | None]:
    if not video:
        yield None
        return
    from tamp.view.video import Recorder

    with Recorder(world, path) as recorder:
        yield recorder


def _report(
    plan: Plan | None,
    outcome: Outcome | None,
    failure: Failure | None,
    request: Request,
    instance: str,
    seconds: float,
    spent: float,
    rounds: int,
    folder: Path,
) -> Report:
    status: Status = "no_plan"
    if plan is not None:
        status = "planned" if outcome is None else "success" if outcome.success else "execution_failed"
    return Report(
        status=status,
        success=bool(outcome and outcome.success),
        category=request.category,
        instance=instance,
        seed=request.seed,
        proposer=request.proposer,
        mode=request.mode,
        plan_seconds=round(seconds, 3),
        execute_seconds=None if outcome is None else round(spent, 3),
        rounds=rounds,
        stages=[
            StageReport(
                name=s.name, arm=s.arm, role=s.role, duration=round(s.duration, 3), candidates_tried=s.candidates_tried
            )
            for s in ([] if plan is None else plan.stages)
        ],
        failure=failure,
        run_dir=str(folder),
        verdict=None if outcome is None or outcome.verdict is None else msgspec.to_builtins(outcome.verdict),
        checked=[] if outcome is None else list(outcome.checked),
    )
