"""What is a batch's loss? Every network is shown what it will be shown when it is asked, and judged by what was done.

One set of goal weights learns from the object as it lies and from the object prepared. Actors learn from successes
alone; critics from every outcome, and from actions that are wrong on purpose: the hand turned away, what the actors
would do elsewhere on the object, the instruction of another column.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from affordance.critics import CHECKS, feasible
from affordance.dataset import Batch, Hands
from affordance.frames import SCALE, Frame, canonical, cloud_of, code_of, frame_of, moved_cloud, rotation_of, turned
from affordance.heads import drawn, joined
from affordance.losses import (
    Parts,
    affordance_loss,
    critic_loss,
    feasibility_loss,
    opening_loss,
    operation_loss,
    orientation_loss,
    pose_loss,
    prior_angles,
    push_loss,
    reach_loss,
    relay_label,
)
from affordance.networks import KINDS, Contact, Model, Operation
from affordance.outlook import Look, goal_outlook, pre_outlook
from affordance.pointnet2 import Encoded, Indices, gathered
from affordance.settings import Settings

ELSEWHERE = 0.16
"""A wrong point is at least this far from the right one, in units of ``SCALE``: 4 cm."""

OTHERS = 4
"""Wrong points of each row."""

TURNED = (0.9, np.pi)
"""A hand turned away on purpose is turned by this much [rad]."""

MAPPED = 8
"""Points of each cloud at which affordance is labelled: where the hand acted, and others at random."""

TCP_BACK = 0.0088
"""From the finger tips back to the tool centre point [m]: the gripper of the data sets."""

DRAWS = 16
"""Draws from the prior for each row, in validation."""

CLOSE = np.radians(20.0)
"""An orientation that is off by less counts as right in validation [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What is seen of a batch.

    Attributes:
        frame, frame_after: Network coordinates before and after the preparation.
        before, after: The object where it lay, and where it is expected, with the assistant's hand.
        moved: ``(B, 128)`` features to the actors of the object where it should be, in the coordinates of ``before``.
        move: ``(B, 9)`` that motion.
        place: ``(B, 5)``.
    """

    frame: Frame
    frame_after: Frame
    before: Look
    after: Look
    moved: Tensor
    move: Tensor
    place: Tensor


@dataclass(frozen=True, slots=True, eq=False)
class Done:
    """One hand's action in the coordinates of a view.

    Attributes:
        index: ``(B,)`` a point where it acted.
        contact: ``(B, 3)`` where that point is.
        R: ``(B, 3, 3)`` how the hand was turned, one of its two equal ways.
        reach: ``(B, 3)`` from the point to between the tips, in the frame of the hand.
        truth: The action, its vectors in the frame of the hand.
    """

    index: Tensor
    contact: Tensor
    R: Tensor
    reach: Tensor
    truth: Hands


def parts_of(
    model: Model, average: Model, batch: Batch, step: int, generator: torch.Generator, *, adapting: bool = False
) -> Parts:
    """All losses of a batch.

    Args:
        model: The networks that learn.
        average: A running mean of them, which labels affordances.
        batch: The rows.
        step: Of training.
        generator: Decides every draw.
        adapting: Whether only judges and maps learn, from the outcomes of the networks' own proposals.
    """
    losses = model.settings.losses
    scene = seen(model, batch)
    goal_before, goal_after, pre = done_in(scene, batch, generator)
    good = batch.success & batch.goal.known
    nothing = scene.move.new_zeros(())
    labelled = step % losses.label_every == 0
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
    "reach_pre", "operation", "push",
)  # fmt: skip
"""Parts by which the actors learn."""


# -- what is seen ------------------------------------------------------------------------------------------------------


def seen(model: Model, batch: Batch) -> Scene:
    """Encode a batch: before and after the preparation, and the object alone where it should be."""
    frame = frame_of(batch.points, torch.zeros_like(batch.roles), batch.yaw)
    frame_after = frame_of(batch.after, batch.roles, batch.yaw)
    cloud = cloud_of(frame, batch.points, torch.zeros_like(batch.roles))
    cloud_after = cloud_of(frame_after, batch.after, batch.roles)
    move = frame.moves(batch.T_move, frame.centre)
    both = _stacked(batch.indices, batch.indices_after)
    actors = model.encoder(torch.cat([cloud, cloud_after, moved_cloud(cloud, move)]), _stacked(both, batch.indices))
    before, after, moved = _split(actors, 3)
    if model.critics.encoder is None:
        judges = [before, after]
    else:
        judges = _split(model.critics.encoder(torch.cat([cloud, cloud_after]), both), 2)
    looks = [
        Look(which, as_actor, as_critic, batch.text, _edges(at, batch))
        for which, as_actor, as_critic, at in (
            (cloud, before, judges[0], frame),
            (cloud_after, after, judges[1], frame_after),
        )
    ]
    place = torch.where(batch.has_place[:, None], frame.places(batch.place[:, 0], batch.place[:, 1]), 0.0)
    return Scene(frame, frame_after, looks[0], looks[1], moved.whole, move, place)


def _edges(frame: Frame, batch: Batch) -> Tensor:
    return torch.where(batch.has_edge[:, None], frame.edges(batch.edge[:, 0], batch.edge[:, 1]), 0.0)


def _stacked(first: Indices, second: Indices) -> Indices:
    return Indices(
        *(
            tuple(torch.cat(pair) for pair in zip(getattr(first, f.name), getattr(second, f.name), strict=True))
            for f in fields(Indices)
        )
    )


def _split(encoded: Encoded, parts: int) -> list[Encoded]:
    return [Encoded(*pair) for pair in zip(encoded.points.chunk(parts), encoded.whole.chunk(parts), strict=True)]


def done_in(scene: Scene, batch: Batch, generator: torch.Generator) -> tuple[Done, Done, Done]:
    """The goal action before and after, and the assistant's: at one of its points and in one of the hand's two ways.

    Both goal actions are at the same point, so that one row teaches the same thing twice.
    """
    visible = batch.roles == 0
    at_goal, at_pre = _one_of(batch.goal.spots & visible, generator), _one_of(batch.pre.spots, generator)
    coin = torch.rand(len(batch.yaw), generator=generator, device=batch.yaw.device) < 0.5
    goal, pre = _turned_over(batch.goal, coin), _turned_over(batch.pre, coin)
    R_move, t_move = batch.T_move[:, :3, :3], batch.T_move[:, :3, 3]
    moved = Hands(
        **{f.name: getattr(goal, f.name) for f in fields(Hands)}
        | {"R": R_move @ goal.R, "tip": turned(R_move, goal.tip) + t_move}
    )
    return (
        _placed(scene.frame, batch.points, at_goal, goal),
        _placed(scene.frame_after, batch.after, at_goal, moved),
        _placed(scene.frame, batch.points, at_pre, pre),
    )


def _one_of(mask: Tensor, generator: torch.Generator) -> Tensor:
    """``(B,)`` a true entry of each row of ``(B, N)``; any where there is none."""
    draws = torch.rand(mask.shape, generator=generator, device=mask.device)
    return torch.where(mask, draws + 1.0, draws).argmax(dim=1)


def _turned_over(hands: Hands, coin: Tensor) -> Hands:
    """Rows of the coin with the hand turned by half a turn about its approach: the same to two equal fingers."""
    sign = hands.R.new_tensor([-1.0, -1.0, 1.0])
    flip = torch.where(coin[:, None], sign, torch.ones_like(sign))
    local = {name: getattr(hands, name) * flip for name in ("outward", "point")}
    is_goal = hands.outward.any(dim=-1, keepdim=True)  # an assistant's direction is in the world frame
    direction = torch.where(is_goal, hands.direction * flip, hands.direction)
    return Hands(
        **{f.name: getattr(hands, f.name) for f in fields(Hands)}
        | {"R": hands.R * flip[:, None, :], "direction": direction, **local}
    )


def _placed(frame: Frame, points: Tensor, index: Tensor, hands: Hands) -> Done:
    contact = gathered(points, index)
    reach = turned(hands.R.mT, hands.tip - contact) / SCALE
    R = rotation_of(frame.codes(hands.R))
    return Done(index, frame.points(contact[:, None])[:, 0], R, reach, hands)


# -- actors ------------------------------------------------------------------------------------------------------------


def _actors(
    model: Model,
    scene: Scene,
    batch: Batch,
    done: tuple[Done, Done, Done],
    good: Tensor,
    step: int,
    generator: torch.Generator,
) -> dict[str, Tensor]:
    settings, tokens = model.settings, model.tokens
    losses, fit = settings.losses, (settings.losses, step, generator)
    before, after, pre = done
    told = {
        "orientation_goal": scene.move.new_zeros(()),
        "opening_goal": scene.move.new_zeros(()),
        "reach_goal": scene.move.new_zeros(()),
        "operation": scene.move.new_zeros(()),
    }
    for view, act in ((scene.before, before), (scene.after, after)):
        at = model.goal.condition(
            view.seen.at(act.index), tokens.contact(act.contact), tokens.scene(view.text, view.edge)
        )
        direction, truth = tokens.direction(code_of(act.R)), act.truth
        told["orientation_goal"] += 0.5 * orientation_loss(model.goal.orientation, at, act.R, good, *fit)
        told["opening_goal"] += 0.5 * opening_loss(model.goal.opening(at, direction), truth.opening, good)
        told["reach_goal"] += 0.5 * reach_loss(model.goal.reach(at, direction), act.reach, good)
        done_there = Operation(
            functional.one_hot(truth.kind, len(KINDS)).float(),
            truth.direction,
            truth.outward,
            truth.point,
            truth.amount,
        )
        told["operation"] += 0.5 * operation_loss(model.goal.operation(at, direction), done_there, good, losses)
    goal, goal_shown, assisted = _acts_shown(model, scene, before, pre, settings, batch, generator)
    view = scene.before
    given = joined(tokens.scene(view.text, view.edge), goal_shown)
    at = model.pre.condition(view.seen.at(pre.index), tokens.contact(pre.contact), given)
    direction, truth = tokens.direction(code_of(pre.R)), pre.truth
    fair = batch.success & batch.pre.known
    heading = functional.normalize(scene.frame.directions(truth.direction[:, None])[:, 0, :2], dim=-1)
    moved = tokens.cloud_or_none(scene.moved, torch.ones_like(good))
    pivot = pre.truth.tip - TCP_BACK * pre.truth.R[:, :, 2]
    hand_move = scene.frame.moves(batch.T_move, pivot)
    held = good & batch.lifted
    return told | {
        "orientation_pre": orientation_loss(model.pre.orientation, at, pre.R, fair, *fit),
        "opening_pre": opening_loss(model.pre.opening(at, direction), truth.opening, fair),
        "reach_pre": reach_loss(model.pre.reach(at, direction), pre.reach, fair),
        "push": push_loss(
            model.pre.push(at, direction), heading, truth.amount, truth.behind, batch.pushed, fair & ~batch.lifted
        ),
        "pose_object": pose_loss(
            model.pose.move,
            model.pose.condition(
                view.seen.whole, tokens.place(scene.place), tokens.scene(view.text, view.edge), goal_shown, assisted
            ),
            scene.move,
            fair,
            *fit,
        ),
        "pose_hand": pose_loss(
            model.reorient.move,
            model.reorient.condition(view.seen.whole, tokens.text(view.text), goal, assisted, moved),
            hand_move,
            held,
            *fit,
        ),
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
        true = _token(tokens, view, act.index, act.R)
        away = _token(tokens, view, act.index, _turned_away(act.R, generator))
        given = model.tokens.scene(view.text, view.edge)
        elsewhere = _drawn_elsewhere(model, model.goal, view, act, given, generator)
        single = torch.stack([critics.goal(true, right), critics.goal(away, right), critics.goal(true, wrong)], 1)
        logits = torch.cat([single, critics.goal(elsewhere, right)], 1)
        goal_loss = goal_loss + 0.5 * _judged(logits, batch.success.float(), real, batch.goal.known & batch.success)
    view = scene.before
    right = tokens.scene(view.text, view.edge)
    aim, true = _token(tokens, view, before.index, before.R), _token(tokens, view, pre.index, pre.R)
    away = _token(tokens, view, pre.index, _turned_away(pre.R, generator))
    goal = model.tokens.action(view.seen.at(before.index), before.contact, code_of(before.R))
    given = joined(model.tokens.scene(view.text, view.edge), model.goal_shown(goal))
    elsewhere = _drawn_elsewhere(model, model.pre, view, pre, given, generator)
    single = torch.stack([critics.pre(action, right, aim) for action in (true, away)], 1)
    logits = torch.cat([single, critics.pre(elsewhere, right, aim)], 1)
    value = outlook if labelled else batch.success.float()
    worth = relay_label(batch.prepared, batch.success, value)
    both = batch.goal.known & batch.pre.known
    pre_loss = _judged(logits, worth, both, both & batch.success)
    pose_loss_ = scene.move.new_zeros(())
    if critics.pose is not None:
        text, place = tokens.text(view.text), tokens.place(scene.place)
        other = scene.move[torch.randperm(len(aim), generator=generator, device=aim.device)]
        turn = rotation_of(other[:, :6])
        astray = torch.cat([code_of(_turned_away(turn, generator)), other[:, 6:]], dim=-1)
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


def _token(tokens: object, view: Look, index: Tensor, R: Tensor) -> Tensor:
    contact = gathered(view.cloud[..., :3], index)
    token: Tensor = tokens.action(view.judged.at(index), contact, code_of(R))  # type: ignore[attr-defined]
    return token


def _turned_away(R: Tensor, generator: torch.Generator) -> Tensor:
    """Rotations ``(B, 3, 3)`` turned about random axes across the approach, so that the flip does not undo it."""
    count, device = len(R), R.device
    around = 2.0 * np.pi * torch.rand(count, generator=generator, device=device)
    axis = torch.cos(around)[:, None] * R[:, :, 0] + torch.sin(around)[:, None] * R[:, :, 1]
    angle = TURNED[0] + (TURNED[1] - TURNED[0]) * torch.rand(count, generator=generator, device=device)
    return _about(axis, angle) @ R


def _about(axis: Tensor, angle: Tensor) -> Tensor:
    """Rotations ``(B, 3, 3)`` about unit vectors ``(B, 3)`` by ``(B,)`` [rad] (Rodrigues' formula)."""
    zero = torch.zeros_like(angle)
    x, y, z = axis.unbind(-1)
    K = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).reshape(-1, 3, 3)
    s, c = torch.sin(angle)[:, None, None], torch.cos(angle)[:, None, None]
    return torch.eye(3, device=axis.device) + s * K + (1.0 - c) * (K @ K)


def _drawn_elsewhere(
    model: Model, net: Contact, view: Look, act: Done, given: Tensor, generator: torch.Generator
) -> Tensor:
    """Tokens ``(B, OTHERS, 192)`` to the critics of what an actor would do at points where the hand did not act."""
    with torch.no_grad():
        index = _elsewhere(view, act, generator)
        contact = gathered(view.cloud[..., :3], index)
        condition = net.condition(view.seen.at(index), model.tokens.contact(contact), given)
        codes = canonical(drawn(net.orientation, condition, 1, generator)[..., 0, :])
    return model.critics.tokens.action(view.judged.at(index), contact, codes)


def _elsewhere(view: Look, act: Done, generator: torch.Generator) -> Tensor:
    """``(B, OTHERS)`` points of the object away from where the hand acted; the farthest ones where all are near."""
    away = torch.linalg.vector_norm(view.cloud[..., :3] - act.contact[:, None], dim=-1)
    is_object = view.cloud[..., 3] > 0.5
    draws = torch.rand(away.shape, generator=generator, device=away.device)
    order = torch.where(is_object & (away > ELSEWHERE), draws + 10.0, torch.where(is_object, away, -1.0))
    return order.topk(OTHERS, dim=1).indices


def _feasibility(model: Model, scene: Scene, batch: Batch) -> Tensor:
    index = batch.station_point.clamp(min=0)
    features = torch.where((batch.station_point >= 0)[..., None], scene.before.judged.at(index).detach(), 0.0)
    logits = model.critics.feasibility(batch.station, features)
    known = batch.station_labels >= 0.0
    return feasibility_loss(logits, batch.station_labels.clamp(min=0.0), known)


# -- validation --------------------------------------------------------------------------------------------------------


def validate(model: Model, batches: list[Batch], generator: torch.Generator) -> dict[str, float]:
    """How good the networks are on objects they have not learned from.

    Draws come from the prior: ``goal_close`` and ``pre_close`` are the shares of drawn orientations within 20 deg of
    what was done, ``goal_best`` the share of rows with one such draw among 16; ``reach_goal`` the mean error of the
    finger tips [mm]; ``kind`` the share of operations that are named right; the AUROC of the critics compare what
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
        for name in ("goal_close", "goal_best", "pre_close", "reach_goal", "reach_pre", "kind")
        if len(found.get(name, []))
    }
    for name in ("goal_auroc", "goal_turned_auroc", "pre_turned_auroc", "feasible_auroc"):
        if f"{name}.score" in found:
            told[name] = auroc(found[f"{name}.score"].numpy(), found[f"{name}.label"].numpy())
    if "goal_auroc.score" in found:
        told["ece"] = calibration_error(found["goal_auroc.score"].numpy(), found["goal_auroc.label"].numpy())
    return {name: value for name, value in told.items() if np.isfinite(value)}


def _validated(model: Model, batch: Batch, generator: torch.Generator, keep) -> None:  # type: ignore[no-untyped-def]
    losses, tokens, critics = model.settings.losses, model.tokens, model.critics
    scene = seen(model, batch)
    before, after, pre = done_in(scene, batch, generator)
    good = batch.success & batch.goal.known
    view = scene.after
    at = model.goal.condition(
        view.seen.at(after.index), tokens.contact(after.contact), tokens.scene(view.text, view.edge)
    )
    angles = prior_angles(model.goal.orientation, at, after.R, losses, DRAWS, generator)[good]
    keep("goal_close", (angles < CLOSE).float())
    keep("goal_best", (angles < CLOSE).any(dim=-1).float())
    direction = tokens.direction(code_of(after.R))
    keep(
        "reach_goal",
        1e3 * SCALE * torch.linalg.vector_norm(model.goal.reach(at, direction) - after.reach, dim=-1)[good],
    )
    operation = model.goal.operation(at, direction)
    keep("kind", (operation.kinds.argmax(-1) == after.truth.kind)[good].float())
    scene_c = critics.tokens.scene(view.text, view.edge)
    true = torch.sigmoid(critics.goal(_token(critics.tokens, view, after.index, after.R), scene_c))
    turned_away = _token(critics.tokens, view, after.index, _turned_away(after.R, generator))
    away = torch.sigmoid(critics.goal(turned_away, scene_c))
    tried = batch.tried & batch.goal.known
    _compared(keep, "goal_auroc", true[tried], batch.success[tried])
    _compared(keep, "goal_turned_auroc", torch.cat([true[good], away[good]]), torch.cat([good[good], ~good[good]]))
    view = scene.before
    goal = model.goal_shown(tokens.action(view.seen.at(before.index), before.contact, code_of(before.R)))
    given = joined(tokens.scene(view.text, view.edge), goal)
    at = model.pre.condition(view.seen.at(pre.index), tokens.contact(pre.contact), given)
    fair = batch.success & batch.pre.known
    keep("pre_close", (prior_angles(model.pre.orientation, at, pre.R, losses, DRAWS, generator)[fair] < CLOSE).float())
    reach = model.pre.reach(at, tokens.direction(code_of(pre.R)))
    keep("reach_pre", 1e3 * SCALE * torch.linalg.vector_norm(reach - pre.reach, dim=-1)[fair])
    aim, scene_c = _token(critics.tokens, view, before.index, before.R), critics.tokens.scene(view.text, view.edge)
    true, away = (
        torch.sigmoid(critics.pre(_token(critics.tokens, view, pre.index, R), scene_c, aim))
        for R in (pre.R, _turned_away(pre.R, generator))
    )
    both = good & fair
    _compared(keep, "pre_turned_auroc", torch.cat([true[both], away[both]]), torch.cat([both[both], ~both[both]]))
    index = batch.station_point.clamp(min=0)
    features = torch.where((batch.station_point >= 0)[..., None], scene.before.judged.at(index), 0.0)
    taken, _ = feasible(critics.feasibility(batch.station, features))
    refused = (batch.station_labels == 0.0).any(-1)
    passed = (batch.station_labels == 1.0).sum(-1) == len(CHECKS)
    _compared(keep, "feasible_auroc", taken[refused | passed], passed[refused | passed])


def _compared(keep, name: str, score: Tensor, label: Tensor) -> None:  # type: ignore[no-untyped-def]
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
