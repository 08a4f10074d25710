"""Random clouds and rotations for tests of the networks."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from affordance.frames import CHANNELS

# Several threads that wait for each other on a busy machine take many times as long as one.
torch.set_num_threads(1)

# Warnings are errors here; without this, which test meets one depends on their order.
torch.set_warn_always(True)


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def clouds(batch: int, points: int, seed: int = 0) -> Tensor:
    """``(batch, points, 6)`` points of a box as large as an object, in network coordinates."""
    xyz = torch.rand(batch, points, 3, generator=seeded(seed)) - 0.5
    roles = torch.zeros(batch, points, CHANNELS - 3)
    roles[..., 0] = 1.0
    return torch.cat([xyz, roles], dim=-1)


def rotations(*shape: int, seed: int = 0) -> Tensor:
    """``(*shape, 3, 3)`` rotations drawn uniformly."""
    count = int(np.prod(shape))
    found = Rotation.random(count, random_state=np.random.default_rng(seed)).as_matrix()
    return torch.from_numpy(found).reshape(*shape, 3, 3)
