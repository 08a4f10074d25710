"""How long does one rollout of the networks take: the five calls of an articulated plan, on the CPU?

Run it with ``python -m tests.benchmarks.inference [--profile default] [--threads 2] [--runs 30]``. The calls are those
of a plan in which nothing is rejected: goal, pregrasp, object pose, reorientation, and goal again on the object as it
will be. They include what surrounds the networks in the proposer: sampling of the cloud, encoding, ranking and laying
hands onto it. The weights are the shipped ones at any profile, as a profile decides only how many points are looked at.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pinocchio as pin
import torch

from affordance import checkpoint
from affordance.candidates import Roles, SceneView
from affordance.networks import Model
from affordance.propose import LearnedProposer, learned_proposer
from affordance.settings import PROFILES, settings_of
from affordance.stations import hand_corners
from affordance.variants import shipped_weights, variant_of
from tamp.episode import Request, opened
from worlds.tasks import Task

ROLES = Roles(assistant="left", primary="right")


def at_profile(profile: str, folder: Path) -> Path:
    """The shipped weights in a file that asks for the points of ``profile``."""
    model = Model(settings_of(profile))
    model.load_state_dict(checkpoint.load(shipped_weights(variant_of("learned"))).model.state_dict())
    return checkpoint.save(folder / f"{profile}.safetensors", model, "hash", 0)


@contextmanager
def observed(category: str, seed: int, folder: Path) -> Iterator[tuple[Task, SceneView]]:
    """A task, and what its camera sees before anything moves."""
    with opened(Request(category=category, seed=seed, out=folder, proposer="learned")) as (episode, _, subject):
        cloud = episode.last.observation.cloud
        yield subject.task, SceneView(subject.workcell, cloud, pin.SE3.Identity(), np.zeros((0, 3)), ROLES)


def rollout(proposer: LearnedProposer, view: SceneView, rng: np.random.Generator) -> None:
    """The five calls of a plan in which every first candidate is accepted."""
    goal = proposer.goal(view, rng)[0]
    grasp = proposer.pregrasp(view, goal, rng)[0]
    pose = proposer.object_pose(view, goal, grasp, ROLES, rng)[0]
    T_world_hand = proposer.reorient(grasp, pose)
    held = hand_corners(view.workcell.arm(ROLES.assistant).gripper, T_world_hand)
    proposer.goal(view.moved(pose.T_move, held), rng)


def seconds(task: Task, view: SceneView, weights: Path, threads: int, runs: int) -> list[float]:
    """Wall time of each of ``runs`` rollouts [s], after one that is not counted.

    Each has a proposer of its own, since a proposer remembers what it has looked at.
    """
    taken = []
    for k in range(runs + 1):
        proposer = learned_proposer("learned", task, variant_of("learned"), weights)
        torch.set_num_threads(threads)
        rng, start = np.random.default_rng(k), time.perf_counter()
        rollout(proposer, view, rng)
        taken.append(time.perf_counter() - start)
    return taken[1:]


def main() -> None:
    """Print one row a profile: median, least and most wall time."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--profile", choices=sorted(PROFILES), help="without it shipped, cpu and default")
    parser.add_argument("--threads", type=int, default=2, help="threads of one operation of torch")
    parser.add_argument("--runs", type=int, default=30, help="rollouts that are timed")
    asked = parser.parse_args()
    if asked.threads < 1 or asked.runs < 1:
        parser.error("--threads and --runs want a number from 1 on")
    profiles = (asked.profile,) if asked.profile else ("shipped", "cpu", "default")
    with tempfile.TemporaryDirectory() as name, observed("Bottle", 3, Path(name) / "run") as (task, view):
        sys.stdout.write(f"{'profile':8} {'points':>7} {'median':>8} {'least':>8} {'most':>8}   [s]\n")
        for profile in profiles:
            taken = seconds(task, view, at_profile(profile, Path(name)), asked.threads, asked.runs)
            row = " ".join(f"{f(taken):8.3f}" for f in (statistics.median, min, max))
            sys.stdout.write(f"{profile:8} {PROFILES[profile].points:7} {row}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
