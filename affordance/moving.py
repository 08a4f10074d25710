"""Where should an object be brought, and how does the hand that holds it go there? The paper's last two networks."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import torch

from affordance.candidates import GoalCandidate, PregraspCandidate, SceneView
from affordance.frames import moved_cloud
from affordance.heads import drawn
from affordance.sampling import distinct
from affordance.sight import Eye
from robots.spatial import Array
from robots.workcell import Side

POSES = 48
"""Object poses drawn for one list of candidates."""


def object_moves(
    eye: Eye,
    view: SceneView,
    goal: GoalCandidate,
    hand: tuple[pin.SE3, float],
    primary: Side | None,
    rng: np.random.Generator,
    *,
    ranked: bool,
) -> tuple[list[pin.SE3], list[float]]:
    """Motions of the object in the world frame that the Pose Predictor draws, and how good they are, best first.

    Args:
        eye: What the networks see, and they.
        view: The object as it lies.
        goal: What the primary will do.
        hand: ``T_world_hand`` of the assistant and the opening of one finger [m].
        primary: Whose work it will be, where that is known.
        rng: Decides the draws.
        ranked: Whether the critic says how good they are; else all are alike.
    """
    with torch.no_grad():
        sight, model = eye.sight(view), eye.model
        tokens, critics = model.tokens, model.critics
        acts = [(goal.T_world_hand, goal.opening), hand]
        spots = [sight.spot(T, wide) for T, wide in acts]
        codes = [sight.code(T) for T, _ in acts]
        aim, held = (eye.token(sight, spot, code) for spot, code in zip(spots, codes, strict=True))
        place = eye.place(sight, primary)
        whole = sight.look.seen.whole
        told = model.pose.condition(whole, tokens.place(place), sight.scene, model.goal_shown(aim), held)
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        count = 1 if model.settings.losses.zero_latent else POSES
        moves = drawn(model.pose.move, told, count, generator, middle_first=True)
        score = torch.ones(1, count)
        if critics.pose is not None and ranked:
            aim_j, held_j = (eye.judged_token(sight, spot, code) for spot, code in zip(spots, codes, strict=True))
            judged = critics.pose(
                sight.look.judged.whole,
                moves,
                critics.tokens.text(eye.text),
                critics.tokens.place(place),
                aim_j,
                held_j,
            )
            score = torch.sigmoid(judged)
        T_moves = sight.frame.moves_world(moves, sight.frame.centre)[0].numpy().astype(float)
    values = score[0].numpy().astype(float)
    centre = sight.frame.centre[0].numpy()
    at = np.array([T[:3, :3] @ centre + T[:3, 3] for T in T_moves])
    kept = distinct(T_moves[:, :3, :3], at, values)
    return [rigid(T_moves[k]) for k in kept], [float(values[k]) for k in kept]


def hand_moves(
    eye: Eye,
    view: SceneView,
    goal: GoalCandidate,
    grasp: PregraspCandidate,
    T_move: pin.SE3 | None,
    count: int,
    rng: np.random.Generator,
) -> list[pin.SE3]:
    """Motions of the holding hand in the world frame that the Reorient Actor draws, the middle one first.

    Args:
        eye: What the networks see, and they.
        view: The object as it lies.
        goal: What the primary will do.
        grasp: How the assistant holds.
        T_move: The motion of the object that is aimed at, in the world frame; ``None`` where none is predicted.
        count: How many.
        rng: Decides the draws.
    """
    tokens, net, sight = eye.model.tokens, eye.model.reorient, eye.sight(view)
    aimed = (pin.SE3.Identity() if T_move is None else T_move).homogeneous.astype(np.float32)
    with torch.no_grad():
        aim, held = (
            eye.token(sight, sight.spot(T, opening), sight.code(T))
            for T, opening in ((goal.T_world_hand, goal.opening), (grasp.T_world_hand, grasp.opening))
        )
        move = sight.frame.moves(torch.from_numpy(aimed)[None], sight.frame.centre)
        whole = eye.model.encoder(moved_cloud(sight.look.cloud, move)).whole
        told = net.condition(sight.look.seen.whole, tokens.text(eye.text), aim, held, whole)
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        answers = drawn(net.move, told, count, generator, middle_first=True)
        tool = np.array([0.0, 0.0, view.workcell.arm("left").gripper.tcp_offset])
        pivot = torch.from_numpy(grasp.T_world_hand.act(tool).astype(np.float32))[None]
        return [rigid(T) for T in sight.frame.moves_world(answers, pivot)[0].numpy().astype(float)]


def rigid(T: Array) -> pin.SE3:
    """A rigid transform ``(4, 4)`` of single precision as one of double precision."""
    return pin.SE3(orthonormal(T[:3, :3]), T[:3, 3])


def orthonormal(R: Array) -> Array:
    """The rotation closest to a matrix of single precision."""
    u, _, v = np.linalg.svd(R)
    return np.asarray(u @ v)
