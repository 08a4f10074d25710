"""Which meshes are there in a folder of rigid object models, of which category, and what is said about them?

Three layouts are read: a folder with an ``INDEX.json``, one entry an object; ShapeNet's
``<synset>/<id>/models/model_normalized.obj``; and one folder per category holding mesh files or a folder per object.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from robots.errors import BadInput
from robots.spatial import Array
from worlds.assets.everyday import CATEGORIES
from worlds.assets.meshfile import SUFFIXES

INDEX = "INDEX.json"

DESCRIPTIONS = (".urdf", ".xml")
"""Files that say which meshes make up an object: URDF and MJCF."""

SHAPENET = "models/model_normalized.obj"
"""Where ShapeNetCore v2 keeps a model: y-up, its diagonal one unit long."""

SYNSETS = {
    "02876657": "Bottle",
    "02880940": "Bowl",
    "02954340": "Cap",
    "03085013": "Keyboard",
    "03642806": "Laptop",
    "02992529": "Phone",
    "04401088": "Phone",
    "04074963": "Remote",
}
"""ShapeNetCore's folders by WordNet synset (its taxonomy.json): bottle, bowl, cap, computer keyboard, laptop, cellular
telephone, telephone, remote control."""

PENS = ("Pen-Cap", "Pen-Button")
"""What a model that is only called a pen may be."""

PARTS_OF_MODELS = ("coacd", "collision", "contact", "convex", "hull")
"""Words in the names of mesh files that hold a collision shape, not the object."""

ARTICULATED_SOURCE = "partnet_mobility"
"""Entries of an index that ``partnet:DIR`` reads."""

MOST_FILES = 5_000
"""A folder of one object is searched no further than this many files."""


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """One rigid object of a folder.

    Attributes:
        category: Object category.
        instance: Its name, unique within the category.
        file: Mesh file or description to read.
        folder: Where to look for a mesh when ``file`` is missing; ``None`` when it is the object's only file.
        up: Which axis of the file points up.
        scale: Metres per unit along the file's axes ``(3,)``; ``None`` when the size is unknown.
        problem: Why it cannot be used, where that shows already.
    """

    category: str
    instance: str
    file: Path
    folder: Path | None
    up: Literal["y", "z"]
    scale: Array | None
    problem: str = ""


def entries(root: Path) -> list[Entry]:
    """Every object under ``root``, in order of category and name.

    Raises:
        BadInput: The index cannot be read, or there are no folders of known categories.
    """
    index = root / INDEX
    found = _indexed(root, index) if index.is_file() else _by_folder(root)
    return sorted(found, key=lambda entry: (CATEGORIES.index(entry.category), entry.instance))


def meant(name: str) -> tuple[str, ...]:
    """The object categories that a folder or an index entry called ``name`` may hold; none for foreign ones."""
    if name in SYNSETS:
        return (SYNSETS[name],)
    if name.casefold() == "pen":
        return PENS
    return tuple(category for category in CATEGORIES if category.casefold() == name.casefold())


class _Row(msgspec.Struct, frozen=True):
    """One entry of an index; other fields are not read."""

    category: str
    id: str
    path: str
    entry: str
    source: str = ""
    units: str = ""
    scale_xyz_obj_to_m: list[float] | None = None
    json_scale: list[float] | None = None


def _indexed(root: Path, index: Path) -> list[Entry]:
    try:
        rows = msgspec.json.decode(index.read_bytes(), type=list[_Row])
    except (msgspec.DecodeError, OSError) as error:
        raise BadInput(f"The index {index} cannot be read: {error}.") from error
    rigid = [row for row in rows if row.source != ARTICULATED_SOURCE]
    return [_from_row(root, row, category) for row in rigid for category in meant(row.category)]


def _from_row(root: Path, row: _Row, category: str) -> Entry:
    folder = _resolved(root, row.path)
    scale, problem = _row_scale(row)
    if not folder.resolve().is_relative_to(root.resolve()):
        problem = f'its path "{row.path}" leaves the folder of the index'
    return Entry(
        category=category,
        instance=f"{row.source}-{row.id}" if row.source else row.id,
        file=folder / row.entry,
        folder=folder,
        up="y" if "y-up" in row.units.casefold() else "z",
        scale=scale,
        problem=problem,
    )


def _resolved(root: Path, path: str) -> Path:
    """The folder ``path`` means, seen from ``root`` or, when it begins with the name of ``root``, from its parent."""
    parts = Path(path).parts
    return root.joinpath(*parts[1:]) if parts[:1] == (root.name,) and not (root / path).is_dir() else root / path


def _row_scale(row: _Row) -> tuple[Array, str]:
    return _positive(row.scale_xyz_obj_to_m or row.json_scale or [1.0, 1.0, 1.0], "the index")


def _by_folder(root: Path) -> list[Entry]:
    folders = sorted(path for path in root.iterdir() if path.is_dir())
    found = [entry for folder in folders for category in meant(folder.name) for entry in _in_category(folder, category)]
    if not any(meant(folder.name) for folder in folders):
        have = ", ".join(folder.name for folder in folders[:12]) or "no folders"
        raise BadInput(f"The folder {root} has neither {INDEX} nor a folder of a known category; it has: {have}.")
    return found


def _in_category(folder: Path, category: str) -> list[Entry]:
    items = [path for path in sorted(folder.iterdir()) if path.is_dir() or path.suffix.lower() in SUFFIXES]
    stems = [path.stem for path in items]
    return [
        _from_path(path, category, path.stem if path.is_file() and stems.count(path.stem) == 1 else path.name)
        for path in items
    ]


def _from_path(path: Path, category: str, instance: str) -> Entry:
    if path.is_file():
        return Entry(category, instance, path, None, _up(path), np.ones(3))
    normalised = path / SHAPENET
    if normalised.is_file():
        return Entry(category, instance, normalised, None, "y", None)
    described = sorted(file for file in path.iterdir() if file.suffix.lower() in DESCRIPTIONS)
    file = described[0] if described else main_mesh(path)
    if file is None:
        problem = f"it has neither {SHAPENET}, a URDF, nor a mesh ({', '.join(SUFFIXES)})"
        return Entry(category, instance, path, None, "z", np.ones(3), problem)
    scale, problem = _model_data_scale(path)
    return Entry(category, instance, file, path, _up(file), scale, problem)


def _up(file: Path) -> Literal["y", "z"]:
    """Files of glTF are y-up by definition; other formats do not say, and robot models are z-up."""
    return "y" if file.suffix.lower() in (".glb", ".gltf") else "z"


def _model_data_scale(folder: Path) -> tuple[Array, str]:
    """The scale in RoboTwin's ``model_data<k>.json`` beside a mesh, else one; and what is wrong with it."""
    described = sorted(folder.glob("model_data*.json"))
    if not described:
        return np.ones(3), ""
    try:
        values = msgspec.json.decode(described[0].read_bytes(), type=_ModelData).scale
    except (msgspec.DecodeError, OSError) as error:
        return np.ones(3), f"its {described[0].name} cannot be read ({error})"
    return _positive(values, described[0].name)


class _ModelData(msgspec.Struct, frozen=True):
    scale: list[float] = msgspec.field(default_factory=lambda: [1.0, 1.0, 1.0])


def _positive(values: list[float], where: str) -> tuple[Array, str]:
    scale = np.array(values, dtype=np.float64)
    if scale.shape != (3,) or not np.isfinite(scale).all() or scale.min() <= 0.0:
        return np.ones(3), f"its scale {values} in {where} is not three positive numbers"
    return scale, ""


def main_mesh(folder: Path) -> Path | None:
    """The mesh file in ``folder`` that shows the object: not a collision shape, the largest of what is left."""
    files = [path for path, _ in zip(sorted(folder.rglob("*")), range(MOST_FILES), strict=False) if path.is_file()]
    meshes = [path for path in files if path.suffix.lower() in SUFFIXES]
    shown = [path for path in meshes if not any(word in path.stem.casefold() for word in PARTS_OF_MODELS)]
    return max(shown or meshes, key=lambda path: path.stat().st_size, default=None)
