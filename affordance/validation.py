"""How good are the networks on objects they have not learned from? Everything is drawn from the prior."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from affordance.critics import CHECKS, feasible
from affordance.dataset import Batch
from affordance.frames import code_of
from affordance.heads import joined
from affordance.losses import prior_angles
from affordance.networks import Model
from affordance.pointnet2 import gathered
from affordance.settings import SCALE
from affordance.views import Done, Scene, done_in, seen, spins
from affordance.wrong import judged_token, turned_away

DRAWS = 16
"""Draws from the prior for each row."""

CLOSE = np.radians(20.0)
"""An orientation that is off by less counts as right [rad]."""

THERE = 0.03
"""A point this close to where the hand acted counts as the same place [m]."""

Keep = Callable[[str, Tensor], None]
"""Is given the values of some rows under a name."""


def validate(model: Model, batches: list[Batch], generator: torch.Generator) -> dict[str, float]:
    """How good the networks are on objects they have not learned from.

    Draws come from the prior: ``goal_close`` and ``pre_close`` are the shares of drawn orientations within 20 deg of
    what was done, ``goal_best`` the share of rows with one such draw among 16; ``reach_goal`` the mean error of the
    finger tips [mm]; ``place_goal`` the share of objects at whose likeliest point, or within 3 cm of it, the primary
    acted; ``kind`` the share of operations that are named right for the hand as it was turned, ``sort`` before any hand
    is drawn; the AUROC of the critics compare what
    worked with what did not, and with a hand turned away; ``ece`` is the expected calibration error of the goal
    critic; ``feasible_auroc`` compares what the planner took with what it refused.
    """
    rows: dict[str, list[Tensor]] = {}

    def keep(name: str, values: Tensor) -> None:
        rows.setdefault(name, []).append(values.detach().cpu().float().reshape(-1))

    was_training = model.training
    model.eval()
    with torch.no_grad():
        for batch in batches:
            _validated(model, batch, generator, keep)
    model.train(was_training)
    found = {name: torch.cat(values) for name, values in rows.items()}
    told = {
        name: float(found[name].mean())
        for name in ("goal_close", "goal_best", "pre_close", "reach_goal", "reach_pre", "place_goal", "kind", "sort")
        if len(found.get(name, []))
    }
    for name in ("goal_auroc", "goal_turned_auroc", "pre_turned_auroc", "feasible_auroc"):
        if f"{name}.score" in found:
            told[name] = auroc(found[f"{name}.score"].numpy(), found[f"{name}.label"].numpy())
    if "goal_auroc.score" in found:
        told["ece"] = calibration_error(found["goal_auroc.score"].numpy(), found["goal_auroc.label"].numpy())
    return {name: value for name, value in told.items() if np.isfinite(value)}


def _validated(model: Model, batch: Batch, generator: torch.Generator, keep: Keep) -> None:
    scene = seen(model, batch)
    before, after, pre = done_in(scene, batch, generator)
    _goal(model, scene, batch, after, generator, keep)
    _pre(model, scene, batch, before, pre, generator, keep)
    _feasibility(model, scene, batch, keep)


def _goal(model: Model, scene: Scene, batch: Batch, act: Done, generator: torch.Generator, keep: Keep) -> None:
    """The goal on the object prepared."""
    tokens, critics, view = model.tokens, model.critics, scene.after
    good, tried = batch.success & batch.goal.known, batch.tried & batch.goal.known
    at = model.goal.condition(view.seen.at(act.index), tokens.contact(act.contact), tokens.scene(view.text, view.edge))
    angles = prior_angles(model.goal.orientation, at, act.R, model.settings.losses, DRAWS, generator, spins(act.truth))[
        good
    ]
    keep("goal_close", (angles < CLOSE).float())
    keep("goal_best", (angles < CLOSE).any(dim=-1).float())
    direction = tokens.direction(code_of(act.R))
    keep("reach_goal", _millimetres(model.goal.reach(at, direction), act)[good])
    operation = model.goal.operation(at, direction)
    places = model.goal.places(view.seen.points, tokens.scene(view.text, view.edge))
    best = places.masked_fill(batch.roles != 0, -torch.inf).argmax(dim=1)
    off = SCALE * torch.linalg.vector_norm(gathered(view.cloud[..., :3], best) - act.contact, dim=-1)
    keep("place_goal", (off < THERE).float()[good])
    keep("kind", (operation.kinds.argmax(-1) == act.truth.kind)[good].float())
    sorts = model.goal.sorts(view.seen.at(act.index), tokens.scene(view.text, view.edge))
    keep("sort", (sorts.argmax(-1) == act.truth.kind)[good].float())
    told = critics.tokens.scene(view.text, view.edge)
    true, away = (
        torch.sigmoid(critics.goal(judged_token(critics.tokens, view, act.index, R), told))
        for R in (act.R, turned_away(act.R, generator))
    )
    _compared(keep, "goal_auroc", true[tried], batch.success[tried])
    _contrasted(keep, "goal_turned_auroc", true[good], away[good])


def _pre(
    model: Model, scene: Scene, batch: Batch, before: Done, act: Done, generator: torch.Generator, keep: Keep
) -> None:
    """What the assistant does, with the goal in mind."""
    tokens, critics, view = model.tokens, model.critics, scene.before
    fair = batch.success & batch.pre.known
    goal = model.goal_shown(tokens.action(view.seen.at(before.index), before.contact, code_of(before.R)))
    given = joined(tokens.scene(view.text, view.edge), goal)
    at = model.pre.condition(view.seen.at(act.index), tokens.contact(act.contact), given)
    angles = prior_angles(model.pre.orientation, at, act.R, model.settings.losses, DRAWS, generator)[fair]
    keep("pre_close", (angles < CLOSE).float())
    keep("reach_pre", _millimetres(model.pre.reach(at, tokens.direction(code_of(act.R))), act)[fair])
    aim = judged_token(critics.tokens, view, before.index, before.R)
    told = critics.tokens.scene(view.text, view.edge)
    true, away = (
        torch.sigmoid(critics.pre(judged_token(critics.tokens, view, act.index, R), told, aim))
        for R in (act.R, turned_away(act.R, generator))
    )
    both = fair & batch.goal.known
    _contrasted(keep, "pre_turned_auroc", true[both], away[both])


def _feasibility(model: Model, scene: Scene, batch: Batch, keep: Keep) -> None:
    """What the planner takes."""
    index = batch.station_point.clamp(min=0)
    features = torch.where((batch.station_point >= 0)[..., None], scene.before.judged.at(index), 0.0)
    taken, _ = feasible(model.critics.feasibility(batch.station, features))
    refused = (batch.station_labels == 0.0).any(-1)
    passed = (batch.station_labels == 1.0).sum(-1) == len(CHECKS)
    _compared(keep, "feasible_auroc", taken[refused | passed], passed[refused | passed])


def _millimetres(reach: Tensor, act: Done) -> Tensor:
    """How far the finger tips are off ``(B,)`` [mm]."""
    off: Tensor = torch.linalg.vector_norm(reach - act.reach, dim=-1)
    return 1e3 * SCALE * off


def _contrasted(keep: Keep, name: str, right: Tensor, wrong: Tensor) -> None:
    _compared(keep, name, torch.cat([right, wrong]), torch.cat([torch.ones_like(right), torch.zeros_like(wrong)]) > 0.5)


def _compared(keep: Keep, name: str, score: Tensor, label: Tensor) -> None:
    keep(f"{name}.score", score)
    keep(f"{name}.label", label.float())


def auroc(scores: np.ndarray, labels: np.ndarray) -> float:
    """Chance that a right one scores above a wrong one, ties counting half; nan where there is only one kind."""
    right, wrong = scores[labels > 0.5], scores[labels <= 0.5]
    if not len(right) or not len(wrong):
        return float("nan")
    above = (right[:, None] > wrong).mean() + 0.5 * (right[:, None] == wrong).mean()
    return float(above)


def calibration_error(probabilities: np.ndarray, labels: np.ndarray, bins: int = 10) -> float:
    """Expected calibration error (Guo et al., "On Calibration of Modern Neural Networks", ICML 2017, eq. 5)."""
    which = np.minimum((probabilities * bins).astype(int), bins - 1)
    gaps = [
        (which == k).mean() * abs(labels[which == k].mean() - probabilities[which == k].mean())
        for k in range(bins)
        if (which == k).any()
    ]
    return float(sum(gaps))
