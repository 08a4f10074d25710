"""Where could an arm act, at a glance? Affordance on the seen points, and the hands that were proposed there."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, get_args, runtime_checkable

import numpy as np
import pinocchio as pin

from robots.cache import write_atomic
from robots.errors import BadRunFolder
from robots.spatial import Array, from_list, frozen

MapName = Literal["goal_before", "pre", "goal_after"]
"""Where the primary could act on the object as it lies, where the assistant could, and where the primary could after
the preparation."""

MAPS_FILE = "affordance.npz"


@dataclass(frozen=True, slots=True, eq=False)
class AffordanceMap:
    """One map.

    Attributes:
        name: Which.
        points: ``(n, 3)`` in the world frame [m].
        scores: ``(n,)`` in ``[0, 1]``.
        hands: ``T_world_hand`` of the best candidates, best first.
        hand_scores: Their scores.
    """

    name: MapName
    points: Array
    scores: Array
    hands: tuple[pin.SE3, ...]
    hand_scores: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points))
        object.__setattr__(self, "scores", frozen(self.scores))
        object.__setattr__(self, "hands", tuple(T.copy() for T in self.hands))
        if self.points.shape != (len(self.scores), 3) or len(self.hands) != len(self.hand_scores):
            raise ValueError(
                f"a map has (n, 3) points, (n,) scores and a score for each hand, not {self.points.shape}, "
                f"{self.scores.shape} and {len(self.hand_scores)} for {len(self.hands)}"
            )
        if not np.isfinite(self.points).all() or not ((self.scores >= 0.0) & (self.scores <= 1.0)).all():
            raise ValueError("the points of a map are finite and its scores lie between 0 and 1")


@runtime_checkable
class ShowsMaps(Protocol):
    """A proposer that can show what it saw."""

    def maps(self) -> tuple[AffordanceMap, ...]:
        """The maps of its latest calls, in the order of ``MapName``."""


def save_maps(maps: tuple[AffordanceMap, ...], folder: Path) -> Path:
    """Write maps into a run folder."""
    arrays: dict[str, Array] = {}
    for one in maps:
        arrays[f"{one.name}.points"], arrays[f"{one.name}.scores"] = one.points, one.scores
        arrays[f"{one.name}.hands"] = np.array([T.homogeneous for T in one.hands]).reshape(-1, 4, 4)
        arrays[f"{one.name}.hand_scores"] = np.array(one.hand_scores)
    memory = io.BytesIO()
    np.savez_compressed(memory, allow_pickle=False, **arrays)
    return write_atomic(folder / MAPS_FILE, memory.getvalue())


def load_maps(folder: Path) -> tuple[AffordanceMap, ...]:
    """The maps in a run folder; none where its proposer had none.

    Raises:
        BadRunFolder: The file is damaged.
    """
    path = folder / MAPS_FILE
    if not path.is_file():
        return ()
    found = []
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as stored:
            for name in get_args(MapName):
                if f"{name}.points" in stored:
                    hands = tuple(from_list(T) for T in stored[f"{name}.hands"])
                    scores = tuple(float(score) for score in stored[f"{name}.hand_scores"])
                    found.append(AffordanceMap(name, stored[f"{name}.points"], stored[f"{name}.scores"], hands, scores))
    except Exception as error:  # a damaged archive makes zipfile, zlib and NumPy raise errors of any kind
        raise BadRunFolder(f"{path} cannot be read: {error}.") from error
    return tuple(found)
