"""Laws of the networks as a whole: what they see, what they share and what they keep apart."""
# ruff: noqa: E402 - what needs torch is imported once it is known to be there

from __future__ import annotations

from dataclasses import fields

import msgspec
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from affordance.critics import CHECKS, MEMBERS, STATION, FeasibilityCritic, feasible
from affordance.frames import canonical, code_of, moved_cloud
from affordance.heads import drawn, joined
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
    sort_loss,
    total,
)
from affordance.networks import KINDS, WIDEST, Model, Operation
from affordance.outlook import Look, goal_outlook, look, pre_outlook
from affordance.pointnet2 import gathered
from affordance.settings import PRESETS, PROFILES, Settings, settings_of
from affordance.text import HashText
from tests.affordance.clouds import clouds, rotations, seeded

B, K = 3, 4
INDEX = torch.tensor([[0, 7, 30, 200], [5, 6, 7, 8], [255, 1, 2, 3]])
TEXT = torch.from_numpy(HashText().encode(["pick up the bowl", "press the stapler shut", "hand over the pliers"]))
PLACE = torch.tensor([[0.0, 0.0, 1.2, 1.0, 0.0]] * B)
EDGE = torch.tensor([[1.0, 0.0, 0.4, 0.1], [0.0] * 4, [0.0, 1.0, 0.2, 0.2]])


def model_of(preset: str = "default", **changes: object) -> Model:
    torch.manual_seed(0)
    return Model(msgspec.structs.replace(settings_of("test", preset), **changes))


@pytest.fixture(scope="module")
def model() -> Model:
    return model_of().eval()


@pytest.fixture(scope="module")
def view(model: Model) -> Look:
    with torch.no_grad():
        return look(model, clouds(B, 256), TEXT, EDGE)


def an_action(model: Model, view: Look, column: int) -> torch.Tensor:
    index = INDEX[:, column]
    code = code_of(rotations(B, seed=column).float())
    return model.tokens.action(view.seen.at(index), gathered(view.cloud[..., :3], index), code)


def test_the_goal_network_scores_every_point_and_draws_hands_there(model: Model, view: Look) -> None:
    scene = model.tokens.scene(TEXT, EDGE)
    scores = model.goal.scores(view.seen.points, scene)
    assert scores.shape == (B, 256)
    assert bool(((scores > 0.0) & (scores < 1.0)).all())
    contact = model.tokens.contact(gathered(view.cloud[..., :3], INDEX))
    condition = model.goal.condition(view.seen.at(INDEX), contact, scene)
    assert condition.shape == (B, K, 224)
    codes = canonical(drawn(model.goal.orientation, condition, 6, seeded()))
    assert codes.shape == (B, K, 6, 6)
    opening = model.goal.opening(condition, model.tokens.direction(codes))
    assert opening.shape == (B, K, 6)
    assert bool(((opening > 0.0) & (opening < WIDEST)).all())


def test_the_preparing_networks_have_the_widths_of_the_design(model: Model, view: Look) -> None:
    scene, text = model.tokens.scene(TEXT, EDGE), model.tokens.text(TEXT)
    goal, pre = an_action(model, view, 0), an_action(model, view, 1)
    assert goal.shape == (B, 192)
    given = joined(scene, model.goal_shown(goal))
    assert model.pre.scores(view.seen.points, given).shape == (B, 256)
    assert joined(view.seen.points, given).shape == (B, 256, 384)
    contact = model.tokens.contact(gathered(view.cloud[..., :3], INDEX))
    condition = model.pre.condition(view.seen.at(INDEX), contact, given)
    assert condition.shape == (B, K, 416)
    heading, length, _ = model.pre.push(condition, model.tokens.direction(torch.zeros(B, K, 6)))
    assert torch.allclose(heading.norm(dim=-1), torch.ones(B, K))
    assert bool((length > 0.0).all())
    pose = model.pose.condition(view.seen.whole, model.tokens.place(PLACE), scene, goal, pre)
    assert pose.shape == (B, 608)
    moves = drawn(model.pose.move, pose, 5, seeded())
    assert moves.shape == (B, 5, 9)
    with torch.no_grad():
        moved = model.encoder(moved_cloud(view.cloud, moves[:, 0])).whole
    reorient = model.reorient.condition(view.seen.whole, text, goal, pre, moved)
    assert reorient.shape == (B, 352)
    assert drawn(model.reorient.move, reorient, 5, seeded()).shape == (B, 5, 9)


