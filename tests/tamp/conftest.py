"""One planned and executed bottle, and one planned dispenser, made once."""

from __future__ import annotations

from pathlib import Path

import pytest

from tamp.episode import Report, Request, plan_episode


@pytest.fixture(scope="session")
def bottle(tmp_path_factory: pytest.TempPathFactory) -> tuple[Report, Path]:
    """An executed bottle: its report and run folder. Do not change the folder."""
    folder = tmp_path_factory.mktemp("runs") / "bottle"
    return plan_episode(Request(category="Bottle", seed=1, out=folder)), folder


@pytest.fixture(scope="session")
def dispenser(tmp_path_factory: pytest.TempPathFactory) -> tuple[Report, Path]:
    """A dispenser that is only planned. Do not change the folder."""
    folder = tmp_path_factory.mktemp("runs") / "dispenser"
    return plan_episode(Request(category="Dispenser", seed=0, execute=False, out=folder)), folder
