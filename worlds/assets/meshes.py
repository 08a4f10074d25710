"""How is a rigid mesh made real: which size and posture, which convex parts, which mass?

Nothing read is trusted: what cannot be used is a ``BadAsset`` with its reason, never a guess in silence. What is
supplied is said in the asset's notes. A mesh has no joints, so it serves only tasks that operate none.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robots.cache import content_hash
from robots.errors import BadAsset, BadInput, UnknownName
from robots.spatial import Array, points
from worlds.assets.asset import Asset, Split
from worlds.assets.build import Design, Link, realise
from worlds.assets.collection import DESCRIPTIONS, Entry, entries, main_mesh
from worlds.assets.convex import convex_parts
from worlds.assets.described import Described, Placed, read_mjcf, read_urdf
from worlds.assets.everyday import CATEGORIES, EVERYDAY, MODEL_SPAN, WIDEST_GRIP, density_for, needs_part
from worlds.assets.hollow import hollow_parts
from worlds.assets.meshfile import Unreadable, read_mesh
from worlds.assets.partnet import BODY_COLOUR, HELD_OUT
from worlds.assets.posture import flat_rotation, fuller_side_down, wider_end_up
from worlds.assets.solids import Mesh, merged, moved, volume

Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Takes coordinates of a y-up file to z-up ones."""

OVER = np.diag([1.0, -1.0, -1.0])
"""Half a turn about x."""

FRONT = np.array([0.0, -1.0, 0.0])
"""Where the front of an upright model faces after ``Y_UP``: files face +z."""

THIN = 0.35
"""An object whose thinnest side is less than this share of its longest can be laid flat."""

OPENING_UP = {"Bowl": True, "Plate": True, "Cap": False}
"""Whether a shell rests with its opening up."""


def present(root: Path) -> list[str]:
    """Categories of which ``root`` has at least one object."""
    have = {entry.category for entry in entries(root)}
    return [category for category in CATEGORIES if category in have]


def names(root: Path, category: str, split: Split | None = None) -> list[str]:
    """Sorted names of the objects of ``category`` under ``root``; of one split when given."""
    found = entries(root)
    listed = [entry.instance for entry in found if entry.category == category]
    if not listed:
        have = ", ".join(sorted({entry.category for entry in found})) or "nothing of ours"
        raise BadInput(f"The folder {root} has no {category}; it has: {have}.")
    return [name for name in listed if split in (None, split_of(name))]


def split_of(instance: str) -> Split:
    """The split of an instance, from a hash of its name."""
    return "unseen" if int(content_hash("rigid-mesh", instance), 16) % HELD_OUT == 0 else "seen"


def make(root: Path, source: str, category: str, instance: str) -> Asset:
    """The asset of one object under ``root``; ``BadAsset`` when it cannot be used."""
    listed = {entry.instance: entry for entry in entries(root) if entry.category == category}
    if instance not in listed:
        raise UnknownName(f"{category} instance", instance, listed)
    entry = listed[instance]
    if needs_part(category):
        raise BadAsset(instance, "it has no joints")
    if entry.problem:
        raise BadAsset(instance, entry.problem)
    try:
        mesh, notes = _read(entry)
        return realise(_design(mesh, source, entry, notes))
    except Unreadable as reason:
        raise BadAsset(instance, str(reason)) from reason


def _read(entry: Entry) -> tuple[Mesh, tuple[str, ...]]:
    """The mesh of ``entry``, z-up, in metres or in an unknown unit, and notes."""
    described = _description(entry)
    notes = described.notes
    meshes: list[Mesh] = []
    for placed in described.meshes:
        mesh, left_out = read_mesh(placed.path)
        notes += left_out
        meshes.append(Mesh(points(placed.T_object_mesh, mesh.vertices * placed.scale), mesh.faces))
    whole = merged(tuple(meshes))
    vertices = whole.vertices * (1.0 if entry.scale is None else entry.scale)
    return Mesh(vertices @ Y_UP.T if entry.up == "y" else vertices, whole.faces), notes


