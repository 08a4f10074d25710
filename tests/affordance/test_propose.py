"""Laws of the learned proposer, with networks that have learned nothing: shape, order, repeatability, honesty."""
# ruff: noqa: E402 - what needs torch is imported once it is known to be there

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pinocchio as pin
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from affordance import checkpoint
from affordance.candidates import GoalCandidate, PregraspCandidate, Roles, SceneView
from affordance.networks import KINDS, Model
from affordance.preparing import LIFT
from affordance.propose import KINDS_OF, LearnedProposer, learned_proposer
from affordance.sampling import KEPT
from affordance.settings import settings_of
from affordance.stations import hand_corners
from affordance.variants import VARIANTS, Variant
from robots.errors import BadInput
from robots.spatial import pose
from robots.workcell import load_workcell
from worlds.tasks import task_of

WORKCELL = load_workcell("panda_pair")
ROLES = Roles("left", "right")
BOTTLE, PHONE, PLATE, HANDOVER = (task_of(name) for name in ("Bottle", "Phone", "Plate", "Handover-Bottle"))


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(1)  # networks whose hands are not all inside the box
    return checkpoint.save(
        tmp_path_factory.mktemp("weights") / "new.safetensors", Model(settings_of("test")), "hash", 0
    )


@pytest.fixture
def view() -> SceneView:
    """Half a box of 16 x 5 x 4 cm on the table, as a camera above sees it."""
    rng = np.random.default_rng(0)
    cloud = rng.uniform([-0.08, -0.025, 0.0], [0.08, 0.025, 0.04], (3000, 3))
    cloud[:2000, 2] = 0.04
    return SceneView(WORKCELL, cloud, pin.SE3.Identity(), np.zeros((0, 3)), ROLES)


def moved(view: SceneView) -> SceneView:
    hand = hand_corners(WORKCELL.arm("left").gripper, pose([0.0, 0.0, 0.4], [np.pi, 0.0, 0.0]))
    return view.moved(pose([0.0, 0.0, 0.25], [0.3, 0.0, 0.5]), hand)


def proposer(weights: Path, task: object = BOTTLE, variant: Variant = VARIANTS["learned"]) -> LearnedProposer:
    return learned_proposer("learned", task, variant, weights)  # type: ignore[arg-type]


def ranked(scores: Iterator[float]) -> bool:
    values = list(scores)
    return bool(values) and values == sorted(values, reverse=True) and all(0.0 <= value <= 1.0 for value in values)


@pytest.mark.parametrize("task", [BOTTLE, PHONE, PLATE, HANDOVER], ids=lambda task: task.category)
def test_goals_are_ranked_rigid_and_of_the_tasks_kind(weights: Path, view: SceneView, task: object) -> None:
    asked = proposer(weights, task)
    for seen in (view, moved(view)):
        goals = asked.goal(seen, np.random.default_rng(0))
        scores = [goal.score for goal in goals]
        assert 0 < len(goals) <= KEPT and scores[0] == max(scores)
        assert scores[2:] == sorted(scores[2:], reverse=True) and (seen is view or ranked(iter(scores)))
        for goal in goals:
            assert goal.kind in KINDS_OF[task.type]  # type: ignore[attr-defined]
            assert np.allclose(goal.T_world_hand.rotation.T @ goal.T_world_hand.rotation, np.eye(3))
            assert 0.0 <= goal.opening <= WORKCELL.arm("left").gripper.finger_travel
            assert np.linalg.norm(goal.direction) == pytest.approx(1.0)
            if goal.kind == "grasp":
                assert goal.amount == LIFT and goal.direction.tolist() == [0.0, 0.0, 1.0]


def test_a_final_goal_is_proposed_as_every_kind_that_it_may_be(view: SceneView, tmp_path: Path) -> None:
    """Networks that hold unscrewing for likely, pulling for possible and everything else for out of the question."""
    torch.manual_seed(1)
    model = Model(settings_of("test"))
    with torch.no_grad():
        last = model.goal.what[2]
        rows = torch.arange(len(KINDS)) * 11
        last.weight[rows], last.bias[rows] = 0.0, -20.0
        last.bias[11 * KINDS.index("unscrew")], last.bias[11 * KINDS.index("pull")] = 0.5, 0.0
    asked = proposer(checkpoint.save(tmp_path / "undecided.safetensors", model, "hash", 0))
    first = asked.goal(view, np.random.default_rng(0))
    assert {goal.kind for goal in first} == {"unscrew"}
    last_goals = asked.goal(moved(view), np.random.default_rng(0))
    assert {goal.kind for goal in last_goals} == {"unscrew", "pull"}
    assert last_goals[0].kind == "unscrew" and ranked(goal.score for goal in last_goals)

    with torch.no_grad():  # what is seen of the point says pull, whatever the hands are turned for
        model.goal.sorter[2].weight.zero_()
        model.goal.sorter[2].bias.zero_()
        model.goal.sorter[2].bias[KINDS.index("pull")] = 3.0
    sure = proposer(checkpoint.save(tmp_path / "sure.safetensors", model, "hash", 0))
    for seen in (view, moved(view)):
        assert {goal.kind for goal in sure.goal(seen, np.random.default_rng(0))} == {"pull"}


def answers(asked: LearnedProposer, view: SceneView, seed: int) -> list[list[float]]:
    """Every call of a whole articulated road, as numbers."""
    rng = np.random.default_rng(seed)
    goal = asked.goal(view, rng)[0]
    grasp = asked.pregrasp(view, goal, rng)[0]
    poses = asked.object_pose(view, goal, grasp, ROLES, rng)
    hand = asked.reorient(grasp, poses[0])
    final = asked.goal(moved(view), rng)
    matrices = [goal.T_world_hand, grasp.T_world_hand, *(p.T_move for p in poses), hand, final[0].T_world_hand]
    return [T.homogeneous.ravel().tolist() for T in matrices]


