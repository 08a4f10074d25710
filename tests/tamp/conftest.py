"""One episode of each task type, made once: some executed, some only planned."""

from __future__ import annotations

from pathlib import Path

import pytest

from tamp.episode import Report, Request, plan_episode

Made = tuple[Report, Path]


def made(factory: pytest.TempPathFactory, category: str, seed: int, *, execute: bool) -> Made:
    """The report and the run folder of an episode. Do not change the folder."""
    folder = factory.mktemp("runs") / category.lower()
    return plan_episode(Request(category=category, seed=seed, execute=execute, out=folder)), folder


@pytest.fixture(scope="session")
def bottle(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """An executed bottle (articulated)."""
    return made(tmp_path_factory, "Bottle", 1, execute=True)


@pytest.fixture(scope="session")
def dispenser(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A dispenser that is only planned (articulated, pressed)."""
    return made(tmp_path_factory, "Dispenser", 0, execute=False)


@pytest.fixture(scope="session")
def phone(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """An executed phone (edge push)."""
    return made(tmp_path_factory, "Phone", 0, execute=True)


@pytest.fixture(scope="session")
def plate(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A plate that is only planned (plate lift)."""
    return made(tmp_path_factory, "Plate", 0, execute=False)


@pytest.fixture(scope="session")
def handover(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A bottle to be handed over, only planned."""
    return made(tmp_path_factory, "Handover-Bottle", 0, execute=False)
