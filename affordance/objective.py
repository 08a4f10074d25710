"""What is a batch's loss? Every network is shown what it will be shown when it is asked, and judged by what was done.

One set of goal weights learns from the object as it lies and from the object prepared. Actors learn from successes
alone; critics from every outcome, and from actions that are wrong on purpose: the hand turned away, what the actors
would do elsewhere on the object, the instruction of another column.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from affordance.dataset import Batch
from affordance.frames import code_of, rotation_of
from affordance.heads import joined
from affordance.losses import (
    Parts,
    affordance_loss,
    critic_loss,
    feasibility_loss,
    opening_loss,
    operation_loss,
    orientation_loss,
    place_loss,
    pose_loss,
    push_loss,
    reach_loss,
    relay_label,
    sort_loss,
)
from affordance.networks import KINDS, Model, Operation
from affordance.outlook import Look, goal_outlook, pre_outlook
from affordance.settings import Settings
from affordance.views import Done, Scene, done_in, seen, spins
from affordance.wrong import drawn_elsewhere, judged_token, turned_away

MAPPED = 8
"""Points of each cloud at which affordance is labelled: where the hand acted, and others at random."""


def parts_of(
    model: Model,
    average: Model,
    batch: Batch,
    step: int | Tensor,
    generator: torch.Generator,
    *,
    labelled: bool = True,
    adapting: bool = False,
) -> Parts:
    """All losses of a batch.

    Args:
        model: The networks that learn.
        average: A running mean of them, which labels affordances.
        batch: The rows.
        step: Of training.
        generator: Decides every draw.
        labelled: Whether affordances are labelled and learned.
        adapting: Whether only judges and maps learn, from the outcomes of the networks' own proposals.
    """
    scene = seen(model, batch)
    goal_before, goal_after, pre = done_in(scene, batch, generator)
    good = batch.success & batch.goal.known
    nothing = scene.move.new_zeros(())
    outlook = scene.move.new_zeros(len(good))
    maps: dict[str, Tensor] = {"affordance_goal": nothing, "affordance_pre": nothing}
    if labelled:
        maps, outlook = _maps(model, average, scene, batch, (goal_before, goal_after, pre), generator)
    judged = _critics(model, scene, batch, (goal_before, goal_after, pre), outlook, labelled, generator)
    acted = (
        dict.fromkeys(ACTORS, nothing)
        if adapting
        else _actors(model, scene, batch, (goal_before, goal_after, pre), good, step, generator)
    )
    return Parts(**acted, **maps, **judged, feasibility=_feasibility(model, scene, batch))


ACTORS = (
    "orientation_goal", "orientation_pre", "pose_object", "pose_hand", "opening_goal", "opening_pre", "reach_goal",
    "reach_pre", "operation", "push", "place_goal", "place_pre", "sort_goal",
)  # fmt: skip
"""Parts by which the actors learn."""


# -- actors ------------------------------------------------------------------------------------------------------------


def _actors(
    model: Model,
    scene: Scene,
    batch: Batch,
    done: tuple[Done, Done, Done],
    good: Tensor,
    step: int | Tensor,
    generator: torch.Generator,
) -> dict[str, Tensor]:
    before, after, pre = done
    anywhere = torch.ones_like(batch.roles, dtype=torch.bool)
    views = ((scene.before, before, anywhere), (scene.after, after, batch.roles == 0))
    each = [_goal_actors(model, *view, batch, good, step, generator) for view in views]
    told = {name: 0.5 * each[0][name] + 0.5 * each[1][name] for name in each[0]}
    return told | _preparing_actors(model, scene, batch, before, pre, good, step, generator)


def _goal_actors(
    model: Model,
    view: Look,
    act: Done,
    allowed: Tensor,
    batch: Batch,
    good: Tensor,
    step: int | Tensor,
    generator: torch.Generator,
) -> dict[str, Tensor]:
    """Losses of the goal's networks in one of both views; ``allowed`` ``(B, N)`` are points where a goal can be."""
    tokens, losses, net = model.tokens, model.settings.losses, model.goal
    token = tokens.scene(view.text, view.edge)
    at = net.condition(view.seen.at(act.index), tokens.contact(act.contact), token)
    direction, truth = tokens.direction(code_of(act.R)), act.truth
    kinds = functional.one_hot(truth.kind, len(KINDS)).float()
    operation = Operation(kinds, truth.direction, truth.outward, truth.point, truth.amount)
    places, sorts = net.places(view.seen.points, token), net.sorts(view.seen.points, token)
    return {
        "orientation_goal": orientation_loss(net.orientation, at, act.R, good, losses, step, generator, spins(truth)),
        "opening_goal": opening_loss(net.opening(at, direction), truth.opening, good),
        "reach_goal": reach_loss(net.reach(at, direction), act.reach, good),
        "operation": operation_loss(net.operation(at, direction).of(truth.kind), operation, good, losses),
        "place_goal": place_loss(places, batch.goal.spots, allowed, good),
        "sort_goal": sort_loss(sorts, truth.kind, batch.goal.spots & allowed, good),
    }


