"""How one episode runs from a request to a run folder: build, observe, propose, refine, save, execute, report."""

from __future__ import annotations

import shutil
import time
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
from tamp.trace import Failure, Trace
from worlds import observe, scene
from worlds.assets import library
from worlds.assets.asset import Asset, Split
from worlds.bullet.world import BulletWorld
from worlds.labels import truth
from worlds.observe import Observation
from worlds.tasks import task_of

PROPOSERS = ("heuristic",)
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


def plan_episode(request: Request, watch: Watch) -> Report:
    """Plan one episode, execute it unless told not to, and write its run folder.

    Raises:
        BadInput: Something in the request cannot be used; nothing has been written then.
    """
    task = task_of(request.category)
    if request.proposer not in PROPOSERS:
        raise UnknownName("proposer", request.proposer, PROPOSERS)
    workcell = load_workcell(request.workcell)
    watch.begin("world")
    asset = _asset(request)
    with scene.build(workcell, asset, request.seed) as world:
        folder = prepared_folder(request, asset)
        watch.begin("observe")
        observation = observe.observe(world)
        observe.save(observation, folder)
        watch.begin("plan")
        arms = DualArm(workcell)
        started = time.perf_counter()
        plan, search, unsolved = _plan(request, workcell, asset, world, observation, arms)
        if plan is not None:
            plan_file.save(plan, folder)
        seconds = time.perf_counter() - started
        outcome: Outcome | None = None
        executing = time.perf_counter()
        if plan is not None and request.execute:
            watch.begin("execute")
            outcome = _execute(plan, world, arms, folder, request.video)
        spent = time.perf_counter() - executing
    watch.begin("write")
    failure = _failure(search, unsolved, request.timeout) if plan is None else (outcome.failure if outcome else None)
    trace = Trace(
        category=task.category,
        instance=asset.instance,
        seed=request.seed,
        proposer=request.proposer,
        skeletons=[[str(stage) for stage in skeleton] for skeleton in search.tried],
        rejections=search.rejections,
        chosen=len(search.tried) - 1 if plan is not None else None,
        plan_seconds=round(seconds, 3),
        status=_status(plan, outcome),
        failure=failure,
    )
    trace_file.save(trace, folder)
    if plan is not None:
        from tamp.view.html import write_html

        write_html(plan, observation.cloud, observation.colours, folder, trace)
    report = _report(plan, outcome, failure, asset, request.seed, request.proposer, seconds, spent, folder)
    write_atomic(folder / OUTCOME_FILE, msgspec.json.format(msgspec.json.encode(report), indent=1))
    return report


def run_again(folder: Path, *, video: bool, watch: Watch) -> Report:
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
    if folder.is_dir():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    return folder


def _asset(request: Request) -> Asset:
    if request.instance is None:
        return library.choose(request.asset, request.category, request.split, request.seed)
    return library.load(request.asset, request.category, request.instance)


def _plan(
    request: Request, workcell: Workcell, asset: Asset, world: BulletWorld, observation: Observation, arms: DualArm
) -> tuple[Plan | None, Search, Unsolved | None]:
    """Search for a plan from the observation; only the proposer may look at the world."""
    if len(observation.cloud) < 50:
        raise BadInput(f"The cameras see {len(observation.cloud)} points of {asset.instance}; 50 are needed.")
    T_world_object = pose(np.round(observation.cloud.mean(axis=0), 9))
    cloud = observation.cloud - T_world_object.translation
    collisions = CollisionWorld(workcell)
    collisions.set_object(
        [hull - T_world_object.translation for hull in observed_hulls(observation.cloud, workcell.table.top)]
    )
    proposer = _proposer(request, workcell, world, observation)
    checker = StageChecker(workcell, arms, collisions, cloud, T_world_object)
    view = SceneView(workcell, observation.cloud, pin.SE3.Identity(), np.zeros((0, 3)))
    search = Search(
        workcell,
        proposer,
        checker,
        Timeline(workcell, arms, checker),
        view,
        request.seed,
        Budget(seconds=request.timeout),
    )
    first = proposer.goal(view, np.random.default_rng(request.seed))
    result = search.run(order(skeletons(), view, first[0] if first else None))
    if isinstance(result, Unsolved):
        return None, search, result
    return _as_plan(request, workcell, asset, observation, T_world_object, result), search, None


def _proposer(request: Request, workcell: Workcell, world: BulletWorld, observation: Observation) -> Proposer:
    return HeuristicProposer(truth(world, observation), workcell.arm("left").gripper)


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


def _failure(search: Search, unsolved: Unsolved | None, timeout: float) -> Failure:
    if unsolved is not None and unsolved.timed_out and not search.rejections:
        return Failure(stage="pregrasp", reason="budget", detail=f"no candidate was finished within {timeout:g} s")
    return trace_file.dominant(search.rejections)


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
