"""Where do candidates come from? Every proposer by name; only the heuristic one may look at the simulated world."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from affordance.candidates import Proposer
from affordance.heuristic import HeuristicProposer
from affordance.uniform import UniformProposer
from affordance.variants import VARIANTS, shipped_weights, variant_of
from robots.errors import BadInput, MissingDependency, UnknownName
from robots.workcell import Workcell
from worlds.bullet.world import BulletWorld
from worlds.labels import truth
from worlds.observe import Observation
from worlds.tasks import Task

PROPOSERS = ("heuristic", "uniform", *VARIANTS)
"""Names, as given to ``--proposer``."""


def check_proposer(name: str, weights: Path | None = None) -> None:
    """Refuse a proposer that does not exist or cannot work here, before anything runs.

    Raises:
        UnknownName: There is no such proposer.
        MissingDependency: It needs torch, which is not installed.
        BadInput: Its weights are missing, or weights are named for a proposer that has none.
    """
    if name not in PROPOSERS:
        raise UnknownName("proposer", name, PROPOSERS)
    if name not in VARIANTS:
        if weights is not None:
            raise BadInput(f"--weights {weights}: the proposer {name} has no networks.")
        return
    if importlib.util.find_spec("torch") is None:
        raise MissingDependency("torch", "learn", f"The proposer {name} (unlike --proposer uniform and heuristic)")
    path = weights_of(name, weights)
    if not path.is_file():
        raise BadInput(f"There are no weights {path} for the proposer {name}. `bipre train` makes them.")


def usable_proposers() -> tuple[str, ...]:
    """The proposers that can work here: those without networks, and those whose weights are shipped."""
    torch = importlib.util.find_spec("torch") is not None
    return tuple(
        name for name in PROPOSERS if name not in VARIANTS or (torch and shipped_weights(variant_of(name)).is_file())
    )


def weights_of(name: str, weights: Path | None) -> Path:
    """The file that a learned proposer's networks are read from."""
    return shipped_weights(variant_of(name)) if weights is None else weights


def proposer_of(
    name: str, task: Task, workcell: Workcell, world: BulletWorld, observation: Observation, weights: Path | None = None
) -> Proposer:
    """The proposer of a name, for one observation.

    Raises:
        BadInput: Its weights cannot be used.
    """
    gripper = workcell.arm("left").gripper
    if name == "heuristic":
        return HeuristicProposer(task.type, truth(world, observation), gripper)
    if name == "uniform":
        return UniformProposer(task.type, gripper)
    from affordance.propose import learned_proposer

    return learned_proposer(name, task, variant_of(name), weights_of(name, weights))