def test_the_same_draws_give_the_same_candidates_in_any_order_of_calls(weights: Path, view: SceneView) -> None:
    first = proposer(weights)
    told = answers(first, view, 1)
    assert answers(first, view, 1) == told
    assert answers(proposer(weights), view, 1) == told
    assert answers(first, view, 2) != told


@pytest.mark.parametrize("name", VARIANTS)
def test_every_variant_answers(weights: Path, view: SceneView, name: str) -> None:
    asked, rng = proposer(weights, BOTTLE, VARIANTS[name]), np.random.default_rng(0)
    goals = asked.goal(view, rng)
    poses = asked.object_pose(view, goals[0], asked.pregrasp(view, goals[0], rng)[0], ROLES, rng)
    assert all((len(found) == 1) == VARIANTS[name].first_only for found in (goals, poses))
    hand = asked.reorient(asked.pregrasp(view, goals[0], rng)[0], poses[0])
    assert np.allclose(hand.rotation.T @ hand.rotation, np.eye(3))


def test_a_rigid_hand_follows_the_object(weights: Path, view: SceneView) -> None:
    asked, rng = proposer(weights), np.random.default_rng(0)
    goal = asked.goal(view, rng)[0]
    grasp = asked.pregrasp(view, goal, rng)[0]
    at = asked.object_pose(view, goal, grasp, ROLES, rng)[0]
    assert np.allclose(asked.reorient(grasp, at).homogeneous, (at.T_move * grasp.T_world_hand).homogeneous)


def test_without_object_poses_the_hand_is_moved_and_the_object_with_it(view: SceneView, tmp_path: Path) -> None:
    torch.manual_seed(1)
    model = Model(msgspec.structs.replace(settings_of("test"), object_pose=False))
    asked = proposer(checkpoint.save(tmp_path / "w.safetensors", model, "hash", 0), variant=VARIANTS["no_obj_pose"])
    rng = np.random.default_rng(0)
    goal = asked.goal(view, rng)[0]
    grasp = asked.pregrasp(view, goal, rng)[0]
    found = asked.object_pose(view, goal, grasp, ROLES, rng)
    assert len(found) == KEPT
    hands = [asked.reorient(grasp, pose).homogeneous for pose in found]
    assert all(np.allclose(T, (p.T_move * grasp.T_world_hand).homogeneous) for T, p in zip(hands, found, strict=True))
    assert not np.allclose(hands[0], hands[1])


def test_pushes_and_presses_move_as_they_say(weights: Path, view: SceneView) -> None:
    rng = np.random.default_rng(0)
    pushing, pressing = proposer(weights, PHONE), proposer(weights, PLATE)
    for push in pushing.push(view, pushing.goal(view, rng)[0], rng):
        assert push.travel[2] == pytest.approx(0.0) and np.allclose(push.T_move.translation, push.travel)
    for press in pressing.press(view, pressing.goal(view, rng)[0], rng):
        assert press.travel[:2].tolist() == [0.0, 0.0] and press.travel[2] <= 0.0


def test_maps_tell_what_was_asked(weights: Path, view: SceneView) -> None:
    asked, rng = proposer(weights), np.random.default_rng(0)
    assert asked.maps() == ()
    goal = asked.goal(view, rng)[0]
    asked.pregrasp(view, goal, rng)
    asked.goal(moved(view), rng)
    maps = asked.maps()
    assert [one.name for one in maps] == ["goal_before", "pre", "goal_after"]
    for one in maps:
        assert one.points.shape == (len(one.scores), 3)
        assert np.isfinite(one.scores).all() and one.hands
    assert len(maps[2].points) == len(maps[0].points) - 8  # the hand's points have no affordance


def test_it_reads_nothing_privileged(weights: Path, view: SceneView, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every privileged door raises while it proposes for each task type."""
    import worlds.labels as door

    def shut(*_: object, **__: object) -> None:
        raise AssertionError("a privileged door was opened")

    doors = [
        name for name in vars(door) if callable(getattr(door, name)) and getattr(door, name).__module__ == door.__name__
    ]
    assert {"truth", "link_poses", "point_links"} <= set(doors)
    for name in doors:
        monkeypatch.setattr(door, name, shut)
    rng = np.random.default_rng(0)
    assert answers(proposer(weights), view, 0)
    assert proposer(weights, PHONE).push(view, proposer(weights, PHONE).goal(view, rng)[0], rng)


def test_a_grasp_may_be_anything_that_was_proposed_elsewhere(weights: Path, view: SceneView) -> None:
    """The networks take goals and grasps from any source, also ones that touch no seen point."""
    far = pose([0.5, 0.5, 0.5])
    up = np.array([0.0, 0.0, 1.0])
    goal = GoalCandidate("pull", far, 0.02, up, far.translation, 0.03, up, 1.0)
    rng = np.random.default_rng(0)
    asked = proposer(weights)
    assert asked.pregrasp(view, goal, rng)
    assert asked.object_pose(view, goal, PregraspCandidate(far, 0.02, 1.0), ROLES, rng)


def test_missing_and_foreign_weights_are_refused(tmp_path: Path, weights: Path) -> None:
    with pytest.raises(BadInput, match="no model"):
        proposer(tmp_path / "none.safetensors")
    (tmp_path / "broken.safetensors").write_bytes(weights.read_bytes()[:2000])
    with pytest.raises(BadInput, match="cannot be read"):
        proposer(tmp_path / "broken.safetensors")
    clip = checkpoint.save(tmp_path / "clip.safetensors", Model(settings_of("test")), "clip", 0)
    with pytest.raises(BadInput, match="text encoder clip"):
        proposer(clip)
