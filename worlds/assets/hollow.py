"""Which convex parts stand for a bowl, a plate or a cap so that its inside stays open?

Two answers are compared: wedges cut along rays from a point above the opening, and CoACD. Measured on four real bowls
and four plates: wedges take 0.1 to 0.8 s, fill less than 0.1 % of the cavity and hold the wall's own volume; CoACD
takes 5 to 51 s, fills 0.1 to 3 % and holds 1.3 to 4 times that volume. So CoACD is asked only where wedges are not
good enough: a cap with its peak, of which they leave out a third.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from robots.cache import cache_dir, content_hash, write_atomic
from robots.spatial import Array
from worlds.assets.convex import dense
from worlds.assets.solids import Mesh, hull

SECTORS = 20
"""Wedges around the axis: a chord then cuts 1.2 % of the radius, 0.9 mm of a bowl's. Measured: with 16 more of the rims
of three out of four plates is left out than ``MISSED``."""

MOST_RINGS = 6
"""Wedges from the middle to the rim, at most."""

CLOSE_RING = 0.0007
"""Rings are added until the profile is met this closely [m]."""

RIM = 0.985
"""Rays go out to this share of the rim's angle, where they still hit it."""

THINNEST = 0.002
"""A wall is at least this thick [m]; surfaces without thickness grow outwards."""

FLAT_MIDDLE = 0.001
"""A middle that sags less than this is one part [m]."""

FILLED, MISSED = 0.05, 0.03
"""Wedges are good enough when they fill no more of the cavity and leave out no more of the surface than this."""

TOLERANCE = 0.0025
"""Surface further than this from every part is left out [m]; what is filled less deep than ``SKIN`` is not counted."""

SKIN = 0.0015

MOST_SAMPLES = 5_000
"""Points of the cavity and of the surface that are looked at: shares are then known to about 0.5 %."""

RULES = (SECTORS, MOST_RINGS, CLOSE_RING, RIM, THINNEST, FLAT_MIDDLE, FILLED, MISSED, TOLERANCE, SKIN)
"""What the remembered parts depend on besides the mesh."""

COACD_SETTINGS = {
    "threshold": 0.05,
    "max_convex_hull": 64,
    "preprocess_resolution": 40,
    "resolution": 1000,
    "mcts_nodes": 15,
    "mcts_iterations": 60,
    "mcts_max_depth": 2,
    "seed": 1,
}
"""Fine enough for a cavity (NETWORKS 4.5: threshold 0.05 fills 3 % of a bowl, 0.1 already 12 %)."""


@dataclass(frozen=True, slots=True)
class Fit:
    """How well convex parts stand for a shell.

    Attributes:
        filled: Share of the cavity inside parts.
        missed: Share of the surface outside all parts.
    """

    filled: float
    missed: float

    @property
    def good(self) -> bool:
        """Whether nothing better need be looked for."""
        return self.filled <= FILLED and self.missed <= MISSED


def hollow_parts(mesh: Mesh) -> tuple[tuple[Mesh, ...], str]:
    """Convex parts of a shell whose cavity is open towards +z [m], and a note on them; remembered on disk."""
    rules = json.dumps([RULES, COACD_SETTINGS])
    key = content_hash("hollow", rules, mesh.vertices.tobytes(), mesh.faces.tobytes())
    path = cache_dir() / "convex" / f"{key}.json"
    if not path.is_file():
        parts, note = _better(mesh)
        write_atomic(path, json.dumps({"parts": [part.vertices.tolist() for part in parts], "note": note}))
    found = json.loads(path.read_text())
    return tuple(hull(np.array(vertices)) for vertices in found["parts"]), str(found["note"])


def _better(mesh: Mesh) -> tuple[tuple[Mesh, ...], str]:
    cut = wedges(mesh)
    fit = measure(mesh, cut)
    how = "wedges"
    if not fit.good:
        decomposed = coacd_parts(mesh)
        other = measure(mesh, decomposed)
        if other.filled + other.missed < fit.filled + fit.missed:
            cut, fit, how = decomposed, other, "convex parts"
    return cut, f"shell of {len(cut)} {how}: {100 * fit.filled:.1f} % of its cavity filled"


def wedges(mesh: Mesh) -> tuple[Mesh, ...]:
    """The shell cut along rays from a point above its opening; none when rays miss it.

    Works where every such ray enters and leaves the wall once, round or not.
    """
    eye, rims = _view(mesh)
    shares = _rings(mesh, eye, rims)
    near, far = _walls(mesh, eye, rims, shares)
    if not np.isfinite(near[0]).all():
        return ()
    return tuple(_cells(_continued(near), _continued(far)))


