"""What was tried and why it was rejected: a typed record of a search, on disk beside the plan."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Literal

import msgspec
from msgspec import Struct

from robots.cache import write_atomic
from robots.errors import BadRunFolder
from robots.workcell import Side
from tamp.plan import Role, StageName

TRACE_FILE = "trace.json"
TRACE_FORMAT = "bipremanip-trace"
TRACE_VERSION = 1

Cause = Literal[
    "unreachable",
    "collision",
    "no_path",
    "cartesian",
    "timing",
    "uncertified",
    "proposal",
    "budget",
    "not_held",
    "not_exposed",
    "not_moved",
    "not_overhanging",
    "fell",
    "not_tilted",
    "not_presented",
    "not_lifted",
    "not_handed",
    "dropped",
    "slipped",
    "force",
    "tracking",
    "diverged",
]
"""Why a candidate or an execution was rejected; the tally of a benchmark counts these."""


TraceStatus = Literal["success", "planned", "no_plan", "execution_failed", "interrupted"]


class Rejection(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One candidate that was tried and dropped."""

    skeleton: int
    """Number of the skeleton, in the order tried."""
    stage: StageName
    """Stage the candidate was for."""
    arm: Side
    role: Role
    candidate: int
    """Its number among the candidates of that stage."""
    cause: Cause
    detail: str
    """The reason in words, with names and numbers."""
    blame: StageName
    """Stage to which the search went back."""
    bodies: tuple[str, str] | None = None
    """The two names that collide, where the cause is a collision."""
    amount: float | None = None
    """Penetration or miss [m], where there is one."""
    approach: list[float] | None = None
    """Hand pose of the candidate as 16 numbers (row-major ``T_world_hand``), for the viewer."""


class Failure(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Why an episode was not solved."""

    stage: StageName
    reason: Cause
    detail: str


class Trace(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The record of one episode: its search, and its execution if there was one."""

    format: str = TRACE_FORMAT
    version: int = TRACE_VERSION
    category: str
    instance: str
    seed: int
    proposer: str
    skeletons: list[list[str]]
    """Stage names with their arms, such as ``pregrasp(left)``, of every skeleton in the order tried."""
    rejections: list[Rejection]
    chosen: int | None
    """Number of the skeleton of the plan; ``None`` without a plan."""
    plan_seconds: float
    """Wall time from the observation to the saved plan [s]."""
    status: TraceStatus
    failure: Failure | None


def save(trace: Trace, folder: Path) -> Path:
    """Write ``trace.json`` into the run folder at once or not at all."""
    return write_atomic(folder / TRACE_FILE, msgspec.json.format(msgspec.json.encode(trace), indent=1) + b"\n")


def load(folder: Path) -> Trace:
    """The trace of a run folder; ``BadRunFolder`` when it is missing or unreadable."""
    path = folder / TRACE_FILE
    if not path.is_file():
        raise BadRunFolder(f"Run folder {folder} {'has no ' + TRACE_FILE if folder.is_dir() else 'does not exist'}.")
    try:
        trace = msgspec.json.decode(path.read_bytes(), type=Trace)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise BadRunFolder(f"{path} cannot be read as a trace: {error}.") from error
    if (trace.format, trace.version) != (TRACE_FORMAT, TRACE_VERSION):
        raise BadRunFolder(f"{path} is a {trace.format} of version {trace.version}; version {TRACE_VERSION} is read.")
    return trace


def dominant(rejections: list[Rejection], skeletons: list[list[str]]) -> Failure:
    """The failure that best sums up a search without a plan: the furthest stage reached, its commonest cause."""

    def place(rejection: Rejection) -> int:
        names = [stage.partition("(")[0] for stage in skeletons[rejection.skeleton]]
        return len(names) - 1 - names[::-1].index(rejection.stage)

    furthest = max(rejections, key=place)
    here = [r for r in rejections if r.stage == furthest.stage]
    cause, count = Counter(r.cause for r in here).most_common(1)[0]
    example = next(r for r in here if r.cause == cause)
    return Failure(stage=furthest.stage, reason=cause, detail=f"{count} of {len(here)} candidates: {example.detail}")
