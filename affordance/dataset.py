"""How do examples become batches? Every cloud is thinned a few times beforehand, with all that its points' distances
decide; a batch then picks rows, turns them about the vertical and says which points lie where the hands closed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from torch import Tensor

from affordance.examples import Act, Example
from affordance.frames import ROLES
from affordance.networks import KINDS, STROKE
from affordance.pointnet2 import Indices, farthest_points, gathered, indices_of
from affordance.settings import SCALE, Profile, Settings
from affordance.text import TextEncoder
from robots.errors import BadInput

VARIANTS = 3
"""Thinnings of each cloud."""

LEFT_OUT = 0.3
"""Largest share of a cloud's points that a thinning leaves out before it begins."""

CANDIDATES = 2048
"""Points from which a thinning chooses, as many as a data set keeps; more are drawn again."""

JITTER, BACKWARDS = 0.15, 0.25
"""Standard deviation of the angle by which rows are turned away from their heading [rad], and share of them that are
turned around: a heading follows what the camera happens to see."""

HAND = 8
"""Points of a hand: the corners of its box."""

STATIONS = 4
"""Judgements of the planner drawn for each row."""

PAD_X, PAD_Y, PAD_BACK, PAD_AHEAD = 0.013, 0.006, 0.034, 0.012
"""Points this far from the middle of the pads across, beyond the open fingers, behind and ahead of the tips are where a
hand acts [m]."""

NEAREST = 6
"""Where no point lies there, so many nearest to the tips stand for them."""

TURNING = ("unscrew", "flip")
"""Operations whose amount is an angle."""