def coacd_parts(mesh: Mesh) -> tuple[Mesh, ...]:
    """The shell decomposed by CoACD."""
    import coacd

    coacd.set_log_level("off")
    parts = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), **COACD_SETTINGS)
    return tuple(hull(np.round(points, 7)) for points, _ in parts)


def measure(mesh: Mesh, parts: tuple[Mesh, ...]) -> Fit:
    """How much of the cavity, open towards +z, ``parts`` fill, and how much of the surface they leave out."""
    if not parts:
        return Fit(1.0, 1.0)
    planes = [_planes(part) for part in parts]
    surface = dense(mesh, float(np.ptp(mesh.vertices, axis=0).max()) / 100.0)
    surface, cavity = _thinned(surface, MOST_SAMPLES), _thinned(_cavity(mesh), MOST_SAMPLES)
    filled = float(_within(cavity, planes, -SKIN).mean()) if len(cavity) else 0.0
    return Fit(filled, float(1.0 - _within(surface, planes, TOLERANCE).mean()))


def _view(mesh: Mesh) -> tuple[Array, Array]:
    """A point above the middle of the cavity and, for each sector's edge, the angle from straight down to the rim."""
    points = dense(mesh, float(np.ptp(mesh.vertices, axis=0).max()) / 150.0)
    low, high = points.min(axis=0), points.max(axis=0)
    deep = points[points[:, 2] < 0.5 * (low[2] + high[2])]
    middle = 0.5 * (deep.min(axis=0) + deep.max(axis=0))[:2]
    radius = 0.5 * float((high - low)[:2].max())
    eye = np.array([*middle, high[2] + max(0.0, radius - (high - low)[2]) + 0.02 * radius])
    offsets = points - eye
    angles = np.arctan2(np.linalg.norm(offsets[:, :2], axis=1), -offsets[:, 2])
    sectors = np.round(np.arctan2(offsets[:, 1], offsets[:, 0]) / (2 * np.pi) * SECTORS).astype(int) % SECTORS
    rims = np.array([angles[sectors == sector].max(initial=0.0) for sector in range(SECTORS)])
    return eye, rims


def _rings(mesh: Mesh, eye: Array, rims: Array) -> list[float]:
    """Shares of the rim's angle, 0 to ``RIM``, between which the profile of every sector is nearly straight."""
    fine = np.linspace(0.0, RIM, 33)
    profiles = [_continued(wall) for wall in _walls(mesh, eye, rims, list(fine))]
    kept = [0, len(fine) - 1]
    while len(kept) <= MOST_RINGS:
        gaps = np.max([_deviation(wall[:, side], sorted(kept)) for wall in profiles for side in range(SECTORS)], axis=0)
        if gaps.max() < CLOSE_RING:
            break
        kept.append(int(np.argmax(gaps)))
    return [float(fine[index]) for index in sorted(kept)]


def _continued(wall: Array) -> Array:
    """``wall`` ``(rings, SECTORS, 3)`` with each missed ray ending where the one before it did."""
    filled = np.array(wall)
    for ring in range(1, len(filled)):
        missing = ~np.isfinite(filled[ring, :, 0])
        filled[ring, missing] = filled[ring - 1, missing]
    return filled


def _deviation(profile: Array, kept: list[int]) -> Array:
    """Distance of each point of ``profile`` ``(n, 3)`` from the chord between the kept ones around it."""
    gaps = np.zeros(len(profile))
    for first, last in pairwise(kept):
        chord = profile[last] - profile[first]
        offsets = profile[first : last + 1] - profile[first]
        length = float(np.linalg.norm(chord))
        gaps[first : last + 1] = np.linalg.norm(np.cross(offsets, chord), axis=1) / max(length, 1e-9)
    return gaps


def _walls(mesh: Mesh, eye: Array, rims: Array, shares: list[float]) -> tuple[Array, Array]:
    """Inner and outer points ``(rings, SECTORS, 3)`` from ``eye``, NaN where a ray misses; in coordinates about it."""
    turns = 2 * np.pi * np.arange(SECTORS) / SECTORS
    down = np.outer(shares, rims)
    directions = np.stack([np.sin(down) * np.cos(turns), np.sin(down) * np.sin(turns), -np.cos(down)], axis=-1)
    near, far = _first_and_last(mesh, eye, directions.reshape(-1, 3))
    far = np.maximum(far, near + THINNEST)
    shape = (len(shares), SECTORS, 1)
    about = np.array([*eye])
    return about + near.reshape(shape) * directions, about + far.reshape(shape) * directions


