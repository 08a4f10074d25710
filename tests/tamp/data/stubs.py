"""Episodes that take milliseconds and follow from their seed alone, for tests of what is done with episodes."""

from __future__ import annotations

import time

import numpy as np

from robots.cache import content_hash
from tamp.episode import Request
from tamp.record import Action, Cloud, Moment, Recorded
from tamp.trace import Failure, Rejection
from worlds.tasks import task_of

LINKS = ("body", "lid")


def cloud(rng: np.random.Generator) -> Cloud:
    normals = rng.normal(size=(40, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Cloud(rng.normal(size=(40, 3)), normals, rng.integers(0, 2, 40), LINKS)


def action(stage: str, rng: np.random.Generator) -> Action:
    return Action(
        stage, "left", "assistant", np.eye(4), rng.normal(size=3), [0.0, 0.0, 1.0], 0.12, 0.03, 0.5, "press",
        rng.normal(size=3), [0.0, 0.02, 0.0], np.eye(4),
    )  # fmt: skip


def rejections() -> tuple[Rejection, ...]:
    common = {"skeleton": 0, "stage": "pregrasp", "arm": "left", "role": "assistant", "blame": "pregrasp"}
    reach = Rejection(candidate=1, cause="unreachable", detail="unreachable by 41 mm", amount=0.041, **common)
    hit = Rejection(
        candidate=2,
        cause="collision",
        detail="left/panda_hand hits table",
        bodies=("left/panda_hand", "table"),
        amount=0.006,
        approach=np.eye(4).ravel().tolist(),
        **common,
    )
    return reach, hit


def episode(request: Request) -> Recorded:
    """Every third seed fails; what it holds is drawn from the seed."""
    rng = np.random.default_rng(request.seed)
    success = request.seed % 3 != 0
    moments: list[Moment] = ["initial", "grasped", "prepared"] if success else ["initial"]
    instance = f"thing-{request.seed % 7}"
    assert request.split is not None
    return Recorded(
        seed=request.seed,
        category=request.category,
        instance=instance,
        source=request.asset,
        content_hash=content_hash(request.category, instance, request.split),
        split=request.split,
        task_type=task_of(request.category).type,
        instruction=task_of(request.category).instruction,
        proposer=request.proposer,
        clouds={moment: cloud(rng) for moment in moments},
        link_poses={moment: {"body": np.eye(4), "lid": np.eye(4)} for moment in (*moments, "final")},
        actions=(action("pregrasp", rng), action("operate", rng)) if success else (),
        rejections=rejections(),
        success=success,
        outcome="ok" if success else "ik",
        failure=None if success else Failure(stage="pregrasp", reason="unreachable", detail="unreachable by 41 mm"),
        versions={"ompl": "2.0.1"},
    )


def slow_episode(request: Request) -> Recorded:
    """The same, but long enough to be killed in the middle of a collection."""
    time.sleep(0.05)
    return episode(request)


def broken_episode(request: Request) -> Recorded:
    """Always raises."""
    raise RuntimeError(f"no luck with {request.seed}")