@dataclass(frozen=True, slots=True, eq=False)
class Hands:
    """What one hand did in each row, in the world frame.

    Attributes:
        R: ``(B, 3, 3)`` its rotation.
        tip: ``(B, 3)`` between its finger tips [m].
        tool: ``(B, 3)`` its tool centre point [m].
        opening: ``(B,)`` of one finger [m].
        spots: ``(B, N)`` booleans: points where it acted.
        direction: ``(B, 3)`` as in ``Act``, turned into the frame of the hand for a goal action.
        outward: ``(B, 3)`` in the frame of the hand.
        point: ``(B, 3)`` from the tips, in the frame of the hand, in units of ``SCALE``.
        amount: ``(B,)`` of a goal in units of ``STROKE`` or radians, else in units of ``SCALE``.
        kind: ``(B,)`` number in ``KINDS``.
        behind: ``(B,)`` booleans.
        known: ``(B,)`` booleans: whether it did anything.
    """

    R: Tensor
    tip: Tensor
    tool: Tensor
    opening: Tensor
    spots: Tensor
    direction: Tensor
    outward: Tensor
    point: Tensor
    amount: Tensor
    kind: Tensor
    behind: Tensor
    known: Tensor


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Rows of examples.

    Attributes:
        points: ``(B, N, 3)`` of the object before the preparation, in the world frame [m].
        after: ``(B, N, 3)`` of the object as it is expected after it, the last ones of the hand in rows ``held``.
        roles: ``(B, N)`` numbers in ``ROLES`` of ``after``.
        indices, indices_after: Neighbourhoods of both.
        yaw: ``(B,)`` by which the row is turned beyond its heading [rad].
        text, wrong_text: ``(B, 512)`` embedded instructions, and those of another column.
        edge: ``(B, 2, 3)`` as in ``Surroundings``, and whether there is one ``(B,)``.
        place: The same.
        goal, pre: What was done, where the object lay before.
        T_move: ``(B, 4, 4)`` how the object was expected to move.
        lifted: ``(B,)`` booleans: whether it is held meanwhile.
        pushed: ``(B,)`` booleans: whether it is pushed.
        tried, prepared, success: ``(B,)`` booleans as in ``Example``.
        station: ``(B, S, 25)``.
        station_point: ``(B, S)`` point whose features the feasibility critic sees, -1 for none.
        station_labels: ``(B, S, 3)``, -1 for unknown.
    """

    points: Tensor
    after: Tensor
    roles: Tensor
    indices: Indices
    indices_after: Indices
    yaw: Tensor
    text: Tensor
    wrong_text: Tensor
    edge: Tensor
    has_edge: Tensor
    place: Tensor
    has_place: Tensor
    goal: Hands
    pre: Hands
    T_move: Tensor
    lifted: Tensor
    pushed: Tensor
    tried: Tensor
    prepared: Tensor
    success: Tensor
    station: Tensor
    station_point: Tensor
    station_labels: Tensor

    def to(self, device: str) -> Batch:
        """The same on a device."""
        moved: dict[str, Any] = {field.name: _to(getattr(self, field.name), device) for field in fields(self)}
        return Batch(**moved)

    def take(self, other: Batch) -> None:
        """Take over the rows of another batch of the same size, wherever it is."""
        for mine, theirs in zip(_tensors(self), _tensors(other), strict=True):
            mine.copy_(theirs)


class Dataset:
    """Examples ready to be drawn from; the same examples, settings and seed give the same batches."""

    def __init__(
        self,
        examples: Sequence[Example],
        settings: Settings,
        encoder: TextEncoder,
        *,
        seed: int = 0,
        device: str = "cpu",
    ) -> None:
        """Thin every cloud.

        Args:
            examples: What is learned from.
            settings: Decide the sizes of the clouds.
            encoder: Of instructions.
            seed: Decides the thinnings.
            device: Where distances are computed, ``cpu`` or ``cuda``; batches are made on the CPU.

        Raises:
            BadInput: There is no example.
        """
        if not examples:
            raise BadInput("There is no example to learn from.")
        self.examples, self.profile, self.encoder = list(examples), settings.profile, encoder
        self._texts: dict[str, np.ndarray] = {}
        rng = np.random.default_rng([seed, 0])
        self.points = _thinned(self.examples, self.profile.points, rng, device)
        self.after, self.roles = _after(self.examples, self.points)
        self.indices, self.indices_after = (
            _neighbourhoods(points, self.profile, device) for points in (self.points, self.after)
        )
        self._goal, self._pre = (
            _hands([_act(e, name) for e in self.examples], self.points) for name in ("goal", "pre")
        )
        self._good = np.array([k for k, e in enumerate(self.examples) if e.success and e.goal is not None], dtype=int)
        self._bad = np.array([k for k, e in enumerate(self.examples) if not e.success], dtype=int)

    def __len__(self) -> int:
        """Number of examples."""
        return len(self.examples)

    def batch(self, rng: np.random.Generator, size: int, *, good: float = 0.65) -> Batch:
        """Rows drawn at random, as far as there are any a share ``good`` of them successes, turned at random."""
        count = size if not len(self._bad) else 0 if not len(self._good) else max(1, round(good * size))
        picked = [*self._drawn(self._good, count, rng), *self._drawn(self._bad, size - count, rng)]
        rows = np.array(picked, dtype=int)
        yaw = rng.normal(0.0, JITTER, size) + np.pi * (rng.random(size) < BACKWARDS)
        return self._collated(rows, rng.integers(VARIANTS, size=size), yaw, rng)

    def fixed(self, size: int, most: int = 96) -> list[Batch]:
        """The same rows every time, spread over all examples with actions, not turned."""
        usable = [k for k, example in enumerate(self.examples) if example.goal is not None]
        if not usable:
            return []
        chosen = np.array(usable)[np.unique(np.linspace(0, len(usable) - 1, min(most, len(usable))).astype(int))]
        rng = np.random.default_rng(0)
        return [
            self._collated(rows, np.zeros(len(rows), dtype=int), np.zeros(len(rows)), rng)
            for rows in np.array_split(chosen, max(1, len(chosen) // size))
        ]

    @staticmethod
    def _drawn(among: np.ndarray, count: int, rng: np.random.Generator) -> list[int]:
        return [] if not count else rng.choice(among, count, replace=count > len(among)).tolist()

    def _collated(self, rows: np.ndarray, variants: np.ndarray, yaw: np.ndarray, rng: np.random.Generator) -> Batch:
        chosen = [self.examples[k] for k in rows]
        flat = torch.from_numpy(rows * VARIANTS + variants)
        others = [self._another(example, rng) for example in chosen]
        judged = [self._judged(example, self.points[k], rng) for example, k in zip(chosen, flat.tolist(), strict=True)]

        def yes(values: Iterable[bool]) -> Tensor:
            return torch.tensor(list(values), dtype=torch.bool)

        def pair(name: str) -> tuple[Tensor, Tensor]:
            found = [getattr(example.surroundings, name) for example in chosen]
            return (
                torch.from_numpy(np.array([np.zeros((2, 3)) if p is None else p for p in found], dtype=np.float32)),
                yes(p is not None for p in found),
            )

        edge, has_edge = pair("edge")
        place, has_place = pair("place")
        return Batch(
            points=self.points[flat],
            after=self.after[flat],
            roles=self.roles[flat].long(),
            indices=_picked(self.indices, flat),
            indices_after=_picked(self.indices_after, flat),
            yaw=torch.from_numpy(yaw.astype(np.float32)),
            text=self._embedded([example.texts[rng.integers(len(example.texts))] for example in chosen]),
            wrong_text=self._embedded(others),
            edge=edge,
            has_edge=has_edge,
            place=place,
            has_place=has_place,
            goal=_rows(self._goal, torch.from_numpy(rows), flat),
            pre=_rows(self._pre, torch.from_numpy(rows), flat),
            T_move=torch.from_numpy(np.array([example.T_move for example in chosen], dtype=np.float32)),
            lifted=yes(example.task in ("articulated", "handover") for example in chosen),
            pushed=yes(example.task == "edge_push" for example in chosen),
            tried=yes(example.tried for example in chosen),
            prepared=yes(example.prepared for example in chosen),
            success=yes(example.success for example in chosen),
            station=torch.stack([found[0] for found in judged]),
            station_point=torch.stack([found[1] for found in judged]),
            station_labels=torch.stack([found[2] for found in judged]),
        )

    def _another(self, example: Example, rng: np.random.Generator) -> str:
        """An instruction of another column, or the example's own where there is none."""
        for _ in range(8):
            other = self.examples[rng.integers(len(self.examples))]
            if other.category != example.category:
                return other.texts[0]
        return example.texts[0]

    def _embedded(self, texts: Sequence[str]) -> Tensor:
        for text in texts:
            if text not in self._texts:
                self._texts[text] = self.encoder.encode([text])[0]
        return torch.from_numpy(np.array([self._texts[text] for text in texts]))

    @staticmethod
    def _judged(example: Example, points: Tensor, rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """Stations, their points and labels of some of the planner's judgements; unknown ones where there are less."""
        station = np.zeros((STATIONS, 25), dtype=np.float32)
        point, labels = np.full(STATIONS, -1), np.full((STATIONS, 3), -1.0, dtype=np.float32)
        count = min(STATIONS, len(example.judged))
        for k, n in enumerate(rng.choice(len(example.judged), count, replace=False) if count else ()):
            judged = example.judged[n]
            station[k], labels[k] = judged.station, judged.labels
            if judged.tool is not None:
                point[k] = int(np.linalg.norm(points.numpy() - judged.tool, axis=1).argmin())
        return torch.from_numpy(station), torch.from_numpy(point), torch.from_numpy(labels)


# -- clouds ------------------------------------------------------------------------------------------------------------


def thinned(points: np.ndarray, count: int, rng: np.random.Generator, *, left_out: float = 0.0) -> np.ndarray:
    """``(count, 3)`` float32 points spread over a cloud ``(n, 3)``, the first ones the farthest apart."""
    spread: np.ndarray = _spread_out([_candidates(points, rng, left_out)], count)[0]
    return spread


def _candidates(points: np.ndarray, rng: np.random.Generator, left_out: float) -> np.ndarray:
    """As many points of a cloud as are thinned, some drawn twice where there are fewer."""
    kept = rng.permutation(len(points))[: max(1, round((1.0 - left_out) * len(points)))]
    if len(kept) < CANDIDATES:
        kept = np.concatenate([kept, rng.choice(kept, CANDIDATES - len(kept))])
    return np.asarray(points[kept[:CANDIDATES]], dtype=np.float32)


def _spread_out(clouds: Sequence[np.ndarray], count: int, device: str = "cpu") -> np.ndarray:
    stacked = torch.from_numpy(np.stack(clouds)).to(device)
    return np.asarray(gathered(stacked, farthest_points(stacked, count)).cpu())


def _thinned(
    examples: Sequence[Example], count: int, rng: np.random.Generator, device: str, at_once: int = 256
) -> Tensor:
    """``(examples * VARIANTS, count, 3)``."""
    found = []
    clouds = [
        _candidates(example.points, rng, rng.uniform(0.0, LEFT_OUT)) for example in examples for _ in range(VARIANTS)
    ]
    for start in range(0, len(clouds), at_once):
        found.append(_spread_out(clouds[start : start + at_once], count, device))
    return torch.from_numpy(np.concatenate(found))


def _after(examples: Sequence[Example], points: Tensor) -> tuple[Tensor, Tensor]:
    """The clouds as they are expected after the preparation, and the roles of their points ``(rows, N)`` uint8."""
    after, roles = points.clone(), torch.zeros(points.shape[:2], dtype=torch.uint8)
    for k, example in enumerate(examples):
        rows = slice(k * VARIANTS, (k + 1) * VARIANTS)
        R, t = (torch.from_numpy(part.astype(np.float32)) for part in (example.T_move[:3, :3], example.T_move[:3, 3]))
        after[rows] = points[rows] @ R.T + t
        if len(example.hand):
            after[rows, -HAND:] = torch.from_numpy(example.hand.astype(np.float32))
            roles[rows, -HAND:] = ROLES.index("gripper")
    return after, roles


def _neighbourhoods(points: Tensor, profile: Profile, device: str, at_once: int = 64) -> Indices:
    """Of every row; kept in 16 bits."""
    parts = [
        indices_of(points[start : start + at_once].to(device) / SCALE, profile)
        for start in range(0, len(points), at_once)
    ]
    return Indices(
        *(
            tuple(
                torch.cat([getattr(part, field.name)[level] for part in parts]).to(torch.int16).cpu()
                for level in range(4)
            )
            for field in fields(Indices)
        )
    )


def _picked(indices: Indices, rows: Tensor) -> Indices:
    return Indices(*(tuple(level[rows].long() for level in getattr(indices, field.name)) for field in fields(Indices)))


# -- hands -------------------------------------------------------------------------------------------------------------


def _act(example: Example, name: str) -> Act | None:
    act: Act | None = getattr(example, name)
    return act


def spots_of(points: np.ndarray, T_world_hand: np.ndarray, opening: float, tip_offset: float) -> np.ndarray:
    """Which points ``(n, 3)`` a hand acts on ``(n,)``: those between its pads, else those nearest to its tips."""
    seen = (points - T_world_hand[:3, 3]) @ T_world_hand[:3, :3]
    ahead = seen[:, 2] - tip_offset
    found = (
        (np.abs(seen[:, 0]) < PAD_X)
        & (np.abs(seen[:, 1]) < opening + PAD_Y)
        & (ahead > -PAD_BACK)
        & (ahead < PAD_AHEAD)
    )
    if not found.any():
        away = np.linalg.norm(seen - [0.0, 0.0, tip_offset], axis=1)
        found = away <= np.partition(away, NEAREST)[NEAREST]
    return np.asarray(found)


def _hands(acts: Sequence[Act | None], points: Tensor) -> Hands:
    """What each example's hand did; spots for each thinning, all else once."""
    count = len(acts)
    spots = torch.zeros(points.shape[:2], dtype=torch.bool)
    numbers = {
        name: np.zeros((count, 3), dtype=np.float32) for name in ("tip", "tool", "direction", "outward", "point")
    }
    R = np.tile(np.eye(3, dtype=np.float32), (count, 1, 1))
    plain = {name: np.zeros(count, dtype=np.float32) for name in ("opening", "amount")}
    kind, behind, known = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    for k, act in enumerate(acts):
        if act is None:
            continue
        turn = act.T_world_hand[:3, :3]
        tip, tool = (act.T_world_hand[:3, 3] + offset * turn[:, 2] for offset in (act.tip_offset, act.tcp_offset))
        known[k], behind[k], R[k] = True, act.behind, turn
        plain["opening"][k] = act.opening
        numbers["tip"][k], numbers["tool"][k] = tip, tool
        if act.kind is None:
            numbers["direction"][k] = act.direction
            plain["amount"][k] = act.amount / SCALE
        else:
            kind[k] = KINDS.index(act.kind)
            numbers["direction"][k], numbers["outward"][k] = turn.T @ act.direction, turn.T @ act.outward
            numbers["point"][k] = turn.T @ (act.point - tip) / SCALE
            plain["amount"][k] = act.amount / (1.0 if act.kind in TURNING else STROKE)
        for row in range(k * VARIANTS, (k + 1) * VARIANTS):
            spots[row] = torch.from_numpy(spots_of(points[row].numpy(), act.T_world_hand, act.opening, act.tip_offset))
    tensors = {name: torch.from_numpy(values) for name, values in (numbers | plain).items()}
    return Hands(
        R=torch.from_numpy(R),
        spots=spots,
        kind=torch.from_numpy(kind),
        behind=torch.from_numpy(behind),
        known=torch.from_numpy(known),
        **tensors,
    )


def _rows(hands: Hands, rows: Tensor, flat: Tensor) -> Hands:
    return Hands(
        **{field.name: getattr(hands, field.name)[flat if field.name == "spots" else rows] for field in fields(Hands)}
    )


def _to(value: Tensor | Hands | Indices, device: str) -> Tensor | Hands | Indices:
    match value:
        case Hands():
            return Hands(**{field.name: getattr(value, field.name).to(device) for field in fields(value)})
        case Indices():
            return Indices(
                *(tuple(level.to(device) for level in getattr(value, field.name)) for field in fields(value))
            )
        case _:
            return value.to(device)


def _tensors(value: object) -> Iterator[Tensor]:
    """All tensors in a batch, in the order of its fields."""
    match value:
        case Tensor():
            yield value
        case tuple():
            for part in value:
                yield from _tensors(part)
        case Batch() | Hands() | Indices():
            for field in fields(value):
                yield from _tensors(getattr(value, field.name))
