"""Which keyboards can be generated? Full-size, tenkeyless, compact, wedge and split ones, keys up on z = 0.

x runs along the rows, y from the space bar to the function keys. Keys are not modelled one by one: a block a row.
"""

from __future__ import annotations

import numpy as np

from worlds.assets.asset import Asset
from worlds.assets.build import Design, Link, realise
from worlds.assets.solids import Mesh, hull
from worlds.assets.synthetic.series import Series, pastel
from worlds.assets.synthetic.slab import density, prism, slab, turned

SERIES = Series("Keyboard", count=65, seed=20_260_203)
"""As many as in the paper's table; the seed starts every instance's own generator."""

SIZES = {
    "full-size": (0.420, 0.440, 0.115, 0.140),
    "tenkeyless": (0.335, 0.360, 0.115, 0.135),
    "compact": (0.275, 0.300, 0.095, 0.118),
    "wedge": (0.290, 0.315, 0.110, 0.130),
    "split": (0.300, 0.340, 0.120, 0.140),
}
"""Least and most width, least and most depth [m]; catalogues: full-size 420 to 440 by 115 to 150, tenkeyless 340 to
370, 60 % boards 280 to 300 by 95 to 120."""

MASS = {
    "full-size": (0.35, 0.55),
    "tenkeyless": (0.30, 0.50),
    "compact": (0.22, 0.42),
    "wedge": (0.25, 0.45),
    "split": (0.30, 0.50),
}
"""[kg]; slim wireless boards: compact 240 to 500 g, full-size 370 to 800 g. Heavier ones no hand holds by an edge."""

PITCH = 0.0190
"""From key to key [m]; the standard spacing is 19.05 mm."""

KEY = 0.0165
"""Depth of a row's block [m]."""

FRONT = (0.007, 0.010)
"""Height of the case at the front edge [m]; slim boards 5 to 10 mm."""

ROWS = (0.0034, 0.0028, 0.0020, 0.0024, 0.0030, 0.0036)
"""How far each row stands off the case, from the space bar up [m]: sculpted rows are lowest in the middle."""

LETTERS = 15.0
"""Width of the block of letters [pitches]."""

BESIDE = {"full-size": (3.0, 4.0), "tenkeyless": (3.0,)}
"""Widths of the blocks to the right of the letters [pitches]: arrows and, on a full-size board, numbers."""


def make(instance: str) -> Asset:
    """The keyboard called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    kind = list(SIZES)[index % len(SIZES)]
    least, most, shallow, deep = SIZES[kind]
    width, depth = rng.uniform(least, most), rng.uniform(shallow, deep)
    front = rng.uniform(*FRONT)
    rear = front + (rng.uniform(0.014, 0.022) if kind == "wedge" else rng.uniform(0.001, 0.008))
    body = (_split if kind == "split" else _straight)(rng, kind, width, depth, front, rear)
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=kind,
            split=SERIES.split(index),
            links=(Link("body", body, density(body, rng.uniform(*MASS[kind])), pastel(rng, dark=rng.random() < 0.5)),),
            joints=(),
            part=None,
            long_axis=np.array([1.0, 0.0, 0.0]),
        )
    )


def _straight(
    rng: np.random.Generator, kind: str, width: float, depth: float, front: float, rear: float
) -> tuple[Mesh, ...]:
    """One case with its blocks of keys: letters, then what the width leaves room for."""
    count = 5 if kind == "compact" else 6
    pitch = min(PITCH, (depth - 0.012) / count)
    lows = [0.008 - 0.5 * depth + row * pitch for row in range(count)]
    keys = [
        _row(span, low, depth, front, rear, rise)
        for block, span in enumerate(_spans(kind, 0.5 * width - 0.006))
        for row, (low, rise) in enumerate(zip(lows, ROWS, strict=False))
        if (block, row) != (1, 2)  # above the arrow keys there is an open space
    ]
    return (_case(width, depth, front, rear), *keys, *(_strip(width, depth, rear) if rng.random() < 0.3 else ()))


def _spans(kind: str, edge: float) -> list[tuple[float, float]]:
    """Where the blocks of letters, arrows and numbers begin and end along x, between ``-edge`` and ``edge`` [m]."""
    spans = [(-edge, min(LETTERS * PITCH - edge, edge))]
    for keys in BESIDE.get(kind, ()):
        start = spans[-1][1] + 0.005
        spans.append((start, min(start + keys * PITCH, edge)))
    return spans


def _strip(width: float, depth: float, rear: float) -> tuple[Mesh, ...]:
    """A raised strip with media keys behind the rows."""
    return (slab((0.6 * width, 0.006, 0.005), (0.0, 0.5 * depth - 0.004, rear + 0.0015), 0.002),)


def _split(
    rng: np.random.Generator, kind: str, width: float, depth: float, front: float, rear: float
) -> tuple[Mesh, ...]:
    """Two halves turned towards the hands, joined by a bridge between them."""
    turn, half = rng.uniform(0.06, 0.16), 0.5 * width - 0.012
    span = (-0.5 * half + 0.006, 0.5 * half - 0.006)
    rows = [_row(span, 0.008 - 0.5 * depth + row * PITCH, depth, front, rear, ROWS[row]) for row in range(5)]
    solids = (_case(half, depth, front, rear), *rows)
    reach = 0.5 * half * np.cos(turn) + 0.5 * depth * np.sin(turn) + 0.004
    halves = [turned(solid, -s * turn, (s * reach, 0.0, 0.0)) for s in (-1.0, 1.0) for solid in solids]
    wide = 2.0 * (reach - 0.5 * half * np.cos(turn)) + 0.02
    bridge = slab((wide, 0.5 * depth, 0.8 * front), (0.0, 0.12 * depth, 0.4 * front), 0.006)
    return (*halves, bridge)


def _case(width: float, depth: float, front: float, rear: float) -> Mesh:
    """A flat case that rises from ``front`` to ``rear``, its vertical edges cut."""
    y, cut = 0.5 * depth, 0.006
    return hull(
        np.array(
            [
                (s * (0.5 * width - inset), t * (y - cut + inset), z)
                for s in (-1.0, 1.0)
                for t, top in ((-1.0, front), (1.0, rear))
                for inset in (0.0, cut)
                for z in (0.0, top)
            ]
        )
    )


def _row(span: tuple[float, float], low: float, depth: float, front: float, rear: float, rise: float) -> Mesh:
    """A block of keys over ``span`` along x with its front edge at ``low``, tapered towards its top."""
    slope = (rear - front) / depth
    bottom = front + slope * (low + 0.5 * depth) - 0.002
    top = front + slope * (low + 0.5 * KEY + 0.5 * depth) + rise
    side = [(low, bottom), (low + KEY, bottom), (low + KEY - 0.002, top + slope * 0.006), (low + 0.002, top)]
    return prism(side, span[1] - span[0], 0.5 * (span[0] + span[1]))
