"""What a plan is on disk: a versioned, self-contained file that can be checked and executed without the planner."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
import pinocchio as pin
from msgspec import Meta, Struct

from robots.cache import write_atomic
from robots.errors import BadRunFolder
from robots.spatial import from_list, to_list
from robots.trajectory import Trajectory
from robots.workcell import Side, Workcell
from worlds.tasks import TaskType

PLAN_FORMAT = "bipremanip-plan"
PLAN_VERSION = 2
PLAN_FILE = "plan.json"
PACKAGES = ("pybullet", "ompl", "pin", "coal", "toppra", "numpy", "scipy", "trimesh")

StageName = Literal[
    "pregrasp", "lift", "reorient", "push", "press", "operate", "grasp", "present", "release", "retreat"
]  # fmt: skip
Role = Literal["assistant", "primary"]
Template = Literal[
    "free", "approach", "lift", "pull", "twist", "flip", "press", "descend", "drag", "retreat"
]  # fmt: skip
"""How a motion was made: ``free`` by sampling, ``twist`` and ``flip`` about a line, the others on a straight line."""

Pair = tuple[str, str]
"""Two names that may touch, for example ``("left/panda_leftfinger", "object")``; order means nothing."""

Matrix = Annotated[list[Annotated[list[float], Meta(min_length=4, max_length=4)]], Meta(min_length=4, max_length=4)]
Row7 = Annotated[list[float], Meta(min_length=7, max_length=7)]


class Saved(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of everything in a plan file: immutable, and strict about unknown keys."""


class Meanwhile(Saved, frozen=True, kw_only=True):
    """The other arm on its way to where it acts next, while the stage's arm acts.

    A way that takes longer than a step goes on in the next one, where this one ends.
    """

    arm: Side
    begin: float
    """When in the step it begins [s]."""
    times: list[float]
    """Knot times from there [s], from 0."""
    positions: list[Row7]
    """Knot joint positions [rad]."""
    velocities: list[Row7]
    """Knot joint velocities [rad/s]."""
    opening: float | None = None
    """Opening to which its fingers move from there on [m]; ``None`` where they keep still."""

    @property
    def end(self) -> float:
        """When in the step it ends [s]."""
        return self.begin + self.times[-1]

    def trajectory(self) -> Trajectory:
        """The curve; ``ValueError`` when the knots do not make one."""
        return Trajectory(np.array(self.times), np.array(self.positions), np.array(self.velocities))


class Motion(Saved, frozen=True, tag="motion", kw_only=True):
    """The stage's arm follows a timed curve; all fingers keep still, and so does the other arm unless it says so."""

    template: Template
    times: list[float]
    """Knot times [s], from 0."""
    positions: list[Row7]
    """Knot joint positions [rad]."""
    velocities: list[Row7]
    """Knot joint velocities [rad/s]; the curve between knots is the cubic Hermite one."""
    allowed: list[Pair]
    """Contacts intended while it runs."""
    holder: Side | None
    """The hand with which the object moves; ``None`` while it stands on the table."""
    guard: float | None = None
    """Contact force at which the motion stops early [N]; ``None`` for none."""
    force: float | None = None
    """Force with which the hand presses on the object along the way, kept by raising or lowering it [N]."""
    meanwhile: Meanwhile | None = None
    """What the other arm does."""

    @property
    def duration(self) -> float:
        """Time of the last knot [s]."""
        return self.times[-1]

    def trajectory(self) -> Trajectory:
        """The curve; ``ValueError`` when the knots do not make one."""
        return Trajectory(np.array(self.times), np.array(self.positions), np.array(self.velocities))


class Grip(Saved, frozen=True, tag="grip", kw_only=True):
    """The stage's arm drives its fingers to an opening with a force limit and keeps still."""

    opening: float
    """Commanded opening of one finger [m]."""
    force: float
    """Force limit of one finger [N]."""
    duration: float
    """Time given [s]."""
    allowed: list[Pair]
    """Contacts intended while it runs."""
    holder: Side | None
    """The hand that holds the object when it ends; ``None`` while it stands on the table."""
    meanwhile: Meanwhile | None = None
    """What the other arm does."""


class Await(Saved, frozen=True, tag="await", kw_only=True):
    """The stage's arm keeps still until it feels a pull."""

    force: float
    """Pull at its wrist that ends the wait [N]."""
    duration: float
    """Longest wait [s]."""
    allowed: list[Pair]
    """Contacts intended while it runs."""
    holder: Side | None
    """The hand that holds the object."""
    meanwhile: None = None
    """The other arm keeps still."""


class Stage(Saved, frozen=True, kw_only=True):
    """One symbolic operator bound to an arm, made concrete."""

    name: StageName
    arm: Side
    role: Role
    steps: list[Motion | Grip | Await]
    candidates_tried: int
    """Candidates proposed for this stage up to and including the one used."""
    score: float
    """The proposer's score of the candidate used."""
    T_hand_object: Matrix | None
    """Where the holding hand holds the object frame when the stage begins; ``None`` while no hand does."""
    T_world_object: Matrix
    """Where the object frame is expected when the stage ends, without the part's own motion."""

    @property
    def duration(self) -> float:
        """Sum over the steps [s]."""
        return sum(step.duration for step in self.steps)


