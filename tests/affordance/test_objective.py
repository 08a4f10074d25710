"""Laws of batches and of their loss, on the stored episodes."""
# ruff: noqa: E402 - what needs torch is imported once it is known to be there

from __future__ import annotations

import copy
import math
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")
pytest.importorskip("h5py", reason="the extra `data` is not installed")

from affordance.dataset import HAND, Batch, Dataset, spots_of
from affordance.frames import rotation_of
from affordance.losses import Parts, total
from affordance.networks import Model
from affordance.objective import ACTORS, parts_of
from affordance.settings import SCALE, settings_of
from affordance.text import HashText
from affordance.validation import auroc, calibration_error, validate
from affordance.views import done_in, seen
from robots.errors import BadInput
from tamp.learning import examples_in
from tests.affordance.clouds import seeded

STORED = Path(__file__).parents[1] / "data" / "episodes"
SETTINGS = settings_of("test")


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    learned, kept = examples_in([STORED])
    return Dataset([*learned, *kept], SETTINGS, HashText())


@pytest.fixture(scope="module")
def batch(dataset: Dataset) -> Batch:
    return dataset.batch(np.random.default_rng(0), 8)


@pytest.fixture(scope="module")
def model() -> Model:
    torch.manual_seed(0)
    return Model(SETTINGS)


def parts(model: Model, batch: Batch, **more: bool) -> Parts:
    return parts_of(model, copy.deepcopy(model).eval(), batch, 0, seeded(3), **more)


def test_the_same_draws_give_the_same_batch(dataset: Dataset, batch: Batch) -> None:
    again = dataset.batch(np.random.default_rng(0), 8)
    assert all(torch.equal(getattr(batch, f.name), getattr(again, f.name)) for f in fields(Batch) if f.type == "Tensor")
    other = dataset.batch(np.random.default_rng(1), 8)
    assert not torch.equal(batch.points, other.points) or not torch.equal(batch.yaw, other.yaw)


def test_a_batch_takes_over_the_rows_of_another(dataset: Dataset, batch: Batch) -> None:
    kept = dataset.batch(np.random.default_rng(5), 8)
    rows = kept.points
    assert not torch.equal(rows, batch.points)
    kept.take(batch)
    assert rows is kept.points
    assert torch.equal(rows, batch.points)
    assert torch.equal(kept.goal.spots, batch.goal.spots)
    assert all(torch.equal(a, b) for a, b in zip(kept.indices.neighbours, batch.indices.neighbours, strict=True))


def test_rows_are_turned_a_little_or_around(dataset: Dataset) -> None:
    """The heading of an object follows what the camera happens to see; networks must bear a few degrees and an end."""
    yaw = dataset.batch(np.random.default_rng(2), 400).yaw
    around = (yaw - math.pi).abs() < 1.0
    assert 0.15 < float(around.float().mean()) < 0.35
    assert float(yaw[~around].std()) == pytest.approx(0.15, abs=0.03)


def test_a_held_object_is_seen_with_the_hand_that_holds_it(batch: Batch) -> None:
    for row in range(len(batch.yaw)):
        gripper = batch.roles[row] == 1
        if bool(batch.lifted[row] & batch.goal.known[row]):
            assert int(gripper.sum()) == HAND
        moved = batch.points[row] @ batch.T_move[row, :3, :3].T + batch.T_move[row, :3, 3]
        assert torch.allclose(moved[~gripper], batch.after[row][~gripper], atol=1e-5)


def test_hands_are_found_again_from_point_rotation_and_reach(model: Model, batch: Batch) -> None:
    """Both goal actions are one in the frame of the object, at the point where the hand really was."""
    with torch.no_grad():
        scene = seen(model.eval(), batch)
    before, after, pre = done_in(scene, batch, seeded(1))
    for frame, act, hand in ((scene.frame, before, batch.goal), (scene.frame, pre, batch.pre)):
        tip = frame.points_world(
            (act.contact + (rotation_of(frame.codes(hand.R)) @ act.reach[..., None])[..., 0])[:, None]
        )
        flip = torch.linalg.vector_norm(tip[:, 0] - hand.tip, dim=-1)
        over = frame.points_world((act.contact + (act.R @ act.reach[..., None])[..., 0])[:, None])[:, 0]
        assert bool((torch.linalg.vector_norm(over - hand.tip, dim=-1)[hand.known] < 1e-5).all()), flip
    assert torch.allclose(before.reach, after.reach, atol=1e-5)
    assert torch.equal(before.index, after.index)