def _description(entry: Entry) -> Described:
    """What ``entry`` is made of; its folder's own mesh, with a note, where its entry file is missing."""
    suffix = entry.file.suffix.lower()
    if entry.file.is_file() and suffix in DESCRIPTIONS:
        return read_urdf(entry.file) if suffix == ".urdf" else read_mjcf(entry.file)
    if entry.file.is_file() or entry.folder is None:
        return _single(entry.file)
    instead = main_mesh(entry.folder) if entry.folder.is_dir() else None
    if instead is None:
        raise Unreadable(f"its {entry.file.name} is missing, and so is any mesh in {entry.folder.name}")
    found = _single(instead)
    return Described(found.meshes, (f"its {entry.file.name} is missing: read {instead.name} instead",))


def _single(file: Path) -> Described:
    import pinocchio as pin

    return Described((Placed(file, np.ones(3), pin.SE3.Identity()),))


def _design(mesh: Mesh, source: str, entry: Entry, notes: tuple[str, ...]) -> Design:
    category, instance = entry.category, entry.instance
    sized, resized = _sized(mesh, entry)
    laid, turned = _laid(sized, category)
    low, high = laid.vertices.min(axis=0), laid.vertices.max(axis=0)
    thin = float((high - low).min())
    if EVERYDAY[category].lies and thin > WIDEST_GRIP:
        raise BadAsset(instance, f"its thinnest side is {1000 * thin:.0f} mm, more than {1000 * WIDEST_GRIP:.0f} mm")
    centred = moved(laid, -0.5 * (low + high))
    parts, shell = _parts(centred, category)
    if not parts:
        raise BadAsset(instance, "it has no volume")
    density, weighed = density_for(category, sum(volume(part) for part in parts))
    return Design(
        source=source,
        category=category,
        instance=instance,
        topology="rigid",
        split=split_of(instance),
        links=(Link("body", parts, density, BODY_COLOUR, centred),),
        joints=(),
        part=None,
        long_axis=np.eye(3)[int(np.argmax(high - low))],
        notes=(*resized, *weighed, *turned, *shell, *notes),
    )


def _sized(mesh: Mesh, entry: Entry) -> tuple[Mesh, tuple[str, ...]]:
    """The mesh in metres: as it is when its size is an everyday one, else scaled."""
    longest = float(np.ptp(mesh.vertices, axis=0).max())
    if longest <= 0.0:
        raise BadAsset(entry.instance, "all its vertices are one point")
    usual = EVERYDAY[entry.category].size
    low, high = MODEL_SPAN
    if entry.scale is not None and low <= longest / usual <= high:
        return mesh, ()
    was = "without a unit" if entry.scale is None else f"{1000 * longest:.4g} mm"
    note = f"size supplied: {1000 * usual:.0f} mm long; as modelled it is {was}"
    return Mesh(mesh.vertices * (usual / longest), mesh.faces), (note,)


def _laid(mesh: Mesh, category: str) -> tuple[Mesh, tuple[str, ...]]:
    """The mesh as it rests on a table, and a note when that is not how it was modelled."""
    R = np.eye(3)
    extent = np.ptp(mesh.vertices, axis=0)
    if category in OPENING_UP:
        R = wider_end_up(mesh, up=OPENING_UP[category])
    elif EVERYDAY[category].lies and extent.min() < THIN * extent.max():
        R = flat_rotation(mesh.vertices, FRONT)
        if not np.array_equal(R, np.eye(3)):
            R = fuller_side_down(_turned(mesh, R)) @ R
    return _turned(mesh, R), () if np.array_equal(R, np.eye(3)) else ("turned to lie as on a table",)


def _turned(mesh: Mesh, R: Array) -> Mesh:
    return Mesh(mesh.vertices @ R.T, mesh.faces)


def _parts(mesh: Mesh, category: str) -> tuple[tuple[Mesh, ...], tuple[str, ...]]:
    """Convex parts of the mesh, and notes on them."""
    if not EVERYDAY[category].hollow:
        return convex_parts((mesh,)), ()
    R = np.eye(3) if OPENING_UP.get(category, True) else OVER
    found, note = hollow_parts(_turned(mesh, R))
    return tuple(_turned(part, R.T) for part in found), (note,)
