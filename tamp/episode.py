"""How one episode runs from a request to a run folder: build, observe, propose, refine, save, execute, report."""

from __future__ import annotations

import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import msgspec
import numpy as np
import pinocchio as pin
from msgspec import Struct

from affordance.candidates import Proposer, SceneView
from affordance.heuristic import HeuristicProposer
from planners.collision import CollisionWorld
from planners.hulls import observed_hulls
from robots.cache import write_atomic
from robots.errors import BadInput, BadRunFolder, UnknownName
from robots.model import DualArm
from robots.spatial import pose
from robots.workcell import SIDES, Workcell, load_workcell
from tamp import plan as plan_file
from tamp import trace as trace_file
from tamp.execute import Camera, Checked, Outcome, execute
from tamp.plan import AssetReference, Operation, Plan, Role, StageName
from tamp.refine import Budget, Search, Solved, Unsolved, order
from tamp.skeletons import roles_of, skeletons
from tamp.stages import StageChecker
from tamp.timeline import Timeline
from tamp.trace import Failure, Trace, TraceStatus
from worlds import observe, scene
from worlds.assets import library
from worlds.assets.asset import Asset, Split
from worlds.bullet.world import BulletWorld
from worlds.labels import truth
from worlds.observe import Observation
from worlds.tasks import task_of

PROPOSERS = ("heuristic",)

MIN_POINTS = 50
"""Observed points with which planning begins."""

OUTCOME_FILE = "outcome.json"
OWN_FILES = (
    plan_file.PLAN_FILE,
    trace_file.TRACE_FILE,
    observe.OBSERVATION_FILE,
    OUTCOME_FILE,
    "plan.html",
    "execution.mp4",
    "execution.png",
)

Status = Literal["success", "planned", "no_plan", "execution_failed"]


class Request(Struct, frozen=True, kw_only=True):
    """What to plan."""

    category: str
    asset: str = "synthetic"
    """``synthetic`` or ``partnet:DIR``."""
    instance: str | None = None
    """Instance name; ``None`` lets the seed choose."""
    split: Split | None = None
    seed: int = 0
    proposer: str = "heuristic"
    workcell: str = "panda_pair"
    """Shipped name or TOML file."""
    execute: bool = True
    timeout: float = 60.0
    """Wall time for the search [s]."""
    out: Path | None = None
    """Run folder; ``None`` makes one under ``runs/``."""
    video: bool = False


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
    plan_seconds: float
    """Wall time from the observation to the saved plan [s]."""
    execute_seconds: float | None
    """Wall time of the execution [s]."""
    stages: list[StageReport]
    failure: Failure | None
    run_dir: str
    verdict: dict[str, Any] | None
    """The success criterion's numbers, when the execution reached its end."""
    checked: list[Checked]
    """What each stage's monitor said."""


class Watch(Protocol):
    """Something that shows progress."""

    def begin(self, phase: str) -> None:
        """A phase begins: ``world``, ``observe``, ``plan``, ``execute`` or ``write``."""

    def note(self, text: str) -> None:
        """Something worth a line happened."""


class Silent:
    """A watch that shows nothing."""

    def begin(self, phase: str) -> None:
        """Ignore it."""

    def note(self, text: str) -> None:
        """Ignore it."""


SILENT = Silent()


def plan_episode(request: Request, watch: Watch = SILENT) -> Report:
    """Plan one episode, execute it unless told not to, and write its run folder.

    An interruption keeps the trace of what was tried until then, and the plan if there was one.

    Raises:
        BadInput: Something in the request cannot be used; nothing has been written then.
    """
    task_of(request.category)
    if request.proposer not in PROPOSERS:
        raise UnknownName("proposer", request.proposer, PROPOSERS)
    if request.video:
        from tamp.view.video import require_video

        require_video()
    workcell = load_workcell(request.workcell)
    watch.begin("world")
    asset = _asset(request)
    with scene.build(workcell, asset, request.seed) as world:
        watch.begin("observe")
        observation = observe.observe(world)
        if (seen := len(observation.cloud)) < MIN_POINTS:
            raise BadInput(f"The cameras see {seen} points of {asset.instance}; {MIN_POINTS} are needed.")
        folder = prepared_folder(request, asset)
        observe.save(observation, folder)
        episode = _Episode(request, workcell, asset, observation, folder)
        try:
            episode.run(world, watch)
        except KeyboardInterrupt:
            episode.save_trace("interrupted")
            raise
    watch.begin("write")
    return episode.write()


