"""A GPU replays what it recorded, and computes what the CPU does."""
# ruff: noqa: E402 - what needs torch is imported once it is known to be there

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec import structs

torch = pytest.importorskip("torch", reason="torch is not installed")
pytest.importorskip("h5py", reason="the extra `data` is not installed")
if not torch.cuda.is_available():
    pytest.skip("there is no CUDA device", allow_module_level=True)

from affordance.dataset import Dataset
from affordance.settings import Training, settings_of
from affordance.text import HashText
from affordance.train import Fitting, begun
from tamp.learning import examples_in

STORED = Path(__file__).parents[1] / "data" / "episodes"
SETTINGS = structs.replace(settings_of("test"), training=Training(steps=30, batch=8))
STEPS = 24


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    learned, kept = examples_in([STORED])
    return Dataset([*learned, *kept], SETTINGS, HashText())


def fitted(dataset: Dataset, *, replayed: bool) -> Fitting:
    fitting = begun(SETTINGS, seed=0, text_backend="hash", device="cuda")
    if not replayed:
        fitting.recorder = None
    for _ in range(STEPS):
        fitting.advance(dataset, "cuda")
    return fitting


def test_a_training_that_is_replayed_is_the_training(dataset: Dataset) -> None:
    recorded, launched = fitted(dataset, replayed=True), fitted(dataset, replayed=False)
    assert recorded.recorder is not None
    for one, other in zip(recorded.model.parameters(), launched.model.parameters(), strict=True):
        assert torch.allclose(one, other, atol=2e-2)
    moved = [
        float((one - other).abs().mean())
        for one, other in zip(recorded.model.parameters(), launched.model.parameters(), strict=True)
    ]
    assert max(moved) < 2e-3
