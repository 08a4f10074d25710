"""Labels that follow from a cause, and values that cannot contradict themselves."""

from __future__ import annotations

import dataclasses
import pickle
from typing import get_args

import numpy as np
import pytest

from tamp.episode import Request
from tamp.record import CHECK_OF_CAUSE, CHECKS, OUTCOME_OF_CAUSE, Cloud, check_labels, outcome_of
from tamp.trace import Cause, Failure
from tests.tamp.data.stubs import episode


def test_a_check_that_failed_had_passed_those_before_it() -> None:
    assert check_labels("unreachable") == (0, -1, -1, -1, -1)
    assert check_labels("collision") == (1, 0, -1, -1, -1)
    assert check_labels("cartesian") == check_labels("no_path") == (1, 1, 0, -1, -1)
    assert check_labels("timing") == (1, 1, 1, 0, -1)
    assert check_labels("uncertified") == (1, 1, 1, 1, 0)
    assert check_labels("budget") == (-1, -1, -1, -1, -1)
    assert set(CHECK_OF_CAUSE.values()) == set(CHECKS)


def test_every_cause_has_an_outcome() -> None:
    assert set(get_args(Cause)) <= set(OUTCOME_OF_CAUSE)
    assert outcome_of(None) == "ok"
    assert outcome_of(Failure(stage="pregrasp", reason="slipped", detail="")) == "grasp_lost"


def test_an_episode_survives_pickling() -> None:
    recorded = episode(Request(category="Bottle", seed=5, split="seen"))
    again = pickle.loads(pickle.dumps(recorded))
    assert again.rejections == recorded.rejections
    assert np.array_equal(again.clouds["initial"].points, recorded.clouds["initial"].points)


def test_contradictions_are_refused() -> None:
    recorded = episode(Request(category="Bottle", seed=5, split="seen"))
    with pytest.raises(ValueError, match="disagree"):
        dataclasses.replace(recorded, success=False)
    with pytest.raises(ValueError, match=r"the pose of body at final has shape \(3, 3\)"):
        dataclasses.replace(recorded, link_poses={"final": {"body": np.eye(3)}})
    with pytest.raises(ValueError, match=r"not \(4, 3\), \(5, 3\) and \(4,\)"):
        Cloud(np.zeros((4, 3)), np.zeros((5, 3)), np.zeros(4), ("body",))