def _preparing_actors(
    model: Model,
    scene: Scene,
    batch: Batch,
    before: Done,
    pre: Done,
    good: Tensor,
    step: int | Tensor,
    generator: torch.Generator,
) -> dict[str, Tensor]:
    """Losses of the networks that prepare, with the goal action ``before`` in mind."""
    tokens, view, fit = model.tokens, scene.before, (model.settings.losses, step, generator)
    goal, goal_shown, assisted = _acts_shown(model, scene, before, pre, model.settings, batch, generator)
    token = tokens.scene(view.text, view.edge)
    given = joined(token, goal_shown)
    at = model.pre.condition(view.seen.at(pre.index), tokens.contact(pre.contact), given)
    direction, truth = tokens.direction(code_of(pre.R)), pre.truth
    places, anywhere = model.pre.places(view.seen.points, given), torch.ones_like(batch.pre.spots)
    fair = batch.success & batch.pre.known
    heading = functional.normalize(scene.frame.directions(truth.direction[:, None])[:, 0, :2], dim=-1)
    push, not_held = model.pre.push(at, direction), fair & ~batch.lifted
    asked = model.pose.condition(view.seen.whole, tokens.place(scene.place), token, goal_shown, assisted)
    moved = tokens.cloud_or_none(scene.moved, torch.ones_like(good))
    hand = model.reorient.condition(view.seen.whole, tokens.text(view.text), goal, assisted, moved)
    hand_move = scene.frame.moves(batch.T_move, truth.tool)
    return {
        "orientation_pre": orientation_loss(model.pre.orientation, at, pre.R, fair, *fit),
        "opening_pre": opening_loss(model.pre.opening(at, direction), truth.opening, fair),
        "place_pre": place_loss(places, batch.pre.spots, anywhere, fair),
        "reach_pre": reach_loss(model.pre.reach(at, direction), pre.reach, fair),
        "push": push_loss(push, heading, truth.amount, truth.behind, batch.pushed, not_held),
        "pose_object": pose_loss(model.pose.move, asked, scene.move, fair, *fit),
        "pose_hand": pose_loss(model.reorient.move, hand, hand_move, good & batch.lifted, *fit),
    }


def _acts_shown(
    model: Model,
    scene: Scene,
    before: Done,
    pre: Done,
    settings: Settings,
    batch: Batch,
    generator: torch.Generator,
) -> tuple[Tensor, Tensor, Tensor]:
    """Tokens of the goal action, of the same as the preparing networks see it, and of the assistant's action."""
    tokens, view = model.tokens, scene.before
    goal = tokens.action(view.seen.at(before.index), before.contact, code_of(before.R))
    hidden = torch.rand(len(goal), generator=generator, device=goal.device) < settings.training.dropout
    shown = model.goal_shown(goal, batch.goal.known & ~hidden)
    return goal, shown, tokens.action(view.seen.at(pre.index), pre.contact, code_of(pre.R))


# -- maps --------------------------------------------------------------------------------------------------------------


def _maps(
    model: Model,
    average: Model,
    scene: Scene,
    batch: Batch,
    done: tuple[Done, Done, Done],
    generator: torch.Generator,
) -> tuple[dict[str, Tensor], Tensor]:
    """Losses of both maps, and the outlook ``(B,)`` of the goal action on the prepared object."""
    before, after, pre = done
    tokens = model.tokens
    with torch.no_grad():
        labels = seen(average, batch)
    known = batch.goal.known[:, None].expand(-1, MAPPED)
    goal_loss, outlook = scene.move.new_zeros(()), scene.move.new_zeros(len(known))
    for view, label, act, roles in (
        (scene.before, labels.before, before, torch.zeros_like(batch.roles)),
        (scene.after, labels.after, after, batch.roles),
    ):
        index = _mapped(act.index, roles, generator)
        wanted = goal_outlook(average, label, index, generator)
        scores = model.goal.scores(view.seen.at(index), tokens.scene(view.text, view.edge))
        goal_loss = goal_loss + 0.5 * affordance_loss(scores, wanted, torch.ones_like(known))
        outlook = wanted.amax(dim=1)
    index = _mapped(pre.index, torch.zeros_like(batch.roles), generator)
    wanted = pre_outlook(average, labels.before, index, before.index, code_of(before.R), generator)
    view = scene.before
    goal = model.goal_shown(tokens.action(view.seen.at(before.index), before.contact, code_of(before.R)))
    given = joined(tokens.scene(view.text, view.edge), goal)
    pre_loss = affordance_loss(model.pre.scores(view.seen.at(index), given), wanted, known)
    return {"affordance_goal": goal_loss, "affordance_pre": pre_loss}, outlook


