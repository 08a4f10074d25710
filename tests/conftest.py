"""What many tests share: the shipped cell, and one small episode built and observed once."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from robots.model import DualArm
from robots.workcell import Workcell, load_workcell

SHARED = Path(__file__).parents[2] / "shared"


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Derived files of tests go to a folder of their own, so that a stale cache can hide nothing."""
    before = os.environ.get("BIPRE_CACHE")
    os.environ["BIPRE_CACHE"] = str(tmp_path_factory.mktemp("cache"))
    yield
    os.environ.pop("BIPRE_CACHE")
    if before is not None:
        os.environ["BIPRE_CACHE"] = before


@pytest.fixture(scope="session")
def workcell() -> Workcell:
    """The shipped pair of Pandas."""
    return load_workcell("panda_pair")


@pytest.fixture(scope="session")
def arms(workcell: Workcell) -> DualArm:
    """Their kinematics."""
    return DualArm(workcell)
