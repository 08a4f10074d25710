"""Laws of the simulated cell, the observation and how an episode begins."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from robots.errors import BadRunFolder
from robots.model import DualArm
from robots.spatial import pose
from robots.workcell import SIDES, Camera, Workcell
from worlds import observe, physics, scene
from worlds.assets import library
from worlds.assets.shape import collision_vertices
from worlds.bullet.world import BulletWorld
from worlds.camera import camera_pose, focal, unproject
from worlds.labels import centre_of_mass, truth
from worlds.success import holds, part_motion


@pytest.fixture(scope="module")
def world(workcell: Workcell) -> Iterator[BulletWorld]:
    with scene.build(workcell, library.load("synthetic", "Bottle", "bottle-000"), 5) as built:
        yield built


def test_the_same_seed_builds_the_same_scene(workcell: Workcell, world: BulletWorld) -> None:
    with scene.build(workcell, world.asset, 5) as again:
        assert np.array_equal(again.object_pose().homogeneous, world.object_pose().homogeneous)
    with scene.build(workcell, world.asset, 6) as different:
        assert not np.allclose(different.object_pose().homogeneous, world.object_pose().homogeneous)


def test_the_object_rests_on_the_table_within_the_region(world: BulletWorld) -> None:
    low, high = world.object_bounds()
    middle = (low + high)[:2] / 2 - np.array(world.workcell.shared[:2])
    assert np.abs(middle).max() < scene.REGION
    lowest = min(world.object_pose().act(v)[2] for v in np.concatenate(list(collision_vertices(world.asset).values())))
    assert abs(lowest - world.workcell.table.top) < 0.002
    assert max(world.object_speed()) < 0.05


def test_the_observed_cloud_lies_on_the_object_and_sees_no_arm(world: BulletWorld) -> None:
    cloud = observe.observe(world).cloud
    low, high = world.object_bounds()
    assert len(cloud) > 500
    assert np.all(cloud > low - 0.004)
    assert np.all(cloud < high + 0.004)


def test_point_labels_name_links_of_the_object_and_find_the_lid(world: BulletWorld) -> None:
    observation = observe.observe(world)
    known = truth(world, observation)
    lid = known.T_world_body.act(known.part.point)
    assert 0 < known.movable.sum() < len(observation.cloud)
    distance = np.linalg.norm(observation.cloud - lid, axis=1)
    assert np.median(distance[known.movable]) < np.median(distance[~known.movable])


def test_centre_of_mass_lies_inside_the_bounds(world: BulletWorld) -> None:
    low, high = world.object_bounds()
    centre = world.object_pose().act(centre_of_mass(world))
    assert np.all(centre > low)
    assert np.all(centre < high)


def test_put_and_read_pose_agree(workcell: Workcell) -> None:
    with BulletWorld(workcell, library.load("synthetic", "Dispenser", "dispenser-001")) as made:
        T = pose((0.05, -0.02, 0.5), (0.3, -0.7, 1.9))
        made.put_object(T)
        assert np.allclose(made.object_pose().homogeneous, T.homogeneous, atol=1e-6)


def test_an_arm_follows_its_targets_under_torque_limits(workcell: Workcell, arms: DualArm) -> None:
    with BulletWorld(workcell, library.load("synthetic", "Bottle", "bottle-001")) as made:
        made.put_object(pose((0.0, 0.1, 0.2)))
        start, goal = arms["left"].home, arms["left"].home + np.array([0.3, 0.2, 0.0, 0.3, 0.0, 0.2, -0.4])
        for k in range(240):
            made.command_arm("left", start + (goal - start) * min(1.0, k / 200), (goal - start) * 1.2 * (k < 200))
            made.step()
        assert np.abs(made.arm_positions("left") - goal).max() < 0.003
        assert np.abs(made.arm_positions("right") - arms["right"].home).max() < 0.003


def test_fingers_move_no_faster_than_the_real_ones(workcell: Workcell) -> None:
    with BulletWorld(workcell, library.load("synthetic", "Bottle", "bottle-001")) as made:
        made.put_object(pose((0.0, 0.1, 0.2)))
        travel = workcell.arm("left").gripper.finger_travel
        for side in SIDES:
            made.command_fingers(side, 0.0, physics.GRIP_FORCE)
        for _ in range(48):
            made.step()
        moved = travel - made.opening("left")
        assert 0.005 < moved <= 1.1 * 0.2 * workcell.arm("left").gripper.finger_velocity
        assert not holds(made, "left")


def test_the_lid_keeps_still_unless_something_pulls_it(world: BulletWorld) -> None:
    assert abs(part_motion(world)) < 1e-3


def test_unprojection_inverts_projection() -> None:
    camera = Camera(name="c", eye=(0.3, -0.4, 0.8), target=(0.0, 0.1, 0.0), width=64, height=48, fov_deg=50.0)
    points_world = unproject(camera, np.full((48, 64), 0.7))
    p_camera = camera_pose(camera).actInv(points_world[10, 20])
    u, v = focal(camera) * p_camera[:2] / p_camera[2] + np.array([32.0, 24.0])
    assert (u, v) == pytest.approx((20.5, 10.5))
    assert p_camera[2] == pytest.approx(0.7)


def test_an_observation_survives_its_file(world: BulletWorld, tmp_path: Path) -> None:
    observation = observe.observe(world)
    observe.save(observation, tmp_path)
    again = observe.load(tmp_path)
    assert np.allclose(again.cloud, observation.cloud, atol=1e-6)
    assert np.array_equal(again.pixels, observation.pixels)


def test_a_broken_observation_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "observation.npz").write_bytes(b"PK not a zip")
    with pytest.raises(BadRunFolder, match=r"observation.npz cannot be read as an observation"):
        observe.load(tmp_path)


def test_what_reaches_over_the_edge_is_seen(workcell: Workcell) -> None:
    """A bottle that lies with its foot over the near edge; cut off there, the planner would not know of the foot."""
    with scene.build(workcell, library.load("synthetic", "Bottle", "bottle-045"), 123) as world:
        low, _ = world.object_bounds()
        edge = workcell.table.centre[1] - workcell.table.size[1] / 2
        assert low[1] < edge - 0.005
        assert observe.observe(world).cloud[:, 1].min() < low[1] + 0.008