def _mapped(index: Tensor, roles: Tensor, generator: torch.Generator) -> Tensor:
    """``(B, MAPPED)`` the point of the action and others of the object."""
    draws = torch.rand(roles.shape, generator=generator, device=roles.device)
    others = torch.where(roles == 0, draws, draws - 1.0).topk(MAPPED - 1, dim=1).indices
    return torch.cat([index[:, None], others], dim=1)


# -- critics -----------------------------------------------------------------------------------------------------------


def _critics(
    model: Model,
    scene: Scene,
    batch: Batch,
    done: tuple[Done, Done, Done],
    outlook: Tensor,
    labelled: bool,
    generator: torch.Generator,
) -> dict[str, Tensor]:
    before, after, pre = done
    critics = model.critics
    tokens, real = critics.tokens, batch.goal.known & batch.tried
    goal_loss = scene.move.new_zeros(())
    for view, act in ((scene.before, before), (scene.after, after)):
        right = tokens.scene(view.text, view.edge)
        wrong = tokens.scene(batch.wrong_text, view.edge)
        true = judged_token(tokens, view, act.index, act.R)
        away = judged_token(tokens, view, act.index, turned_away(act.R, generator))
        given = model.tokens.scene(view.text, view.edge)
        elsewhere = drawn_elsewhere(model, model.goal, view, act, given, generator)
        single = torch.stack([critics.goal(true, right), critics.goal(away, right), critics.goal(true, wrong)], 1)
        logits = torch.cat([single, critics.goal(elsewhere, right)], 1)
        goal_loss = goal_loss + 0.5 * _judged(logits, batch.success.float(), real, batch.goal.known & batch.success)
    view = scene.before
    right = tokens.scene(view.text, view.edge)
    aim, true = judged_token(tokens, view, before.index, before.R), judged_token(tokens, view, pre.index, pre.R)
    away = judged_token(tokens, view, pre.index, turned_away(pre.R, generator))
    goal = model.tokens.action(view.seen.at(before.index), before.contact, code_of(before.R))
    given = joined(model.tokens.scene(view.text, view.edge), model.goal_shown(goal))
    elsewhere = drawn_elsewhere(model, model.pre, view, pre, given, generator)
    single = torch.stack([critics.pre(action, right, aim) for action in (true, away)], 1)
    logits = torch.cat([single, critics.pre(elsewhere, right, aim)], 1)
    value = outlook if labelled else batch.success.float()
    worth = relay_label(batch.prepared, batch.success, value)
    both = batch.goal.known & batch.pre.known
    pre_loss = _judged(logits, worth, both, both & batch.success)
    pose_loss_ = scene.move.new_zeros(())
    if critics.pose is not None:
        text, place = tokens.text(view.text), tokens.place(scene.place)
        other = scene.move[torch.rand(len(aim), generator=generator, device=aim.device).argsort()]
        turn = rotation_of(other[:, :6])
        astray = torch.cat([code_of(turned_away(turn, generator)), other[:, 6:]], dim=-1)
        judged = torch.stack(
            [critics.pose(view.judged.whole, move, text, place, aim, true) for move in (scene.move, astray)], 1
        )
        pose_loss_ = _judged(judged, batch.success.float(), real & both, both & batch.success)
    return {"critic_goal": goal_loss, "critic_pre": pre_loss, "critic_pose": pose_loss_}


def _judged(logits: Tensor, label: Tensor, real: Tensor, contrasted: Tensor) -> Tensor:
    """Cross entropy of ``(B, 1 + K)``: the real action with its label, the others as wrong beside a right one."""
    wrong = logits[:, 1:]
    contrast = critic_loss(wrong, torch.zeros_like(wrong), contrasted[:, None].expand_as(wrong))
    return critic_loss(logits[:, 0], label, real) + contrast


def _feasibility(model: Model, scene: Scene, batch: Batch) -> Tensor:
    index = batch.station_point.clamp(min=0)
    features = torch.where((batch.station_point >= 0)[..., None], scene.before.judged.at(index).detach(), 0.0)
    logits = model.critics.feasibility(batch.station, features)
    known = batch.station_labels >= 0.0
    return feasibility_loss(logits, batch.station_labels.clamp(min=0.0), known)
