"""How is an episode played so that it can be learned from: what was seen when, where everything was, what was done?"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

import numpy as np
from msgspec.structs import replace
from scipy.spatial import cKDTree

from robots.spatial import Array
from robots.workcell import Side
from tamp.actions import actions_of
from tamp.episode import Episode, Request, opened, run, write
from tamp.plan import package_versions
from tamp.record import MOMENTS, Cloud, Moment, Recorded, outcome_of
from worlds.bullet.world import BulletWorld
from worlds.labels import labelled_view, link_poses, point_links
from worlds.observe import Observation
from worlds.tasks import TaskType

Kept = TypeVar("Kept")

SHOWN: dict[TaskType, dict[str, tuple[Moment, ...]]] = {
    "articulated": {"lift": ("grasped",), "reorient": ("prepared",)},
    "handover": {"lift": ("grasped",), "present": ("prepared",)},
    "edge_push": {"push": ("grasped",), "retreat": ("prepared",)},
    "plate_lift": {"press": ("grasped", "prepared")},
}
"""The moments at which a stage has ended, by task type; of a stage that comes again, the first time for ``grasped`` and
the last for ``prepared``."""

MOST_POINTS = 2048
"""Points kept of a cloud: as many as the networks read at the most without the paper's profile; an episode then takes
some 200 kB on disk, nearly all of it points and normals."""

NEIGHBOURS = 16
"""Points to which a plane is fitted for a normal: some 4 mm around, at the cameras' resolution."""


def record_episode(request: Request) -> Recorded:
    """Play an episode to its end and keep what is learned from.

    Args:
        request: What to play, offline; its run folder is written without a page, to a temporary place unless one is
            named.

    Raises:
        ValueError: The request asks for a closed loop, or for no execution.
        BadInput: Something in the request cannot be used.
    """
    if request.mode == "E3" or not request.execute:
        raise ValueError("only episodes that are planned once and executed are recorded")
    with _folder(request) as folder:
        with opened(replace(request, out=folder, page=False)) as (episode, world, subject):
            film = _Film(episode, world)
            run(episode, world, subject, moment=film.stage_ended)
            film.end()
        write(episode)
        failure, search, solved = episode.failure(), episode.last.search, episode.last.solved
        return Recorded(
            seed=request.seed,
            category=request.category,
            instance=episode.asset.instance,
            source=episode.asset.source,
            content_hash=episode.asset.content_hash,
            split=episode.asset.split,
            task_type=episode.task.type,
            instruction=episode.task.instruction,
            proposer=request.proposer,
            clouds=_in_order(film.clouds),
            link_poses=_in_order(film.poses),
            actions=() if solved is None else actions_of(solved, subject.arms, subject.workcell),
            rejections=() if search is None else tuple(search.rejections),
            success=failure is None,
            outcome=outcome_of(failure),
            failure=failure,
            versions=package_versions(),
        )


@contextmanager
def _folder(request: Request) -> Iterator[Path]:
    """The run folder that was asked for, or one that is gone afterwards."""
    if request.out is not None:
        yield request.out
        return
    with TemporaryDirectory(prefix="bipre-") as scratch:
        yield Path(scratch) / "run"


def _in_order(by_moment: dict[Moment, Kept]) -> dict[Moment, Kept]:
    return {moment: by_moment[moment] for moment in MOMENTS if moment in by_moment}


class _Film:
    """What was seen, and where everything was, at the moments of one episode.

    Attributes:
        clouds: By moment.
        poses: By moment, the links' poses by name.
    """

    def __init__(self, episode: Episode, world: BulletWorld) -> None:
        self.episode, self.world = episode, world
        self.clouds: dict[Moment, Cloud] = {}
        self.poses: dict[Moment, dict[str, Array]] = {"initial": link_poses(world)}
        self._stages: dict[Moment, int] = {}
        self._ended = 0
        observation = episode.last.observation
        self._take("initial", observation, point_links(world, observation))

    def stage_ended(self, stage: str) -> None:
        """Look, if this is a moment to be kept."""
        moments = SHOWN[self.episode.task.type].get(stage, ())
        for moment in moments:
            if moment == "grasped" and moment in self._stages:
                continue
            self._stages[moment] = self._ended
            self.poses[moment] = link_poses(self.world)
            self.clouds.pop(moment, None)
            view = labelled_view(self.world, self._assistant())
            if len(view.cloud) >= NEIGHBOURS:
                self._take(moment, view, point_links(self.world, view, self._assistant()))
        self._ended += 1

    def end(self) -> None:
        """The episode has ended: forget the moments whose stage did not come out as planned."""
        outcome = self.episode.outcome
        if outcome is None:
            return
        for moment, stage in self._stages.items():
            if not outcome.checked[stage].true:
                self.clouds.pop(moment, None)
                self.poses.pop(moment)
        if outcome.failure is None or outcome.failure.reason != "diverged":
            self.poses["final"] = link_poses(self.world)

    def _assistant(self) -> Side:
        plan = self.episode.last.plan
        if plan is None:
            raise ValueError("a stage has ended without a plan")
        return plan.assistant

    def _take(self, moment: Moment, view: Observation, links: np.ndarray[tuple[int], np.dtype[np.str_]]) -> None:
        rng = np.random.default_rng([self.episode.request.seed, MOMENTS.index(moment)])
        kept = np.arange(len(view.cloud))
        if len(kept) > MOST_POINTS:
            kept = np.sort(rng.choice(kept, MOST_POINTS, replace=False))
        eyes = np.array([camera.eye for camera in self.world.workcell.cameras])[view.pixels[kept, 0]]
        names, numbers = _numbered(links[kept], tuple(self.world.object_links.values()))
        normals = normals_at(view.cloud, kept, eyes).astype(np.float32)
        self.clouds[moment] = Cloud(view.cloud[kept].astype(np.float32), normals, numbers, names)


def _numbered(
    links: np.ndarray[tuple[int], np.dtype[np.str_]], first: tuple[str, ...]
) -> tuple[tuple[str, ...], np.ndarray[tuple[int], np.dtype[np.uint8]]]:
    """Every name once, some in any case and first, and the number of each point's name."""
    found = tuple(str(name) for name in np.unique(links))
    names = (*first, *(name for name in found if name not in first))
    numbers = np.zeros(len(links), dtype=np.uint8)
    for name in found:
        numbers[links == name] = names.index(name)
    return names, numbers


def normals_at(cloud: Array, kept: np.ndarray[tuple[int], np.dtype[np.intp]], eyes: Array) -> Array:
    """Normals ``(n, 3)`` of the planes that fit best around some points of a cloud, towards where they were seen from.

    Args:
        cloud: ``(m, 3)`` [m].
        kept: ``(n,)`` numbers of the points.
        eyes: ``(n, 3)`` from where each of them was seen [m].
    """
    _, near = cKDTree(cloud).query(cloud[kept], k=min(NEIGHBOURS, len(cloud)))
    around = cloud[near]
    around = around - around.mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))[1][:, :, 0]
    away = np.einsum("ni,ni->n", normals, eyes - cloud[kept]) < 0.0
    return np.asarray(np.where(away[:, None], -normals, normals))
