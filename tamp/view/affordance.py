"""Affordance maps as one picture: the seen points by score, the best hands, and what the colours mean."""

from __future__ import annotations

import importlib
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from affordance.maps import AffordanceMap, MapName
from robots.cache import write_atomic
from robots.errors import BadInput, MissingDependency
from robots.spatial import Array, unit

TITLES: dict[MapName, str] = {
    "goal_before": "primary, anticipated",
    "pre": "assistant",
    "goal_after": "primary, after the preparation",
}

SIZE, TOP, BOTTOM, BORDER = 420, 34, 46, 36
"""Side of one map, height of its title and of the legend, and room around the points [pixel]."""

FINER = 2
"""How much finer a picture is drawn than shown, which smooths its edges."""

DOT = 3.2
"""Radius of a point [pixel]."""

EYE = unit([0.35, -0.80, 0.75])
"""Direction from which the maps are seen: from the human's side, above."""

RAMP = ((42, 24, 90), (52, 78, 148), (36, 136, 142), (90, 190, 108), (246, 226, 60))
"""Colours from 0 to 1, evenly lighter on the way, so that order can be read without colour vision."""

INK, FAINT, PAPER, BEST, OTHER = (30, 32, 36), (120, 124, 130), (255, 255, 255), (200, 40, 40), (235, 150, 130)

HAND = np.array([[0.0, -1.0, 0.112], [0.0, -1.0, 0.066], [0.0, 1.0, 0.066], [0.0, 1.0, 0.112]])
"""A gripper as a U, in its own frame: the second number is a share of the opening; the rest is in [m]."""

OPENING = 0.04
"""Opening at which hands are drawn [m]."""


def require_affordance_png(path: Path) -> None:
    """Raise before anything runs when no picture can be written to ``path``.

    Raises:
        MissingDependency: Pillow is not installed.
        BadInput: It is no name of a PNG file, or a folder, or its folder does not exist.
    """
    _require_pillow()
    if path.suffix.lower() != ".png":
        raise BadInput(f"--affordance-png {path} is not a PNG file; give a name that ends in .png.")
    if path.is_dir():
        raise BadInput(f"--affordance-png {path} is a folder; give the name of a PNG file.")
    if not path.absolute().parent.is_dir():
        raise BadInput(f"--affordance-png {path}: there is no folder {path.absolute().parent}.")


def write_affordance_png(maps: Sequence[AffordanceMap], path: Path) -> Path:
    """Write the picture of maps.

    Raises:
        MissingDependency: Pillow is not installed.
        BadInput: The file cannot be written.
    """
    picture = affordance_png(maps)
    try:
        return write_atomic(path, picture)
    except OSError as error:
        raise BadInput(f"--affordance-png {path} cannot be written: {error.strerror}.") from error


def affordance_png(maps: Sequence[AffordanceMap]) -> bytes:
    """The picture of maps side by side, as PNG.

    Raises:
        MissingDependency: Pillow is not installed.
    """
    _require_pillow()
    from PIL import Image, ImageDraw

    scale, size = FINER, (max(1, len(maps)) * SIZE * FINER, (SIZE + TOP + BOTTOM) * FINER)
    image = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(image)
    for k, one in enumerate(maps):
        _map(draw, one, k * SIZE * scale)
    image = image.resize((size[0] // scale, size[1] // scale), Image.Resampling.LANCZOS)
    words = ImageDraw.Draw(image)
    for k, one in enumerate(maps):
        words.text((k * SIZE + 12, 10), TITLES[one.name], fill=INK)
        words.text((k * SIZE + 12, TOP + SIZE - 14), _best(one), fill=FAINT)
    if not maps:
        words.text((12, 10), "The search ended before a map was made.", fill=INK)
    _legend(words, maps)
    memory = io.BytesIO()
    image.save(memory, format="PNG")
    return memory.getvalue()


def colour(score: float) -> tuple[int, int, int]:
    """The colour of a score in ``[0, 1]``."""
    at = float(np.clip(score, 0.0, 1.0)) * (len(RAMP) - 1)
    low = min(int(at), len(RAMP) - 2)
    mixed = (1.0 - (at - low)) * np.array(RAMP[low]) + (at - low) * np.array(RAMP[low + 1])
    return int(mixed[0]), int(mixed[1]), int(mixed[2])


def _require_pillow() -> None:
    try:
        importlib.import_module("PIL")
    except ImportError as error:
        raise MissingDependency("pillow", "video", "The picture of affordance maps") from error


def _map(draw: Any, one: AffordanceMap, left: int) -> None:
    """The points from far to near, then the hands, the best last; colours span the scores that occur."""
    right, up = unit(np.cross([0.0, 0.0, 1.0], EYE)), np.zeros(3)
    up = np.cross(EYE, right)
    strokes = [stroke(T.homogeneous) for T in one.hands]
    flat = [np.column_stack([part @ right, -(part @ up)]) for part in (one.points, *strokes)]
    everything = np.concatenate(flat)
    low, high = everything.min(axis=0), everything.max(axis=0)
    zoom = (SIZE - 2 * BORDER) * FINER / max(float((high - low).max()), 1e-6)
    middle = np.array([left + SIZE * FINER / 2, (TOP + SIZE / 2) * FINER])
    placed = [middle + zoom * (part - (low + high) / 2) for part in flat]
    shares = spread(one.scores)
    radius = DOT * FINER
    for k in np.argsort(one.points @ EYE):
        x, y = placed[0][k]
        draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=colour(float(shares[k])))
    for number in range(len(strokes), 0, -1):
        line = [tuple(spot) for spot in placed[number].tolist()]
        draw.line(line, fill=BEST if number == 1 else OTHER, width=(4 if number == 1 else 2) * FINER, joint="curve")


def spread(scores: Array) -> Array:
    """Scores ``(n,)`` stretched to ``[0, 1]``, so that a flat map still shows its order; 0.5 where all are alike."""
    low, high = float(scores.min()), float(scores.max())
    return np.full(len(scores), 0.5) if high - low < 1e-9 else np.asarray((scores - low) / (high - low))


def stroke(T_world_hand: Array) -> Array:
    """``(4, 3)`` corners of a hand's outline in the world frame [m]."""
    local = HAND * np.array([1.0, OPENING, 1.0])
    return np.asarray(local @ T_world_hand[:3, :3].T + T_world_hand[:3, 3])


def _best(one: AffordanceMap) -> str:
    span = f"affordance {one.scores.min():.2f} to {one.scores.max():.2f}"
    return span if not one.hand_scores else f"{span}, best hand {one.hand_scores[0]:.2f}"


def _legend(draw: Any, maps: Sequence[AffordanceMap]) -> None:
    top, wide = TOP + SIZE + 10, 140
    for x in range(wide):
        draw.line((12 + x, top, 12 + x, top + 12), fill=colour(x / (wide - 1)))
    draw.text((12, top + 16), "lowest", fill=FAINT)
    draw.text((wide - 30, top + 16), "highest", fill=FAINT)
    if maps:
        draw.line((wide + 40, top + 6, wide + 64, top + 6), fill=BEST, width=3)
        draw.text((wide + 70, top), "best hand", fill=INK)
        draw.line((wide + 150, top + 6, wide + 174, top + 6), fill=OTHER, width=2)
        draw.text((wide + 180, top), "next ones", fill=INK)
