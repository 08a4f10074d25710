"""What does a cloud look like at each point and as a whole? PointNet++ in plain torch, without an operator of its own.

Charles R. Qi et al., "PointNet++: Deep Hierarchical Feature Learning on Point Sets in a Metric Space", NeurIPS 2017;
the widths are those of Where2Act's encoder. Which points are kept and which are neighbours depends on distances alone,
so it can be computed once for a stored cloud and handed in for every turned and shifted copy of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from affordance.frames import CHANNELS
from affordance.settings import Profile

POINT = 128
"""Features of a point."""

WHOLE = 128
"""Features of a cloud."""

DOWN = ((32, 32, 64), (64, 64, 128), (128, 128, 256), (256, 256, 512))
"""Widths of the layers that look at the balls of each level."""

UP = ((128, 128, 128), (256, 128), (256, 256), (256, 256))
"""Widths of the layers that carry features back to each level's points."""

SUPPORTS = 3
"""Kept points between which features are interpolated."""

CLOSEST = 1e-8
"""Added to squared distances before they are inverted."""


@dataclass(frozen=True, slots=True, eq=False)
class Indices:
    """Which points are kept and who is near whom, level by level; each level's input is what the one before kept.

    Attributes:
        centres: For each level ``(B, M)``, the points that are kept.
        neighbours: For each level ``(B, M, K)``, what is in the ball around each of them.
        supports: For each level ``(B, N, 3)``, the kept ones closest to each of its points, numbered among the kept.
    """

    centres: tuple[Tensor, ...]
    neighbours: tuple[Tensor, ...]
    supports: tuple[Tensor, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Encoded:
    """What an encoder saw.

    Attributes:
        points: ``(B, N, 128)`` features of the points.
        whole: ``(B, 128)`` features of the clouds.
    """

    points: Tensor
    whole: Tensor

    def at(self, index: Tensor) -> Tensor:
        """The features ``(B, ..., 128)`` of the points numbered ``(B, ...)``."""
        return gathered(self.points, index)


class Encoder(nn.Module):
    """Features of clouds; the same weights serve clouds of any number of points."""

    def __init__(self, profile: Profile) -> None:
        super().__init__()
        self.profile = profile
        self.bf16 = False
        """Whether layers compute in bfloat16 on a CPU, as they do on a GPU."""
        widths = [CHANNELS, *(layer[-1] for layer in DOWN)]
        above = [*(layer[-1] for layer in UP[1:]), widths[-1]]
        self.down = nn.ModuleList(_layers(3 + seen, out) for seen, out in zip(widths, DOWN, strict=False))
        self.up = nn.ModuleList(_layers(own + up, out) for own, up, out in zip(widths, above, UP, strict=False))
        self.points = _layers(UP[0][-1], (POINT,))
        # Not batch normalisation: the pooled vectors of a batch of one have no variance.
        self.whole = nn.Sequential(
            nn.Linear(widths[-1], 256),
            nn.LayerNorm(256),
            nn.ReLU(),
            nn.Linear(256, WHOLE),
            nn.LayerNorm(WHOLE),
            nn.ReLU(),
        )

    def forward(self, cloud: Tensor, indices: Indices | None = None) -> Encoded:
        """Encode clouds ``(B, N, 6)`` as ``affordance.frames.cloud_of`` makes them.

        Args:
            cloud: Positions and roles.
            indices: What ``indices_of`` gives for these clouds; without it, it is computed here.
        """
        known = indices_of(cloud[..., :3].contiguous(), self.profile) if indices is None else indices
        # In half precision with eight bits of exponent a loss needs no scaling; positions and whatever is made of
        # features elsewhere stay exact.
        with torch.autocast(cloud.device.type, dtype=torch.bfloat16, enabled=cloud.is_cuda or self.bf16):
            points, whole = self._encoded(cloud, known)
        return Encoded(points.float(), whole.float())

    def _encoded(self, cloud: Tensor, known: Indices) -> tuple[Tensor, Tensor]:
        xyz = [cloud[..., :3].contiguous()]
        features = [cloud]
        for level, layers in enumerate(self.down):
            xyz.append(gathered(xyz[level], known.centres[level]))
            offset = gathered(xyz[level], known.neighbours[level]) - xyz[level + 1][:, :, None]
            seen = torch.cat([offset, gathered(features[level], known.neighbours[level])], dim=-1)
            features.append(_pointwise(layers, seen).amax(dim=2))
        whole: Tensor = self.whole(features[-1].mean(dim=1))
        above = features[-1]
        for level in reversed(range(len(DOWN))):
            spread = _interpolated(xyz[level], xyz[level + 1], above, known.supports[level])
            above = _pointwise(self.up[level], torch.cat([features[level], spread], dim=-1))
        return _pointwise(self.points, above), whole


def indices_of(xyz: Tensor, profile: Profile) -> Indices:
    """Kept points and neighbourhoods of ``(B, N, 3)`` positions in network coordinates.

    ``ValueError`` when there are fewer points than the first level keeps.
    """
    if xyz.shape[1] < profile.centres[0]:
        raise ValueError(f"a cloud of this profile has at least {profile.centres[0]} points, not {xyz.shape[1]}")
    centres, neighbours, supports = [], [], []
    with torch.no_grad():
        for count, radius in zip(profile.centres, profile.radii, strict=True):
            kept = farthest_points(xyz, count)
            middle = gathered(xyz, kept)
            between = _distances(middle, xyz)
            centres.append(kept)
            neighbours.append(_in_ball(between, radius, profile.neighbours))
            supports.append(between.mT.topk(min(SUPPORTS, count), dim=-1, largest=False).indices)
            xyz = middle
    return Indices(tuple(centres), tuple(neighbours), tuple(supports))


def farthest_points(xyz: Tensor, count: int) -> Tensor:
    """``(B, count)`` numbers of points of ``(B, N, 3)``, each the farthest from those before it.

    The first is the farthest from the mean, so that the choice does not depend on the order of the points.
    """
    rows = torch.arange(len(xyz), device=xyz.device)
    chosen = torch.empty(len(xyz), count, dtype=torch.long, device=xyz.device)
    axes = xyz.mT.contiguous()  # coordinates apart from each other: sums over them are three times as fast
    current = (axes - axes.mean(dim=2, keepdim=True)).square().sum(dim=1).argmax(dim=1)
    nearest = torch.full(xyz.shape[:2], torch.inf, dtype=xyz.dtype, device=xyz.device)
    for k in range(count):
        chosen[:, k] = current
        away = (axes - axes[rows, :, current][..., None]).square().sum(dim=1)
        nearest = torch.minimum(nearest, away)
        current = nearest.argmax(dim=1)
    return chosen


def neighbours_in_ball(xyz: Tensor, centres: Tensor, radius: float, count: int) -> Tensor:
    """``(B, M, K)`` numbers of the nearest points of ``(B, N, 3)`` within ``radius`` of ``(B, M, 3)``.

    ``K`` is ``count``, or ``N`` if that is less. Places that the ball does not fill repeat the nearest point, which may
    itself lie outside.
    """
    return _in_ball(_distances(centres, xyz), radius, count)


def gathered(values: Tensor, index: Tensor) -> Tensor:
    """``(B, ..., C)`` rows of ``(B, N, C)`` numbered ``(B, ...)``."""
    batch, length, channels = values.shape
    first = torch.arange(batch, device=index.device).reshape(batch, *[1] * (index.dim() - 1)) * length
    flat = values.reshape(batch * length, channels).index_select(0, (index + first).reshape(-1))
    return flat.reshape(*index.shape, channels)


def _distances(a: Tensor, b: Tensor) -> Tensor:
    """``(B, M, N)`` distances, computed from differences: the faster product form is off by more than close points."""
    return torch.cdist(a, b, compute_mode="donot_use_mm_for_euclid_dist")


def _in_ball(between: Tensor, radius: float, count: int) -> Tensor:
    near, index = between.topk(min(count, between.shape[-1]), dim=-1, largest=False)
    return torch.where(near <= radius, index, index[..., :1])


def _interpolated(xyz: Tensor, kept: Tensor, features: Tensor, supports: Tensor) -> Tensor:
    """Features ``(B, M, C)`` of the kept points at ``(B, N, 3)``, weighted by inverse squared distance."""
    away = (gathered(kept, supports) - xyz[:, :, None]).square().sum(-1, keepdim=True)
    weights = 1.0 / (away + CLOSEST)
    return (gathered(features, supports) * (weights / weights.sum(dim=2, keepdim=True))).sum(dim=2)


def _layers(width: int, widths: Sequence[int]) -> nn.Sequential:
    """Layers that see one point at a time."""
    layers: list[nn.Module] = []
    for out in widths:
        layers += [nn.Linear(width, out, bias=False), nn.BatchNorm1d(out), nn.ReLU()]
        width = out
    return nn.Sequential(*layers)


def _pointwise(layers: nn.Module, values: Tensor) -> Tensor:
    """``layers`` applied to ``(..., C)``."""
    out: Tensor = layers(values.reshape(-1, values.shape[-1]))
    return out.reshape(*values.shape[:-1], -1)