@dataclass
class _Episode:
    """One episode in progress, so that whatever ends it can save what there is."""

    request: Request
    workcell: Workcell
    asset: Asset
    observation: Observation
    folder: Path
    plan: Plan | None = None
    search: Search | None = None
    unsolved: Unsolved | None = None
    outcome: Outcome | None = None
    plan_seconds: float = 0.0
    execute_seconds: float = 0.0

    def run(self, world: BulletWorld, watch: Watch) -> None:
        """Search, save the plan, execute it."""
        watch.begin("plan")
        arms, started = DualArm(self.workcell), time.perf_counter()
        T_world_object = pose(np.round(self.observation.cloud.mean(axis=0), 9))
        view = SceneView(self.workcell, self.observation.cloud, pin.SE3.Identity(), np.zeros((0, 3)))
        self.search = _search(self.request, view, arms, T_world_object, self._proposer(world))
        first = self.search.proposer.goal(view, np.random.default_rng(self.request.seed))
        result = self.search.run(order(skeletons(), view, first[0] if first else None))
        if isinstance(result, Solved):
            self.plan = _as_plan(self.request, self.workcell, self.asset, self.observation, T_world_object, result)
            plan_file.save(self.plan, self.folder)
        else:
            self.unsolved = result
        self.plan_seconds = time.perf_counter() - started
        if self.plan is not None and self.request.execute:
            watch.begin("execute")
            started = time.perf_counter()
            self.outcome = _execute(self.plan, world, arms, self.folder, self.request.video)
            self.execute_seconds = time.perf_counter() - started

    def _proposer(self, world: BulletWorld) -> Proposer:
        """The proposer asked for; only the heuristic one may look at the world."""
        return HeuristicProposer(truth(world, self.observation), self.workcell.arm("left").gripper)

    def save_trace(self, status: TraceStatus) -> Trace:
        """Write what was tried until now."""
        tried = [] if self.search is None else self.search.tried
        trace = Trace(
            category=self.asset.category,
            instance=self.asset.instance,
            seed=self.request.seed,
            proposer=self.request.proposer,
            skeletons=[[str(stage) for stage in skeleton] for skeleton in tried],
            rejections=[] if self.search is None else self.search.rejections,
            chosen=len(tried) - 1 if self.plan is not None else None,
            plan_seconds=round(self.plan_seconds, 3),
            status=status,
            failure=self.failure() if status != "interrupted" else None,
        )
        trace_file.save(trace, self.folder)
        return trace

    def failure(self) -> Failure | None:
        """Why it was not solved."""
        if self.plan is not None:
            return None if self.outcome is None else self.outcome.failure
        rejections = [] if self.search is None else self.search.rejections
        if not rejections:
            limit = self.request.timeout
            return Failure(stage="pregrasp", reason="budget", detail=f"no candidate was finished within {limit:g} s")
        found = trace_file.dominant(rejections)
        if self.unsolved is not None and self.unsolved.timed_out:
            late = f"{found.detail} (the search ended at its limit of {self.request.timeout:g} s)"
            return Failure(stage=found.stage, reason=found.reason, detail=late)
        return found

    def write(self) -> Report:
        """Write the rest of the run folder and report."""
        trace = self.save_trace(_status(self.plan, self.outcome))
        if self.plan is not None:
            from tamp.view.html import write_html

            write_html(self.plan, self.observation.cloud, self.observation.colours, self.folder, trace)
        report = _report(
            self.plan,
            self.outcome,
            trace.failure,
            self.asset,
            self.request.seed,
            self.request.proposer,
            self.plan_seconds,
            self.execute_seconds,
            self.folder,
        )
        write_atomic(self.folder / OUTCOME_FILE, msgspec.json.format(msgspec.json.encode(report), indent=1))
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
        watch.begin("execute")
        executing = time.perf_counter()
        outcome = _execute(plan, world, DualArm(plan.workcell), folder, video)
        spent = time.perf_counter() - executing
    planned = trace_file.load(folder).plan_seconds if (folder / trace_file.TRACE_FILE).is_file() else 0.0
    return _report(plan, outcome, outcome.failure, asset, plan.seed, plan.proposer, planned, spent, folder)