def test_spots_lie_between_the_pads() -> None:
    T = np.eye(4)
    cloud = np.array([[0.0, 0.0, 0.11], [0.0, 0.05, 0.11], [0.05, 0.0, 0.11], [0.0, 0.0, 0.2]])
    cloud = np.concatenate([cloud, np.full((6, 3), 1.0)])
    assert spots_of(cloud, T, 0.02, 0.1122).tolist() == [True] + [False] * 9
    assert spots_of(cloud[1:], T, 0.02, 0.1122).sum() >= 1


def test_turning_a_row_turns_what_is_learned_with_it(model: Model, batch: Batch) -> None:
    """Yaw augmentation: what both hands did stays the same in network coordinates, turned with the cloud."""
    turned = Batch(**{f.name: getattr(batch, f.name) for f in fields(Batch)} | {"yaw": batch.yaw + 1.0})
    with torch.no_grad():
        scenes = [seen(model.eval(), b) for b in (batch, turned)]
    acts = [done_in(scene, b, seeded(1))[0] for scene, b in zip(scenes, (batch, turned), strict=True)]
    c, s = math.cos(1.0), math.sin(1.0)
    turn = torch.tensor([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    assert torch.allclose(acts[1].contact, acts[0].contact @ turn.T, atol=1e-5)
    assert torch.allclose(acts[1].R, turn @ acts[0].R, atol=1e-5)
    assert torch.allclose(acts[1].reach, acts[0].reach, atol=1e-5)
    assert torch.allclose(scenes[1].place[:, :3], scenes[0].place[:, :3] @ turn.T, atol=1e-4)


def test_critics_teach_no_actor(model: Model, batch: Batch) -> None:
    model.train().zero_grad()
    found = parts(model, batch)
    (found.critic_goal + found.critic_pre + found.critic_pose + found.feasibility).backward()
    reached = {name for name, weight in model.named_parameters() if weight.grad is not None and weight.grad.any()}
    assert reached and all(name.startswith("critics.") for name in reached)


def test_actors_learn_from_successes_alone(model: Model, batch: Batch) -> None:
    failed = Batch(
        **{f.name: getattr(batch, f.name) for f in fields(Batch)} | {"success": torch.zeros_like(batch.success)}
    )
    found = parts(model.train(), failed)
    assert all(float(getattr(found, name).detach()) == 0.0 for name in ACTORS)


def test_while_adapting_no_actor_learns(model: Model, batch: Batch) -> None:
    found = parts(model.train(), batch, adapting=True)
    assert all(float(getattr(found, name)) == 0.0 for name in ACTORS)
    assert float(found.critic_goal.detach()) > 0.0


def test_every_part_is_finite_and_has_a_weight(model: Model, batch: Batch) -> None:
    found = parts(model.train(), batch)
    for field in fields(Parts):
        assert math.isfinite(float(getattr(found, field.name).detach())), field.name
    assert float(total(found, SETTINGS.losses).detach()) > 0.0


def test_validation_tells_shares_and_areas(model: Model, dataset: Dataset) -> None:
    told = validate(model, dataset.fixed(4), seeded())
    assert told["goal_close"] <= told["goal_best"] <= 1.0
    assert all(0.0 <= told[name] <= 1.0 for name in told if not name.startswith("reach"))
    assert {"goal_close", "pre_close", "reach_goal", "kind", "goal_turned_auroc", "feasible_auroc"} <= set(told)


def test_areas_and_calibration_are_what_they_should_be() -> None:
    labels = np.array([1.0, 1.0, 0.0, 0.0])
    assert auroc(np.array([0.9, 0.8, 0.2, 0.1]), labels) == 1.0
    assert auroc(np.array([0.1, 0.8, 0.8, 0.1]), labels) == 0.5
    assert math.isnan(auroc(labels, np.ones(4)))
    assert calibration_error(np.full(4, 0.5), labels) == pytest.approx(0.0)
    assert calibration_error(np.full(4, 0.9), labels) == pytest.approx(0.4)


def test_nothing_to_learn_from_is_refused() -> None:
    with pytest.raises(BadInput, match="no example"):
        Dataset([], SETTINGS, HashText())


def test_lengths_are_told_in_units_of_the_scale(dataset: Dataset) -> None:
    pushes = [k for k, e in enumerate(dataset.examples) if e.task == "edge_push" and e.pre is not None]
    for k in pushes:
        example = dataset.examples[k]
        assert example.pre is not None
        assert float(dataset._pre.amount[k]) == pytest.approx(example.pre.amount / SCALE)
