"""What the planner is allowed to know of the object: the coloured cloud that the cell's depth cameras see."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robots.cache import content_hash, write_atomic
from robots.errors import BadRunFolder
from robots.spatial import Array, frozen
from robots.workcell import Camera, Workcell
from worlds.bullet.render import render
from worlds.bullet.world import BulletWorld
from worlds.camera import Image, unproject

TABLE_BAND = 0.003
"""Points lower than this above the table top count as table [m]; depth noise and rounding stay below it."""

OVERHANG = 0.12
"""How far beyond the table's edges points still count as object [m]: it may reach over one."""

OBSERVATION_FILE = "observation.npz"


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """A cloud of the object, from all cameras, in the world frame.

    Attributes:
        cloud: ``(n, 3)`` points [m].
        colours: ``(n, 3)`` RGB in ``[0, 1]``.
        pixels: ``(n, 3)`` camera number, row and column of each point.
    """

    cloud: Array
    colours: Array
    pixels: np.ndarray[tuple[int, int], np.dtype[np.int32]]

    def __post_init__(self) -> None:
        object.__setattr__(self, "cloud", frozen(self.cloud))
        object.__setattr__(self, "colours", frozen(self.colours))

    @property
    def digest(self) -> str:
        """A hash of the points, rounded to a micrometre."""
        return content_hash(np.round(self.cloud * 1e6).astype(np.int64).tobytes())


def observe(world: BulletWorld) -> Observation:
    """The object as the cameras see it: every point above the table top, some way beyond its edges included.

    The arms wait outside the cameras' view of the table when an observation is taken, so what stands on the table is
    the object. No simulator label is used.
    """
    views = [
        _above_table(world.workcell, k, camera, render(world, camera))
        for k, camera in enumerate(world.workcell.cameras)
    ]
    return Observation(*(np.concatenate(parts) for parts in zip(*views, strict=True)))


def _above_table(workcell: Workcell, number: int, camera: Camera, image: Image) -> tuple[Array, Array, Any]:
    world_points = unproject(camera, image.depth)
    table = workcell.table
    centre, half = np.array(table.centre), np.array(table.size) / 2 + OVERHANG
    low, high = np.array([*(centre - half), table.top + TABLE_BAND]), np.array([*(centre + half), np.inf])
    with np.errstate(invalid="ignore"):
        keep = np.all((world_points > low) & (world_points < high), axis=-1)
    rows, columns = np.nonzero(keep)
    pixels = np.column_stack([np.full_like(rows, number), rows, columns]).astype(np.int32)
    return world_points[keep], image.rgb[keep] / 255.0, pixels


def save(observation: Observation, folder: Path) -> Path:
    """Write ``observation.npz`` into the run folder at once or not at all."""
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        cloud=observation.cloud.astype(np.float32),
        colours=observation.colours.astype(np.float32),
        pixels=observation.pixels,
    )
    return write_atomic(folder / OBSERVATION_FILE, buffer.getvalue())


def load(folder: Path) -> Observation:
    """The observation of a run folder; ``BadRunFolder`` when it is missing or unreadable."""
    path = folder / OBSERVATION_FILE
    try:
        with np.load(path) as arrays:
            return Observation(arrays["cloud"], arrays["colours"], arrays["pixels"])
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise BadRunFolder(f"{path} cannot be read as an observation: {error}") from error
