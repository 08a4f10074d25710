"""Laws of drawing points and of thinning out hands."""
# ruff: noqa: E402 - what needs torch is imported once it is known to be there

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

torch = pytest.importorskip("torch", reason="torch is not installed")

from affordance.networks import Model
from affordance.sampling import (
    ELSEWHERE,
    NEAR,
    SPOTS,
    TOP_LEAST,
    TOP_SHARE,
    chosen_spots,
    distinct,
    promise,
    second_apart,
)
from affordance.settings import settings_of
from affordance.tokens import SCENE


def test_points_are_drawn_among_the_best_and_never_from_a_hand() -> None:
    scores = torch.linspace(0.0, 1.0, 100)
    scores[90:] = torch.nan
    for seed in range(20):
        spots = chosen_spots(scores, np.random.default_rng(seed))
        assert len(set(spots.tolist())) == SPOTS
        assert int(spots.min()) >= 90 - max(TOP_LEAST, round(TOP_SHARE * 90)) and int(spots.max()) < 90


def test_the_same_draw_gives_the_same_points() -> None:
    scores = torch.rand(200, generator=torch.Generator().manual_seed(0))
    first, again = (chosen_spots(scores, np.random.default_rng(3)) for _ in range(2))
    assert torch.equal(first, again)


def test_points_where_hands_act_more_often_promise_more_and_a_hand_promises_nothing() -> None:
    torch.manual_seed(0)
    net, allowed = Model(settings_of("test")).goal, torch.arange(50) < 42
    with torch.no_grad():
        points, given = torch.randn(1, 50, 128), torch.randn(1, SCENE)
        found, logits = promise(net, points, given, allowed), net.places(points, given)[0]
        chances = torch.softmax(logits[:42], dim=0)
    assert torch.isnan(found.affordance[42:]).all() and torch.isnan(found.chance[42:]).all()
    assert torch.allclose(found.chance[:42], chances / chances.max(), atol=1e-5)
    assert torch.allclose(found.both[:42], found.affordance[:42] * found.chance[:42].sqrt())


def test_of_two_hands_alike_the_better_is_kept() -> None:
    R = Rotation.random(3, random_state=np.random.default_rng(0)).as_matrix()
    half_turned = R[0] * np.array([-1.0, -1.0, 1.0])
    at = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.5 * NEAR], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    turned = np.array([R[0], half_turned, R[1], R[0]])
    kept = distinct(turned, at, np.array([0.5, 0.9, 0.1, 0.7]))
    assert kept == [1, 3, 2]
    assert distinct(turned, at, np.array([0.5, 0.9, 0.1, 0.7]), most=1) == [1]


def test_the_second_hand_acts_elsewhere_where_one_does() -> None:
    R = np.tile(np.eye(3), (4, 1, 1))
    at = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 2 * ELSEWHERE, 0.0], [0.02, 0.0, 0.0]])
    assert second_apart(R, at) == [0, 2, 1, 3]
    assert second_apart(R, 0.1 * at) == [0, 1, 2, 3]
    R[3] = np.diag([1.0, -1.0, -1.0])
    assert second_apart(R, 0.1 * at) == [0, 3, 1, 2]
    assert second_apart(R[:1], at[:1]) == [0]