def test_the_critics_have_the_widths_of_the_design(model: Model, view: Look) -> None:
    critics = model.critics
    widths = {"goal": 256, "pre": 448, "pose": 640}
    assert {name: getattr(critics, name).judge[0].in_features for name in widths} == widths
    goal, pre, scene = an_action(model, view, 0), an_action(model, view, 1), critics.tokens.scene(TEXT, EDGE)
    assert critics.goal(goal, scene).shape == (B,)
    assert critics.pre(pre[:, None].expand(B, K, 192), scene, goal).shape == (B, K)
    moves = torch.zeros(B, K, 9)
    text, place = critics.tokens.text(TEXT), critics.tokens.place(PLACE)
    assert critics.pose(view.judged.whole, moves, text, place, goal, pre).shape == (B, K)
    assert critics.feasibility(torch.zeros(B, K, STATION), view.judged.at(INDEX)).shape == (B, K, MEMBERS, len(CHECKS))


def test_members_of_an_ensemble_that_agree_are_sure() -> None:
    agree = torch.logit(torch.tensor([0.9, 0.5, 0.8])).expand(MEMBERS, 3)
    mean, spread = feasible(agree)
    assert float(mean) == pytest.approx(0.36)
    assert float(spread) == pytest.approx(0.0, abs=1e-6)
    torch.manual_seed(0)
    _, unsure = feasible(FeasibilityCritic()(torch.randn(1, STATION), torch.randn(1, 128)))
    assert float(unsure.detach()) > 0.0


def test_anticipation_and_execution_ask_one_set_of_weights() -> None:
    """A step on what is foreseen changes what is done by as much: there is no second Goal network."""
    learner = model_of()
    assert sum(name.startswith("goal.scorer.0.weight") for name in learner.state_dict()) == 1
    learner.eval()
    foreseen = look(learner, clouds(1, 256, seed=4), TEXT[:1], EDGE[:1])
    before = learner.goal.scores(foreseen.seen.points, learner.tokens.scene(TEXT[:1], EDGE[:1])).detach()
    optimiser = torch.optim.SGD(learner.parameters(), 0.1)
    learner.goal.scores(foreseen.seen.points, learner.tokens.scene(TEXT[:1], EDGE[:1])).mean().backward()
    optimiser.step()
    with torch.no_grad():
        later = look(learner, clouds(1, 256, seed=4), TEXT[:1], EDGE[:1])
        after = learner.goal.scores(later.seen.points, learner.tokens.scene(TEXT[:1], EDGE[:1]))
    assert float(after.mean()) < float(before.mean())


def gradients(model: Model) -> dict[str, bool]:
    """Whether the actors' and the critics' weights have been reached."""
    reached = {True: False, False: False}
    for name, weight in model.named_parameters():
        reached[name.startswith("critics.")] |= weight.grad is not None and bool(weight.grad.any())
    return {"critics": reached[True], "actors": reached[False]}


def judged(model: Model) -> torch.Tensor:
    view = look(model, clouds(B, 256), TEXT, EDGE)
    critics, every = model.critics, torch.ones(B, dtype=torch.bool)
    contact, code = gathered(view.cloud[..., :3], INDEX[:, 0]), code_of(rotations(B).float())
    action = critics.tokens.action(view.judged.at(INDEX[:, 0]), contact, code)
    scene, labels = critics.tokens.scene(TEXT, EDGE), torch.tensor([0.0, 1.0, 1.0])
    station = critics.feasibility(torch.zeros(B, STATION), view.judged.at(INDEX[:, 0]))
    return (
        critic_loss(critics.goal(action, scene), labels, every)
        + critic_loss(critics.pre(action, scene, action), labels, every)
        + feasibility_loss(station, labels[:, None].expand(B, 3), every[:, None].expand(B, 3))
    )


def test_critics_never_reach_the_actors_unless_an_encoder_is_shared() -> None:
    apart, shared = model_of(), model_of("biassembly")
    for model in (apart, shared):
        judged(model).backward()
    assert gradients(apart) == {"critics": True, "actors": False}
    assert gradients(shared) == {"critics": True, "actors": True}
    assert sum(weight.numel() for weight in shared.parameters()) < sum(weight.numel() for weight in apart.parameters())


def test_labels_of_affordance_reach_nobody(model: Model, view: Look) -> None:
    scores = model.goal.scores(view.seen.points, model.tokens.scene(TEXT, EDGE)).gather(1, INDEX)
    target = goal_outlook(model, view, INDEX, seeded())
    assert target.shape == (B, K)
    assert not target.requires_grad
    assert torch.equal(target, goal_outlook(model, view, INDEX, seeded()))
    code = code_of(rotations(B).float())
    prepared = pre_outlook(model, view, INDEX, INDEX[:, 0], code, seeded())
    assert prepared.shape == (B, K)
    assert bool(((prepared > 0.0) & (prepared < 1.0)).all())
    assert float(affordance_loss(scores.detach(), target, torch.ones(B, K, dtype=torch.bool))) > 0.0


