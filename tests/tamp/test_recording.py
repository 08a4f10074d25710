"""What is recorded of an episode agrees with itself, with the plan and with the run folder."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from robots.spatial import from_list, points
from robots.workcell import Workcell
from tamp import trace as trace_file
from tamp.episode import Request
from tamp.record import Recorded
from tamp.recording import MOST_POINTS, normals_at, record_episode
from worlds import observe
from worlds.assets import library
from worlds.assets.shape import surface
from worlds.bullet.world import BulletWorld
from worlds.labels import link_poses

BOTTLE = Request(category="Bottle", seed=3, split="seen")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("recorded") / "run"


@pytest.fixture(scope="module")
def bottle(folder: Path) -> Recorded:
    """A bottle that is opened, recorded into a folder."""
    return record_episode(Request(category="Bottle", seed=3, split="seen", out=folder))


def test_an_opened_bottle_was_looked_at_three_times(bottle: Recorded) -> None:
    assert (bottle.success, bottle.outcome, bottle.failure) == (True, "ok", None)
    assert list(bottle.clouds) == ["initial", "grasped", "prepared"]
    assert list(bottle.link_poses) == ["initial", "grasped", "prepared", "final"]
    assert {"ompl", "pybullet"} <= set(bottle.versions)


def test_the_run_folder_stays_where_it_was_asked_for(bottle: Recorded, folder: Path) -> None:
    assert {entry.name for entry in folder.iterdir()} == {
        "plan.json", "trace.json", "observation.npz", "outcome.json"
    }  # fmt: skip
    assert list(bottle.rejections) == trace_file.load(folder).rejections


def test_the_first_cloud_is_drawn_from_the_observation(bottle: Recorded, folder: Path) -> None:
    seen, kept = observe.load(folder).cloud, bottle.clouds["initial"].points
    assert len(kept) == min(len(seen), MOST_POINTS)
    assert cKDTree(seen).query(kept)[0].max() < 1e-6
    assert len(np.unique(kept, axis=0)) == len(kept)


def test_every_labelled_point_lies_on_its_link_where_the_pose_says(bottle: Recorded) -> None:
    """At the start the joints are as the surface has them; the body is rigid at every moment."""
    asset = library.load(bottle.source, bottle.category, bottle.instance)
    skin = {link: cKDTree(spots) for link, (spots, _) in surface(asset, 0.0015).items()}
    for moment, cloud in bottle.clouds.items():
        T_world_body = from_list(bottle.link_poses[moment]["body"].tolist())
        in_body = points(T_world_body.inverse(), cloud.points)
        for link, tree in skin.items():
            if moment == "initial" or link == "body":
                mine = cloud.links == cloud.link_names.index(link)
                assert mine.any()
                assert np.quantile(tree.query(in_body[mine])[0], 0.95) < 0.003


def test_the_assistants_hand_is_in_later_clouds_and_nothing_else(bottle: Recorded) -> None:
    (assistant,) = {action.arm for action in bottle.actions if action.role == "assistant"}
    asset = library.load(bottle.source, bottle.category, bottle.instance)
    links = {"body", *asset.joints, asset.part.link}
    assert set(bottle.clouds["initial"].link_names) <= links
    for moment in ("grasped", "prepared"):
        others = set(bottle.clouds[moment].link_names) - links
        assert others
        assert all(name.startswith(f"{assistant}/") for name in others)
        cloud = bottle.clouds[moment]
        hand = bottle.link_poses[moment][f"{assistant}/panda_hand"][:3, 3]
        on_hand = np.array([cloud.link_names[k] in others for k in cloud.links])
        assert np.linalg.norm(cloud.points[on_hand] - hand, axis=1).max() < 0.16


def test_normals_are_unit_vectors_towards_a_camera(bottle: Recorded, workcell: Workcell) -> None:
    for cloud in bottle.clouds.values():
        assert np.allclose(np.linalg.norm(cloud.normals, axis=1), 1.0, atol=1e-5)
        towards = [np.einsum("ni,ni->n", cloud.normals, camera.eye - cloud.points) for camera in workcell.cameras]
        assert (np.max(towards, axis=0) >= -1e-6).all()


def test_hands_were_where_the_actions_say(bottle: Recorded) -> None:
    """Joint position control follows to a few millimetres."""
    actions = {(action.stage, action.role): action for action in bottle.actions}
    for moment, stage in (("grasped", "lift"), ("prepared", "reorient")):
        action = actions[stage, "assistant"]
        real = bottle.link_poses[moment][f"{action.arm}/panda_hand"]
        assert np.linalg.norm(real[:3, 3] - action.T_world_hand[:3, 3]) < 0.01
    grasp, lift = actions["pregrasp", "assistant"], actions["lift", "assistant"]
    assert np.allclose(grasp.T_world_hand[:3, 3] + lift.amount * lift.direction, lift.T_world_hand[:3, 3], atol=2e-3)
    assert [action.stage for action in bottle.actions] == [
        "pregrasp", "lift", "reorient", "operate", "release", "retreat"
    ]  # fmt: skip


def test_the_part_has_moved_at_the_end(bottle: Recorded) -> None:
    asset = library.load(bottle.source, bottle.category, bottle.instance)

    def part_in_body(moment: str) -> np.ndarray:
        poses = bottle.link_poses[moment]  # type: ignore[index]
        return np.linalg.inv(poses["body"]) @ poses[asset.part.link]

    assert np.allclose(part_in_body("grasped"), part_in_body("initial"), atol=0.03)
    assert np.abs(part_in_body("final") - part_in_body("initial")).max() > 0.005


def test_the_same_seed_records_the_same_and_leaves_nothing(bottle: Recorded) -> None:
    before = set(Path(tempfile.gettempdir()).glob("bipre-*"))
    again = record_episode(BOTTLE)
    assert set(Path(tempfile.gettempdir()).glob("bipre-*")) <= before
    assert again.rejections == bottle.rejections
    for moment, cloud in bottle.clouds.items():
        assert np.array_equal(again.clouds[moment].points, cloud.points)
        assert np.array_equal(again.clouds[moment].links, cloud.links)
        assert np.array_equal(again.link_poses[moment]["body"], bottle.link_poses[moment]["body"])
    for one, other in zip(again.actions, bottle.actions, strict=True):
        assert np.array_equal(one.T_world_hand, other.T_world_hand)


def test_without_a_plan_only_the_beginning_is_known() -> None:
    recorded = record_episode(Request(category="Phone", seed=0, split="seen", timeout=1e-6))
    assert recorded.outcome == "timeout"
    assert list(recorded.clouds) == list(recorded.link_poses) == ["initial"]
    assert recorded.actions == ()


def test_a_closed_loop_is_not_recorded() -> None:
    with pytest.raises(ValueError, match="planned once and executed"):
        record_episode(Request(category="Phone", seed=0, mode="E3"))


def test_normals_of_a_ball_are_radial() -> None:
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(6000, 3))
    ball *= 0.05 / np.linalg.norm(ball, axis=1, keepdims=True)
    kept = np.arange(0, 6000, 7)
    normals = normals_at(ball, kept, 10.0 * ball[kept])
    assert np.einsum("ni,ni->n", normals, ball[kept] / 0.05).min() > 0.99


def test_an_image_is_taken_once_and_again_after_a_step(workcell: Workcell) -> None:
    from worlds.bullet.render import render

    with BulletWorld(workcell, library.load("synthetic", "Bottle", "bottle-001")) as world:
        camera = workcell.cameras[0]
        first = render(world, camera)
        assert render(world, camera) is first
        world.put_object(from_list([[1, 0, 0, 0.05], [0, 1, 0, 0.0], [0, 0, 1, 0.3], [0, 0, 0, 1]]))
        moved = render(world, camera)
        assert not np.array_equal(moved.bodies, first.bodies)
        world.step()
        assert render(world, camera) is not moved
        poses = link_poses(world)
        assert np.allclose(poses["body"], world.object_pose().homogeneous)
