"""Every round of a closed loop leaves the maps of its own search, and a second run begins without them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from affordance.candidates import GoalCandidate, SceneView
from affordance.heuristic import HeuristicProposer
from affordance.maps import MAPS_FILE, AffordanceMap, load_maps
from tamp import proposers
from tamp.episode import Request, plan_episode


class Showing(HeuristicProposer):
    """The heuristic proposer, with one map: of the first view that it was shown."""

    def goal(self, view: SceneView, rng: np.random.Generator) -> list[GoalCandidate]:
        self.__dict__.setdefault("first", view.cloud)
        return HeuristicProposer.goal(self, view, rng)

    def maps(self) -> tuple[AffordanceMap, ...]:
        cloud = self.__dict__["first"]
        return (AffordanceMap("goal_before", cloud, np.ones(len(cloud)), (), ()),)


def test_every_round_keeps_its_own_maps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(proposers, "HeuristicProposer", Showing)
    folder = tmp_path / "run"
    request = Request(category="Phone", seed=0, mode="E3", page=False, out=folder)
    assert plan_episode(request).rounds == 2
    (before,), (after,) = load_maps(folder / "round-0"), load_maps(folder)
    assert not np.array_equal(before.points.mean(axis=0), after.points.mean(axis=0))
    monkeypatch.undo()
    assert plan_episode(Request(category="Phone", seed=0, execute=False, page=False, out=folder)).status == "planned"
    assert not (folder / MAPS_FILE).exists()