def test_a_hidden_goal_cannot_be_told_from_another(model: Model, view: Look) -> None:
    goal, other = an_action(model, view, 0), an_action(model, view, 2)
    known = torch.tensor([True, False, True])
    shown, also = model.goal_shown(goal, known), model.goal_shown(other, known)
    assert torch.equal(shown[1], also[1])
    assert torch.equal(shown[0], goal[0])
    assert not torch.equal(shown[0], also[0])
    with pytest.raises(TypeError, match="said by booleans"):
        model.tokens.action_or_none(goal, torch.ones(B))


def test_without_anticipation_the_assistant_knows_no_goal() -> None:
    model = model_of(anticipation=False).eval()
    view = look(model, clouds(B, 256), TEXT, EDGE)
    first, second = (model.goal_shown(an_action(model, view, column)) for column in (0, 2))
    assert torch.equal(first, second)


def test_without_an_object_pose_the_hand_sees_both_actions_instead(model: Model, view: Look) -> None:
    ablated = model_of(object_pose=False).eval()
    goal, pre, text = an_action(ablated, view, 0), an_action(ablated, view, 1), ablated.tokens.text(TEXT)
    here, there = torch.zeros(B, 128), torch.ones(B, 128)
    found = [ablated.reorient.condition(view.seen.whole, text, goal, pre, moved) for moved in (here, there)]
    assert torch.equal(*found)
    assert found[0].shape == (B, 544)
    assert ablated.reorient.move.decode(found[0], torch.zeros(B, 32)).shape == (B, 9)
    full = [model.reorient.condition(view.seen.whole, text, goal, pre, moved) for moved in (here, there)]
    assert not torch.equal(*full)


def test_features_meet_along_the_batch() -> None:
    cloud, points = torch.arange(2.0)[:, None], torch.zeros(2, 2, 3)
    assert joined(points, cloud)[..., 3].tolist() == [[0.0, 0.0], [1.0, 1.0]]
    assert joined(cloud, torch.zeros(2, 5, 4, 1)).shape == (2, 5, 4, 2)


@pytest.mark.parametrize("name", PROFILES)
def test_every_size_has_the_same_weights(name: str) -> None:
    count = sum(weight.numel() for weight in Model(settings_of(name)).parameters())
    assert count == sum(weight.numel() for weight in model_of().parameters())
    assert 4 * count < 25e6  # bytes: what may be shipped


def operation() -> Operation:
    """What is done in three rows."""
    kinds = torch.nn.functional.one_hot(torch.tensor([0, 1, 2]), len(KINDS)).float()
    ways, point = torch.tensor([[0.0, 0.0, 1.0]] * B), torch.full((B, 3), 0.05)
    return Operation(kinds, ways, -ways, point, torch.tensor([0.3, 1.0, 2.0]))