class AssetReference(Saved, frozen=True, kw_only=True):
    """Which object was planned for."""

    source: str
    category: str
    instance: str
    split: str
    content_hash: str


class Operation(Saved, frozen=True, kw_only=True):
    """What the primary arm does to the object, as the proposer saw it."""

    kind: Literal["pull", "unscrew", "press", "flip", "grasp", "receive"]
    amount: float
    """Commanded motion: along the line [m], or about the axis [rad]."""


class Plan(Saved, frozen=True, kw_only=True):
    """A whole bimanual sequence, from one initial observation.

    The object frame is parallel to the world frame with its origin at the centroid of the observed cloud when the
    observation was taken: the planner knows no other.
    """

    format: str = PLAN_FORMAT
    version: int = PLAN_VERSION
    category: str
    """The column: which task is done with the object."""
    task: TaskType
    asset: AssetReference
    instruction: str
    seed: int
    proposer: str
    workcell: Workcell
    packages: dict[str, str]
    observation_hash: str
    assistant: Side
    primary: Side
    operation: Operation
    start: dict[Side, Row7]
    """Joint positions of both arms at the beginning [rad]."""
    start_opening: float
    """Opening of every finger at the beginning [m]."""
    T_world_object: Matrix
    """The object frame at the time of the observation."""
    T_world_body: Matrix | None = None
    """Where the simulator had the object's body when the plan was made after earlier stages; ``None`` for the scene as
    the seed builds it. Recorded for the verifier and for running the plan again; no planner reads it."""
    skeleton: list[str]
    stages: list[Stage]

    @property
    def duration(self) -> float:
        """Sum over the stages [s]."""
        return sum(stage.duration for stage in self.stages)


def matrix(T: pin.SE3) -> list[list[float]]:
    """A pose as the nested lists of a plan file, rounded to 1e-12 so that it prints alike everywhere."""
    return [[round(v, 12) + 0.0 for v in row] for row in to_list(T)]


def package_versions() -> dict[str, str]:
    """Installed versions of the packages that shape a plan."""
    return {name: metadata.version(name) for name in PACKAGES}


def encode(plan: Plan) -> bytes:
    """The bytes of a plan file: JSON, one line a stage item, the same for the same plan."""
    return msgspec.json.format(msgspec.json.encode(plan), indent=0) + b"\n"


def save(plan: Plan, folder: Path) -> Path:
    """Write ``plan.json`` into the run folder at once or not at all."""
    return write_atomic(folder / PLAN_FILE, encode(plan))


def decode(data: bytes, origin: str) -> Plan:
    """The plan in ``data``; ``origin`` names the file in error messages.

    Raises:
        BadRunFolder: The text is cut off, not JSON, of another version, or a value is out of shape or range.
    """
    try:
        head = msgspec.json.decode(data, type=_Head)
        if head.format != PLAN_FORMAT:
            raise BadRunFolder(f'{origin} is not a plan: its format is "{head.format}", not "{PLAN_FORMAT}".')
        if head.version != PLAN_VERSION:
            raise BadRunFolder(f"{origin} has version {head.version}; this program reads version {PLAN_VERSION}.")
        plan = msgspec.json.decode(data, type=Plan)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise BadRunFolder(f"{origin} cannot be read as a plan: {error}. Plan again to make a new one.") from error
    _check_shapes(plan, origin)
    return plan


class _Head(Struct):
    format: str
    version: int


def _check_shapes(plan: Plan, origin: str) -> None:
    """Refuse values that no reader could use; wrong but readable motions are the verifier's business."""
    where = "start"
    try:
        from_list(plan.T_world_object)
        if plan.T_world_body is not None:
            from_list(plan.T_world_body)
        for number, stage in enumerate(plan.stages):
            where = f"stage {number} ({stage.name})"
            from_list(stage.T_world_object)
            if stage.T_hand_object is not None:
                from_list(stage.T_hand_object)
            for step in stage.steps:
                if isinstance(step, Motion):
                    step.trajectory()
                if step.meanwhile is not None:
                    _check_meanwhile(step.meanwhile, step.duration)
    except ValueError as error:
        raise BadRunFolder(f"{origin}, {where}: {error}.") from error
    if not plan.stages or plan.assistant == plan.primary:
        raise BadRunFolder(f"{origin} holds no usable plan: {len(plan.stages)} stages, roles share an arm or none.")


def _check_meanwhile(meanwhile: Meanwhile, duration: float) -> None:
    """``ValueError`` when the other arm's part cannot be done during a step."""
    meanwhile.trajectory()
    if meanwhile.begin < 0.0 or meanwhile.end > duration + 1e-6:
        raise ValueError(f"what the {meanwhile.arm} arm does meanwhile lasts longer than the step")


def load(folder: Path) -> Plan:
    """The plan of a run folder.

    Raises:
        BadRunFolder: The folder or the file is missing or unusable.
    """
    path = folder / PLAN_FILE
    if not folder.is_dir():
        raise BadRunFolder(f"Run folder {folder} does not exist.")
    if not path.is_file():
        held = ", ".join(sorted(entry.name for entry in folder.iterdir())) or "nothing"
        raise BadRunFolder(f"Run folder {folder} has no {PLAN_FILE}; it holds {held}.")
    return decode(path.read_bytes(), str(path))