def prepared_folder(request: Request, asset: Asset) -> Path:
    """The run folder, empty of an earlier run's files.

    Raises:
        BadRunFolder: The path is a file, or a folder that holds something else.
    """
    source = asset.source.partition(":")[0]
    default = Path("runs") / f"{asset.category}-{source}-{asset.instance}-seed{request.seed}"
    folder = request.out or default
    if folder.exists() and not folder.is_dir():
        raise BadRunFolder(f"--out {folder} is a file; give a folder.")
    foreign = sorted(entry.name for entry in folder.iterdir() if entry.name not in OWN_FILES) if folder.is_dir() else []
    if foreign:
        raise BadRunFolder(f"--out {folder} holds files of something else ({foreign[0]}); give a new or empty folder.")
    try:
        if folder.is_dir():
            shutil.rmtree(folder)
        folder.mkdir(parents=True)
    except OSError as error:
        raise BadRunFolder(f"Run folder {folder} cannot be made: {error.strerror}.") from error
    return folder


def _asset(request: Request) -> Asset:
    if request.instance is None:
        return library.choose(request.asset, request.category, request.split, request.seed)
    return library.load(request.asset, request.category, request.instance)


def _search(request: Request, view: SceneView, arms: DualArm, T_world_object: pin.SE3, proposer: Proposer) -> Search:
    """A search that knows the observation, the workcell and what the proposer says, and nothing else."""
    workcell, collisions = view.workcell, CollisionWorld(view.workcell)
    hulls = observed_hulls(view.cloud, workcell.table.top)
    collisions.set_object([hull - T_world_object.translation for hull in hulls])
    checker = StageChecker(workcell, arms, collisions, view.cloud - T_world_object.translation, T_world_object)
    timeline = Timeline(workcell, arms, checker)
    return Search(workcell, proposer, checker, timeline, view, request.seed, Budget(seconds=request.timeout))


def _as_plan(
    request: Request,
    workcell: Workcell,
    asset: Asset,
    observation: Observation,
    T_world_object: pin.SE3,
    solved: Solved,
) -> Plan:
    roles = roles_of(solved.skeleton)
    return Plan(
        asset=AssetReference(
            source=asset.source,
            category=asset.category,
            instance=asset.instance,
            split=asset.split,
            content_hash=asset.content_hash,
        ),
        instruction=task_of(asset.category).instruction,
        seed=request.seed,
        proposer=request.proposer,
        workcell=workcell,
        packages=plan_file.package_versions(),
        observation_hash=observation.digest,
        assistant=roles.assistant,
        primary=roles.primary,
        operation=Operation(kind=solved.goal.kind, amount=solved.goal.amount),
        start={side: list(workcell.placement(side).home) for side in SIDES},
        start_opening=workcell.arm("left").gripper.finger_travel,
        T_world_object=plan_file.matrix(T_world_object),
        skeleton=[str(stage) for stage in solved.skeleton],
        stages=solved.stages.stages,
    )


def _execute(plan: Plan, world: BulletWorld, arms: DualArm, folder: Path, video: bool) -> Outcome:
    task = task_of(plan.asset.category)
    if not video:
        return execute(plan, world, arms, task)
    from tamp.view.video import Recorder

    with Recorder(world, folder / "execution.mp4") as recorder:
        camera: Camera = recorder
        return execute(plan, world, arms, task, camera)


def _status(plan: Plan | None, outcome: Outcome | None) -> Status:
    if plan is None:
        return "no_plan"
    if outcome is None:
        return "planned"
    return "success" if outcome.success else "execution_failed"


def _report(
    plan: Plan | None,
    outcome: Outcome | None,
    failure: Failure | None,
    asset: Asset,
    seed: int,
    proposer: str,
    seconds: float,
    spent: float,
    folder: Path,
) -> Report:
    stages = [] if plan is None else plan.stages
    return Report(
        status=_status(plan, outcome),
        success=bool(outcome and outcome.success),
        category=asset.category,
        instance=asset.instance,
        seed=seed,
        proposer=proposer,
        plan_seconds=round(seconds, 3),
        execute_seconds=None if outcome is None else round(spent, 3),
        stages=[
            StageReport(
                name=s.name, arm=s.arm, role=s.role, duration=round(s.duration, 3), candidates_tried=s.candidates_tried
            )
            for s in stages
        ],
        failure=failure,
        run_dir=str(folder),
        verdict=None if outcome is None or outcome.verdict is None else msgspec.to_builtins(outcome.verdict),
        checked=[] if outcome is None else list(outcome.checked),
    )
