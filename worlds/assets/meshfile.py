"""Which triangles does an OBJ, STL, GLB or PLY file hold?"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from robots.spatial import Array
from worlds.assets.solids import Faces, Mesh

SUFFIXES = (".obj", ".glb", ".gltf", ".stl", ".ply")
"""Mesh files that are read, by the end of their name."""

LARGEST_FILE = 400_000_000
"""A mesh file may hold no more bytes than this."""

MOST_READ = 5_000_000
"""A mesh may have no more triangles than this."""

MOST_KEPT = 40_000
"""A mesh with more triangles is simplified: about ten times what the cameras resolve of an object 20 cm long."""

COARSEST, FINEST = 4, 1024
"""Cells along the longest side on which vertices are merged; more are tried until too many triangles stay."""


class Unreadable(Exception):
    """Why a file gives no mesh, in one clause."""


def read_mesh(path: Path) -> tuple[Mesh, tuple[str, ...]]:
    """All triangles of a mesh file in its own unit and axes, and notes on what was left out.

    Raises:
        Unreadable: The file is missing, of another kind, too large, damaged, or holds no finite triangle.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise Unreadable(f"{path.name} is no mesh file: {', '.join(SUFFIXES)} are read")
    if not path.is_file():
        raise Unreadable(f"its mesh {path.name} is missing")
    size = path.stat().st_size
    if size > LARGEST_FILE:
        raise Unreadable(f"its mesh {path.name} has {size / 1e6:.0f} MB, more than {LARGEST_FILE / 1e6:.0f} MB")
    mesh = _checked(_parsed(path), path.name)
    if len(mesh.faces) <= MOST_KEPT:
        return mesh, ()
    simpler = simplified(mesh)
    return simpler, (f"{path.name} simplified from {len(mesh.faces)} to {len(simpler.faces)} triangles",)


def _parsed(path: Path) -> tuple[Array, Faces]:
    """Vertices ``(n, 3)`` and faces ``(m, 3)`` as trimesh reads them, placed by the file's own scene."""
    import trimesh

    options: dict[str, Any] = {"skip_materials": True} if path.suffix.lower() == ".obj" else {}
    try:
        loaded: Any = trimesh.load(path, force="mesh", process=False, **options)
    except Exception as error:  # every format's reader has exceptions of its own
        detail = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise Unreadable(f"its mesh {path.name} cannot be read ({detail})") from error
    faces = getattr(loaded, "faces", None)
    if faces is None or len(faces) == 0:
        raise Unreadable(f"its mesh {path.name} has no triangles")
    return np.asarray(loaded.vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)


def _checked(parsed: tuple[Array, Faces], name: str) -> Mesh:
    vertices, faces = parsed
    if len(faces) > MOST_READ:
        raise Unreadable(f"its mesh {name} has {len(faces)} triangles, more than {MOST_READ}")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise Unreadable(f"a face of {name} names vertex {int(faces.max()) + 1} of {len(vertices)}")
    used, renamed = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], renamed.reshape(-1, 3).astype(np.int64)
    if not np.isfinite(vertices).all():
        raise Unreadable(f"vertices of {name} are not finite")
    if len(faces) < 4:
        raise Unreadable(f"its mesh {name} has {len(faces)} triangles, a body needs at least 4")
    return Mesh(vertices, faces)


def simplified(mesh: Mesh, most: int = MOST_KEPT) -> Mesh:
    """``mesh`` with its vertices merged on the finest grid that leaves at most ``most`` triangles.

    Rossignac and Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993: cells of the grid
    become single vertices, and triangles with two corners in one cell vanish.
    """
    low, high = COARSEST, FINEST
    best = _clustered(mesh, low)
    while high - low > 8:
        middle = (low + high) // 2
        candidate = _clustered(mesh, middle)
        if len(candidate.faces) <= most:
            low, best = middle, candidate
        else:
            high = middle
    return best


def _clustered(mesh: Mesh, cells: int) -> Mesh:
    extent = float(np.ptp(mesh.vertices, axis=0).max())
    keys = np.floor((mesh.vertices - mesh.vertices.min(axis=0)) / max(extent / cells, 1e-300)).astype(np.int64)
    flat = (keys[:, 0] * (cells + 2) + keys[:, 1]) * (cells + 2) + keys[:, 2]
    _, inverse, counts = np.unique(flat, return_inverse=True, return_counts=True)
    inverse = inverse.reshape(-1)
    sums = np.zeros((len(counts), 3))
    np.add.at(sums, inverse, mesh.vertices)
    faces = inverse[mesh.faces]
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 0] != faces[:, 2])
    faces = faces[distinct]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return Mesh(sums / counts[:, None], faces[np.sort(first)])