def _first_and_last(mesh: Mesh, eye: Array, directions: Array) -> tuple[Array, Array]:
    """Distances from ``eye`` to the first and last triangle along each ray, NaN for none (Moeller, Trumbore 1997)."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    ab, ac, ae = b - a, c - a, eye - a
    q = np.cross(ae, ab)
    height = np.einsum("ij,ij->i", ac, q)
    near, far = np.full(len(directions), np.nan), np.full(len(directions), np.nan)
    for number, direction in enumerate(directions):
        p = np.cross(direction, ac)
        determinant = np.einsum("ij,ij->i", ab, p)
        with np.errstate(all="ignore"):
            u = np.einsum("ij,ij->i", ae, p) / determinant
            v = (q @ direction) / determinant
            t = height / determinant
            hit = (u >= -1e-6) & (v >= -1e-6) & (u + v <= 1.0 + 1e-6) & (t > 0.0) & np.isfinite(t)
        if hit.any():
            near[number], far[number] = t[hit].min(), t[hit].max()
    return near, far


def _cells(near: Array, far: Array) -> list[Mesh]:
    cells: list[Mesh] = []
    first = 0
    if float(np.ptp(near[:2, :, 2])) < FLAT_MIDDLE:
        cells.append(hull(np.concatenate([near[1], far[1], near[0, :1], far[0, :1]])))
        first = 1
    for inner, outer in pairwise(range(first, len(near))):
        for left, right in pairwise([*range(SECTORS), 0]):
            corners = [w[ring, side] for w in (near, far) for ring in (inner, outer) for side in (left, right)]
            cells += _solid(np.array(corners))
    return cells


def _solid(corners: Array) -> list[Mesh]:
    """The hull of ``corners``, or nothing where rays fell together and they span no volume."""
    try:
        return [hull(corners)]
    except ValueError:
        return []


def _planes(part: Mesh) -> tuple[Array, Array]:
    """Unit normals ``(n, 3)`` and offsets ``(n,)`` of a convex part's faces."""
    a, b, c = (part.vertices[part.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    sizes = np.linalg.norm(normals, axis=1)
    normals = normals[sizes > 0.0] / sizes[sizes > 0.0, None]
    return normals, np.einsum("ij,ij->i", normals, a[sizes > 0.0])


def _within(points: Array, planes: list[tuple[Array, Array]], margin: float) -> np.ndarray:
    """Whether each point is in some convex part grown by ``margin`` [m]."""
    found = np.zeros(len(points), dtype=bool)
    for normals, offsets in planes:
        rest = np.flatnonzero(~found)
        found[rest] = ((points[rest] @ normals.T) <= offsets + margin).all(axis=1)
    return found


def _thinned(points: Array, most: int) -> Array:
    """About ``most`` of ``points``, the same ones each time."""
    return np.asarray(points[:: max(1, len(points) // most)])


def _cavity(mesh: Mesh) -> Array:
    """Grid points inside the hull of the mesh with nothing of it above them."""
    extent = np.ptp(mesh.vertices, axis=0)
    cell = float(extent.max()) / 60.0
    surface = dense(mesh, 0.7 * cell)
    low = mesh.vertices.min(axis=0)
    columns = np.floor((surface[:, :2] - low[:2]) / cell).astype(int)
    tops = np.full(tuple(columns.max(axis=0) + 1), np.inf)
    tops[columns[:, 0], columns[:, 1]] = -np.inf
    np.maximum.at(tops, (columns[:, 0], columns[:, 1]), surface[:, 2])
    heights = low[2] + (np.arange(int(np.ceil(extent[2] / cell)) * 2) + 0.5) * 0.5 * cell
    rows, lines, levels = np.meshgrid(*(np.arange(count) for count in tops.shape), heights, indexing="ij")
    open_above = levels > tops[rows, lines] + SKIN
    xy = low[:2] + (np.stack([rows[open_above], lines[open_above]], axis=1) + 0.5) * cell
    points = _thinned(np.column_stack([xy, levels[open_above]]), 4 * MOST_SAMPLES)
    return np.asarray(points[_within(points, [_planes(hull(mesh.vertices))], 0.0)])
