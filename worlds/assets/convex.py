"""Which convex parts stand for a mesh in collision?

Imported meshes are thin open shells, so their own volume says nothing. ``solidity`` instead compares the hull of
the whole with the hulls of its slices: open ends cost nothing, and what the hull wrongly fills shows.
"""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np

from robots.cache import cache_dir, content_hash, write_atomic
from robots.spatial import Array
from worlds.assets.solids import Faces, Mesh, hull, merged, volume

SOLID = 0.7
"""Above this solidity one hull is close enough; measured: bottle bodies 0.92 to 0.97, a pump with nozzle 0.33."""

SMALL = 4e-6
"""Below this hull volume one hull is always close enough [m^3]."""

THIN = 2e-9
"""Below this hull volume a mesh is a sheet that no finger feels [m^3]: 0.1 mm over 4 x 5 mm."""

SLICES = 8
"""Slices along each axis for ``solidity``."""

MOST_PIECES = 8
"""Largest number of convex parts of one mesh."""

MOST_PARTS = 24
"""Largest number of convex parts of one link; the biggest stay."""

CONTAINED = 0.001
"""A part that sticks out of another by less than this is dropped [m]."""

RULES = (SOLID, SMALL, THIN, SLICES, MOST_PIECES, MOST_PARTS, CONTAINED)
"""What the remembered parts depend on besides the mesh."""

COACD_SETTINGS = {
    "threshold": 0.15,
    "max_convex_hull": MOST_PIECES,
    "preprocess_resolution": 25,
    "resolution": 500,
    "mcts_nodes": 10,
    "mcts_iterations": 30,
    "mcts_max_depth": 2,
    "seed": 1,
}
"""Coarse and quick (0.5 to 6 s a mesh): Wei et al., "Approximate Convex Decomposition for 3D Meshes with
Collision-Aware Concavity and Tree Search", SIGGRAPH 2022."""


def convex_parts(meshes: tuple[Mesh, ...]) -> tuple[Mesh, ...]:
    """Convex solids around ``meshes``, the largest first, without those inside another; remembered on disk.

    Args:
        meshes: Triangle meshes of one link [m]; they need not be closed.

    Returns:
        At most ``MOST_PARTS`` hulls; none when every mesh is flat.
    """
    path = cache_dir() / "convex" / f"{_key(meshes)}.json"
    if not path.is_file():
        write_atomic(path, json.dumps([part.vertices.tolist() for part in _sorted_out(meshes)]))
    return tuple(hull(np.array(vertices)) for vertices in json.loads(path.read_text()))


def lumped(meshes: tuple[Mesh, ...]) -> tuple[Mesh, ...]:
    """Convex solids around ``meshes`` taken as one body: a single hull where that is close enough.

    A laptop's base comes as a hundred sheets and keys; as a whole it is a slab.
    """
    if len(meshes) < 2:
        return convex_parts(meshes)
    whole = merged(meshes)
    try:
        return (hull(whole.vertices),) if solidity(whole) > SOLID else convex_parts(meshes)
    except ValueError:
        return ()


def _key(meshes: tuple[Mesh, ...]) -> str:
    rules = json.dumps([RULES, COACD_SETTINGS])
    return content_hash(rules, *(data for mesh in meshes for data in (mesh.vertices.tobytes(), mesh.faces.tobytes())))


def _sorted_out(meshes: tuple[Mesh, ...]) -> list[Mesh]:
    parts = sorted((part for mesh in meshes for part in _parts_of(mesh)), key=volume, reverse=True)
    kept: list[Mesh] = []
    for part in parts:
        if len(kept) < MOST_PARTS and not any(_inside(part, other) for other in kept):
            kept.append(part)
    return kept


def solidity(mesh: Mesh) -> float:
    """How much of its convex hull a mesh fills from outside, in 0..1; the least over slicing along x, y and z."""
    whole = volume(hull(mesh.vertices))
    points = dense(mesh, float(np.ptp(mesh.vertices, axis=0).min()) / (4 * SLICES))
    return min(_sliced_volume(points, axis) for axis in range(3)) / whole


def _parts_of(mesh: Mesh) -> tuple[Mesh, ...]:
    try:
        whole = hull(mesh.vertices)
    except ValueError:
        return ()
    if volume(whole) < THIN:
        return ()
    if volume(whole) < SMALL or solidity(mesh) > SOLID:
        return (whole,)
    pieces = [hull(piece) for piece in _decomposed(mesh.vertices, mesh.faces)]
    return tuple(piece for piece in pieces if volume(piece) >= THIN) or (whole,)


def _sliced_volume(points: Array, axis: int) -> float:
    edges = np.linspace(points[:, axis].min(), points[:, axis].max(), SLICES + 1)
    total = 0.0
    for low, high in pairwise(edges):
        slab = points[(points[:, axis] >= low - 1e-9) & (points[:, axis] <= high + 1e-9)]
        try:
            total += volume(hull(slab))
        except ValueError:
            continue
    return total


def dense(mesh: Mesh, spacing: float, most: int = 24) -> Array:
    """Vertices and points on the triangles of ``mesh``.

    Args:
        mesh: Any triangles [m].
        spacing: Largest distance between neighbours along an edge [m].
        most: No edge is cut into more pieces than this, whatever ``spacing`` asks for.

    Returns:
        ``(n, 3)`` points [m].
    """
    corners = mesh.vertices[mesh.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    steps = np.clip(np.ceil(longest / spacing), 1, most).astype(int)
    clouds = [mesh.vertices]
    for count in np.unique(steps):
        weights = np.array([(i, j, count - i - j) for i in range(count + 1) for j in range(count + 1 - i)]) / count
        clouds.append(np.einsum("wc,fcd->fwd", weights, corners[steps == count]).reshape(-1, 3))
    return np.concatenate(clouds)


def _inside(part: Mesh, other: Mesh) -> bool:
    a, b, c = (other.vertices[other.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    sizes = np.linalg.norm(normals, axis=1)
    normals, a = normals[sizes > 0.0] / sizes[sizes > 0.0, None], a[sizes > 0.0]
    heights = part.vertices @ normals.T - np.einsum("ij,ij->i", normals, a)
    return bool(heights.max() < CONTAINED)


def _decomposed(vertices: Array, faces: Faces) -> list[Array]:
    import coacd

    coacd.set_log_level("off")
    parts = coacd.run_coacd(coacd.Mesh(vertices, faces), **COACD_SETTINGS)
    return [np.array(np.round(points, 7), dtype=np.float64) for points, _ in parts]
