"""Laws of poses, curves, the cache and error texts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.cache import cache_dir, content_hash, write_atomic
from robots.errors import MissingDependency, UnknownName
from robots.spatial import (
    angle_between,
    from_list,
    frozen,
    hand_rotation,
    interpolate,
    perpendicular,
    points,
    pose,
    rotation_about,
    to_list,
    turned_about,
    unit,
)
from robots.trajectory import Trajectory

numbers = st.floats(-3.0, 3.0)
vectors = st.tuples(numbers, numbers, numbers).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(vectors, vectors)
def test_a_pose_survives_a_file(xyz: tuple[float, ...], rpy: tuple[float, ...]) -> None:
    T = pose(xyz, rpy)
    assert np.array_equal(from_list(to_list(T)).homogeneous, T.homogeneous)


@pytest.mark.parametrize("rows", [np.eye(3), np.full((4, 4), np.nan), np.diag([2.0, 1, 1, 1]), np.zeros((4, 4))])
def test_what_is_no_pose_is_refused(rows: object) -> None:
    with pytest.raises(ValueError, match="pose"):
        from_list(rows)


@given(vectors, vectors, vectors)
def test_points_follow_the_pose(xyz: tuple[float, ...], rpy: tuple[float, ...], point: tuple[float, ...]) -> None:
    T = pose(xyz, rpy)
    assert np.allclose(points(T, np.array([point]))[0], T.act(np.array(point)))
    assert np.allclose(points(T.inverse(), points(T, np.array([point])))[0], point)


@given(vectors, vectors)
def test_a_hand_rotation_is_proper_and_keeps_its_approach(
    approach: tuple[float, ...], opening: tuple[float, ...]
) -> None:
    if np.linalg.norm(np.cross(unit(approach), unit(opening))) < 1e-3:
        return
    R = hand_rotation(approach, opening)
    assert np.allclose(R.T @ R, np.eye(3), atol=1e-9)
    assert np.isclose(np.linalg.det(R), 1.0)
    assert np.allclose(R[:, 2], unit(approach))
    assert R[:, 1] @ unit(opening) > 0.0


@given(vectors, st.floats(-3.0, 3.0))
def test_turns_have_their_angle(axis: tuple[float, ...], angle: float) -> None:
    assert angle_between(np.eye(3), rotation_about(axis, angle)) == pytest.approx(abs(angle), abs=1e-6)
    assert abs(perpendicular(axis) @ unit(axis)) < 1e-9
    centre = np.array([0.3, -0.2, 0.5])
    assert np.allclose(turned_about(pose(centre), centre, axis, angle).translation, centre)


@given(vectors, vectors, st.floats(0.0, 1.0))
def test_interpolation_begins_and_ends_at_its_poses(a: tuple[float, ...], b: tuple[float, ...], share: float) -> None:
    Ta, Tb = pose(a, (0.1, 0.2, 0.3)), pose(b, (-0.4, 0.5, 0.6))
    assert np.allclose(interpolate(Ta, Tb, 0.0).homogeneous, Ta.homogeneous)
    assert np.allclose(interpolate(Ta, Tb, 1.0).homogeneous, Tb.homogeneous)
    turned = angle_between(Ta.rotation, interpolate(Ta, Tb, share).rotation)
    assert turned == pytest.approx(share * angle_between(Ta.rotation, Tb.rotation), abs=1e-6)


def test_a_zero_vector_has_no_direction() -> None:
    with pytest.raises(ValueError, match="no direction"):
        unit((0.0, 0.0, 0.0))


def test_frozen_arrays_cannot_be_changed() -> None:
    values = frozen([1.0, 2.0])
    with pytest.raises(ValueError, match="read-only"):
        values[0] = 5.0


def ramp() -> Trajectory:
    q = np.zeros((3, 7))
    q[1], q[2] = 0.5, 1.0
    v = np.zeros((3, 7))
    v[1] = 0.4
    return Trajectory(np.array([0.0, 1.0, 2.5]), q, v)


@given(st.floats(0.0, 2.5))
def test_velocity_is_the_derivative_of_position_and_so_on(t: float) -> None:
    curve, h = ramp(), 1e-6
    t = min(max(t, 2 * h), 2.5 - 2 * h)
    if abs(t - 1.0) < 2 * h:
        return
    q, qd, qdd = curve.sample([t - h, t, t + h])
    assert np.allclose((q[2] - q[0]) / (2 * h), qd[1], atol=1e-5)
    assert np.allclose((qd[2] - qd[0]) / (2 * h), qdd[1], atol=1e-4)


@pytest.mark.parametrize(
    ("times", "words"),
    [([0.0, 1.0, 1.0], "increase"), ([0.5, 1.0, 2.0], "start at 0"), ([0.0, 1.0], "needs times"),
     ([0.0, np.nan, 2.0], "not finite")],
)  # fmt: skip
def test_knots_that_make_no_curve_are_refused(times: list[float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Trajectory(np.array(times), np.zeros((3, 7)), np.zeros((3, 7)))


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write_atomic(tmp_path / "a" / "plan.json", "old")

    def refuse(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(OSError, match="disk full"):
        write_atomic(file, "new")
    assert file.read_text() == "old"
    assert [entry.name for entry in file.parent.iterdir()] == ["plan.json"]


def test_the_cache_is_where_the_environment_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("BIPRE_CACHE", str(tmp_path / "mine"))
    assert cache_dir() == tmp_path / "mine"
    monkeypatch.delenv("BIPRE_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_dir() == tmp_path / "bipremanip"


def test_a_hash_tells_its_parts_apart() -> None:
    assert content_hash("ab", "c") != content_hash("a", "bc")
    assert content_hash("ab", b"c") == content_hash("ab", "c")


def test_errors_say_what_is_valid_and_what_to_install() -> None:
    unknown = UnknownName("category", "botle", ["Bottle", "Dispenser"])
    assert str(unknown) == 'No category "botle". Did you mean "Bottle"? Valid: Bottle, Dispenser.'
    many = UnknownName("instance", "x", [f"bottle-{k:03}" for k in range(57)])
    assert str(many).endswith("Valid: bottle-000, bottle-001, bottle-002 ... bottle-056 (57 in all).")
    missing = MissingDependency("imageio", "video", "Recording a video")
    assert 'pip install "bipremanip[video]"' in str(missing)


def test_angles_are_symmetric() -> None:
    a, b = pin.SE3.Random().rotation, pin.SE3.Random().rotation
    assert angle_between(a, b) == pytest.approx(angle_between(b, a))
