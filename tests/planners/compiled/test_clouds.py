"""Laws of clouds as obstacles: every point with its sphere counts, and groups are nearly as tight as spheres."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from planners.compiled import layout as at
from planners.compiled.cell import Cell
from planners.compiled.clouds import cloud_shapes
from planners.compiled.robot import robot_of_shapes
from planners.compiled.tables import Shape


def test_a_ball_keeps_its_distance_from_every_point_of_a_cloud() -> None:
    model, joint = pin.Model(), 0
    for kind in (pin.JointModelPX(), pin.JointModelPY(), pin.JointModelPZ()):
        bounds = (np.array([9.0]), np.array([9.0]), np.array([-1.0]), np.array([1.0]))
        joint = model.addJoint(joint, kind, pin.SE3.Identity(), f"j{joint}", *bounds)
    ball = Shape("ball", joint, at.POINT, pin.SE3.Identity(), np.zeros(3), 0.02)
    rng = np.random.default_rng(0)
    angles = rng.uniform(0.0, np.pi, (1500, 2))
    cloud = 0.1 * np.column_stack(
        [np.cos(angles[:, 0]) * np.sin(angles[:, 1]), np.sin(angles[:, 0]) * np.sin(angles[:, 1]), np.cos(angles[:, 1])]
    )
    q = rng.uniform(-0.2, 0.2, (4000, 3))
    gaps = np.linalg.norm(q[:, None] - cloud[None], axis=2).min(axis=1) - 0.02 - 0.004
    free = {}
    for group in (1, 12):
        shapes = cloud_shapes("cloud", cloud, 0.004, group=group)
        assert len(shapes) <= 4 * len(cloud) / group
        pairs = [(0, 1 + k) for k in range(len(shapes))]
        motion = Cell(robot_of_shapes(model, [ball], []), shapes, pairs).motion(range(3), np.zeros(3))
        free[group] = motion.states(q) == at.FREE
        assert not (free[group] & (gaps <= 0.0)).any()
    assert (free[1] == (gaps > 1e-5)).all()
    assert free[12].sum() > 0.97 * free[1].sum()
