"""Which actions do the networks draw where, how good do the critics find them, and which of two alike is kept?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from affordance.frames import Frame, canonical
from affordance.heads import drawn
from affordance.networks import Contact
from affordance.outlook import Look
from affordance.pointnet2 import gathered
from affordance.settings import SCALE

TOP_SHARE, TOP_LEAST = 0.5, 20
"""Share of the points with the best affordance among which some are drawn, and the least number of them."""

SPOTS = 32
"""Points drawn."""

DRAWS = 12
"""Actions drawn at each."""

KEPT = 20
"""Longest list of candidates."""

NEAR, ALIKE = 0.015, np.radians(15.0)
"""Of two hands nearer than this [m] and turned by less than this [rad] only the better is kept."""

ELSEWHERE, OTHERWISE = 0.04, np.radians(60.0)
"""Hands this far apart [m], or with approaches turned by this much [rad], act elsewhere."""

Judge = Callable[[Tensor, Tensor], Tensor]
"""From indices ``(1, K)`` and codes ``(1, K, D, 6)`` to probabilities ``(1, K, D)``."""


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """Hands that the actors drew, in no order.

    Attributes:
        index: ``(k,)`` points at which they act.
        code: ``(k, 6)`` how they are turned, in network coordinates.
        condition: ``(k, C)`` what they were drawn under.
        R_world_hand: ``(k, 3, 3)``.
        tip: ``(k, 3)`` between the finger tips, in the world frame [m].
        opening: ``(k,)`` of one finger [m].
        score: ``(k,)`` in ``[0, 1]``.
    """

    index: Tensor
    code: Tensor
    condition: Tensor
    R_world_hand: np.ndarray
    tip: np.ndarray
    opening: np.ndarray
    score: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Promise:
    """How promising the points of a cloud are, ``(N,)`` each; nan where none may act.

    Attributes:
        affordance: How well it goes there.
        chance: How often hands act there, as a share of where they do so most.
    """

    affordance: Tensor
    chance: Tensor

    @property
    def both(self) -> Tensor:
        """Affordance of points, less where hands seldom act."""
        return self.affordance * self.chance.sqrt()


def promise(contact: Contact, points: Tensor, given: Tensor, allowed: Tensor) -> Promise:
    """How promising points with features ``(1, N, 128)`` are, of which ``allowed`` ``(N,)`` may be acted at."""
    logits = torch.where(allowed, contact.places(points, given)[0], -torch.inf)
    chance = (logits - logits.max()).exp()
    return Promise(*(torch.where(allowed, values, torch.nan) for values in (contact.scores(points, given)[0], chance)))


def hands(
    contact: Contact,
    direction: Callable[[Tensor], Tensor],
    token: Callable[[Tensor], Tensor],
    given: Tensor,
    view: Look,
    frame: Frame,
    promised: Promise,
    judge: Judge | None,
    rng: np.random.Generator,
) -> Drawn:
    """Hands at promising points.

    Args:
        contact: Who draws.
        direction: Token of an orientation code.
        token: Token of a contact.
        given: ``(1, G)`` what the drawing network is told besides.
        view: One cloud.
        frame: Its coordinates.
        promised: How promising its points are.
        judge: Who judges; without it, the affordance of the point stands for what it would say.
        rng: Decides every draw.
    """
    spots = chosen_spots(promised.both, rng)
    index = spots[None]
    generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
    where = gathered(view.cloud[..., :3], index)
    condition = contact.condition(view.seen.at(index), token(where), given)
    codes = canonical(drawn(contact.orientation, condition, DRAWS, generator, middle_first=True))
    likely = promised.affordance[index][..., None].expand(*codes.shape[:-1]) if judge is None else judge(index, codes)
    likely = likely * promised.chance[index].sqrt()[..., None]
    told = condition[:, :, None].expand(*codes.shape[:-1], condition.shape[-1])
    turned = direction(codes)
    reach = contact.reach(told, turned)
    R = frame.rotations_world(codes)
    contact_world = frame.points_world(where)[:, :, None]
    tip = contact_world + SCALE * (R @ reach[..., None])[..., 0]
    opening = contact.opening(told, turned)
    return Drawn(
        index=index[..., None].expand(*codes.shape[:-1]).reshape(-1),
        code=codes.reshape(-1, codes.shape[-1]),
        condition=told.reshape(-1, told.shape[-1]),
        R_world_hand=R.reshape(-1, 3, 3).numpy().astype(float),
        tip=tip.reshape(-1, 3).numpy().astype(float),
        opening=opening.reshape(-1).numpy().astype(float),
        score=likely.reshape(-1).numpy().astype(float),
    )


def chosen_spots(scores: Tensor, rng: np.random.Generator) -> Tensor:
    """``(SPOTS,)`` points drawn without replacement from the best share of them, as likely as their scores."""
    values = scores.numpy().astype(float)
    allowed = np.flatnonzero(np.isfinite(values))
    order = allowed[np.argsort(-values[allowed], kind="stable")]
    best = order[: max(TOP_LEAST, round(TOP_SHARE * len(allowed)))]
    weights = values[best] + 1e-9
    picked = rng.choice(best, min(SPOTS, len(best)), replace=False, p=weights / weights.sum())
    return torch.from_numpy(picked.astype(np.int64))


def distinct(R: np.ndarray, at: np.ndarray, score: np.ndarray, most: int = KEPT) -> list[int]:
    """Numbers of the best hands, best first, none near a better one that is turned alike, a half turn counting as none.

    Args:
        R: ``(k, 3, 3)``.
        at: ``(k, 3)`` [m].
        score: ``(k,)``.
        most: How many.
    """
    flip = np.array([-1.0, -1.0, 1.0])
    kept: list[int] = []
    for k in np.argsort(-score, kind="stable"):
        close = [j for j in kept if np.linalg.norm(at[k] - at[j]) < NEAR]
        if not any(max(_cosine(R[k], R[j]), _cosine(R[k] * flip, R[j])) > np.cos(ALIKE) for j in close):
            kept.append(int(k))
        if len(kept) == most:
            break
    return kept


def second_apart(R: np.ndarray, at: np.ndarray) -> list[int]:
    """The order in which hands that are best first are given away: as they are, but the second one acts elsewhere.

    A search asks for few anticipatory goals; if the first is at the wrong end of an object, so are its neighbours.

    Args:
        R: ``(k, 3, 3)``.
        at: ``(k, 3)`` [m].
    """
    order = list(range(len(at)))
    for k in order[1:]:
        if np.linalg.norm(at[k] - at[0]) > ELSEWHERE or R[k][:, 2] @ R[0][:, 2] < np.cos(OTHERWISE):
            return [0, k, *(n for n in order[1:] if n != k)]
    return order


def _cosine(a: np.ndarray, b: np.ndarray) -> float:
    """Cosine of the angle between two rotations."""
    return float(0.5 * (np.einsum("ij,ij->", a, b) - 1.0))