def parts_of(model: Model, step: int, generator: torch.Generator) -> Parts:
    """All losses of one batch of made-up answers, computed as training would; the second row hides its goal."""
    losses, critics, every = model.settings.losses, model.critics, torch.ones(B, dtype=torch.bool)
    view = look(model, clouds(B, 256), TEXT, EDGE)
    tokens, scene, index = model.tokens, model.tokens.scene(TEXT, EDGE), INDEX[:, 0]
    R, moves = rotations(B, seed=7).float(), torch.cat([code_of(rotations(B, seed=8).float()), torch.ones(B, 3)], -1)
    point, contact = view.seen.at(index), gathered(view.cloud[..., :3], index)
    done = tokens.action(point, contact, code_of(R))
    goal, where, turn = model.goal_shown(done, torch.tensor([True, False, True])), tokens.contact(contact), R[:, :2, 0]
    given = joined(scene, goal)
    at_goal, at_pre = model.goal.condition(point, where, scene), model.pre.condition(point, where, given)
    direction, heading = tokens.direction(code_of(R)), torch.nn.functional.normalize(turn, dim=-1)
    moved = tokens.cloud_or_none(model.encoder(moved_cloud(view.cloud, moves)).whole, torch.tensor([True, True, False]))
    hand = model.reorient.condition(view.seen.whole, tokens.text(TEXT), goal, done, moved)
    action = critics.tokens.action(view.judged.at(index), contact, code_of(R))
    scene_c, text_c, labels = critics.tokens.scene(TEXT, EDGE), critics.tokens.text(TEXT), torch.tensor([1.0, 0.0, 1.0])
    wanted, seen_all = torch.tensor([[0.9, 0.1, 0.2, 0.3]] * B), torch.ones(B, K, dtype=torch.bool)
    checked = critics.feasibility(torch.ones(B, STATION), view.judged.at(index))
    fit, spots = (losses, step, generator), torch.arange(256).expand(B, 256) < 9
    return Parts(
        orientation_goal=orientation_loss(model.goal.orientation, at_goal, R, every, *fit),
        orientation_pre=orientation_loss(model.pre.orientation, at_pre, R, every, *fit),
        pose_object=pose_loss(
            model.pose.move,
            model.pose.condition(view.seen.whole, tokens.place(PLACE), scene, goal, done),
            moves,
            every,
            *fit,
        ),
        pose_hand=pose_loss(model.reorient.move, hand, moves, every, *fit),
        opening_goal=opening_loss(model.goal.opening(at_goal, direction), torch.full((B,), 0.01), every),
        opening_pre=opening_loss(model.pre.opening(at_pre, direction), torch.full((B,), 0.03), every),
        reach_goal=reach_loss(model.goal.reach(at_goal, direction), torch.full((B, 3), 0.1), every),
        reach_pre=reach_loss(model.pre.reach(at_pre, direction), torch.full((B, 3), 0.1), every),
        operation=operation_loss(
            model.goal.operation(at_goal, direction).of(torch.tensor([0, 1, 2])), operation(), every, losses
        ),
        push=push_loss(model.pre.push(at_pre, direction), heading, torch.full((B,), 0.4), every, every, every),
        place_goal=place_loss(model.goal.places(view.seen.points, scene), spots, torch.ones_like(spots), every),
        place_pre=place_loss(model.pre.places(view.seen.points, given), spots, torch.ones_like(spots), every),
        sort_goal=sort_loss(model.goal.sorts(view.seen.points, scene), torch.tensor([0, 1, 2]), spots, every),
        affordance_goal=affordance_loss(model.goal.scores(view.seen.at(INDEX), scene), wanted, seen_all),
        affordance_pre=affordance_loss(model.pre.scores(view.seen.at(INDEX), given), wanted, seen_all),
        critic_goal=critic_loss(critics.goal(action, scene_c), labels, every),
        critic_pre=critic_loss(critics.pre(action, scene_c, action), labels, every),
        critic_pose=torch.zeros(())
        if critics.pose is None
        else critic_loss(
            critics.pose(view.judged.whole, moves, text_c, critics.tokens.place(PLACE), action, action), labels, every
        ),
        feasibility=feasibility_loss(
            checked, labels[:, None].expand(B, 3), torch.ones(B, len(CHECKS), dtype=torch.bool)
        ),
    )


@pytest.mark.parametrize("head", ["cvae", "flow"])
@pytest.mark.parametrize("preset", PRESETS)
def test_the_total_reaches_every_weight(preset: str, head: str) -> None:
    model = model_of(preset, head=head).train()
    total(parts_of(model, 5000, seeded()), model.settings.losses).backward()
    idle = {name for name, weight in model.named_parameters() if weight.grad is None or not bool(weight.grad.any())}
    # Critics are always shown the goal and the cloud, and without a critic of poses the features of the whole.
    expected = {"critics.tokens.no_action", "critics.tokens.no_cloud"}
    if not PRESETS[preset].pose_critic:
        expected |= {"critics.tokens.place.weight", "critics.tokens.place.bias"}
    if not PRESETS[preset].pose_critic and PRESETS[preset].own_critic_encoder:
        expected |= {name for name, _ in model.named_parameters() if name.startswith("critics.encoder.whole")}
    assert idle == expected


def losses_now(model: Model) -> np.ndarray:
    """``(16,)`` the model's losses, for the same draws at every call."""
    with torch.no_grad():
        found = [parts_of(model, 5000, seeded(seed)) for seed in range(4)]
    return np.array([[float(getattr(parts, field.name)) for field in fields(parts)] for parts in found]).mean(axis=0)


QUICK = ("default", "biassembly")
EVERY = [pytest.param(preset, marks=() if preset in QUICK else pytest.mark.slow) for preset in PRESETS]


@pytest.mark.parametrize("preset", EVERY)
def test_every_loss_falls_when_all_networks_learn_together(preset: str) -> None:
    model, generator = model_of(preset).train(), seeded(5)
    optimiser = torch.optim.Adam(model.parameters(), 2e-3)
    before = losses_now(model)
    for step in range(15):
        optimiser.zero_grad()
        total(parts_of(model, 5000 + step, generator), model.settings.losses).backward()
        optimiser.step()
    after = losses_now(model)
    named = {field.name: pair for field, *pair in zip(fields(Parts), before, after, strict=True)}
    assert np.isfinite(after).all()
    absent = [name for name, pair in named.items() if pair == [0.0, 0.0]]
    assert absent == ([] if PRESETS[preset].pose_critic else ["critic_pose"])
    assert [name for name, (first, last) in named.items() if last >= first and name not in absent] == []


def test_settings_survive_their_file() -> None:
    for preset in PRESETS:
        settings = settings_of("cpu", preset)
        assert msgspec.json.decode(msgspec.json.encode(settings), type=Settings) == settings
