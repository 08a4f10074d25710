"""Which object models are there, and how is one of them fetched or chosen?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from robots.errors import BadAsset, BadInput, UnknownName
from worlds.assets import meshes, partnet
from worlds.assets.asset import Asset, Rejected, Split
from worlds.assets.everyday import CATEGORIES
from worlds.assets.synthetic.families import FAMILIES
from worlds.assets.synthetic.series import MOST

FORMS = (
    "synthetic, synthetic:COUNT (so many instances of each category, the further ones to learn from), "
    "partnet:DIR (DIR holds PartNet-Mobility folders by category, for example DIR/Bottle), "
    "mesh:DIR (DIR holds meshes by category, for example DIR/Bowl/round.obj, ShapeNet synsets, or an INDEX.json)"
)
"""The valid sources, for messages."""

FOLDERS: dict[str, ModuleType] = {"partnet": partnet, "mesh": meshes}
"""Which file reads each kind of folder; each has ``present``, ``names`` and ``make``."""


@dataclass(frozen=True, slots=True)
class Source:
    """Where object models come from.

    Attributes:
        text: As the user wrote it.
        root: The folder of models, or None for the generated families.
        kind: ``synthetic``, ``partnet`` or ``mesh``.
        count: Least number of instances of a generated family.
    """

    text: str
    root: Path | None = None
    kind: str = "synthetic"
    count: int = 0


def parse_source(source: str) -> Source:
    """The source meant by ``source``.

    Args:
        source: ``synthetic``, ``synthetic:COUNT``, ``partnet:DIR`` or ``mesh:DIR``.

    Raises:
        BadInput: It is neither, or DIR is not a folder.
    """
    if source == "synthetic":
        return Source(source)
    kind, colon, folder = source.partition(":")
    if kind == "synthetic":
        if not (folder.isascii() and folder.isdigit() and len(folder) <= 4 and 0 < int(folder) <= MOST):
            raise BadInput(f'No object source "{source}": COUNT is a number from 1 to {MOST}. Valid: {FORMS}.')
        return Source(source, count=int(folder))
    if kind not in FOLDERS or not colon or not folder:
        raise BadInput(f'No object source "{source}". Valid: {FORMS}.')
    root = Path(folder).expanduser().absolute()
    if not root.is_dir():
        raise BadInput(f"No folder {root} for the object source {source}. Valid: {FORMS}.")
    return Source(source, root, kind)


def categories(source: str) -> list[str]:
    """Categories that a source has.

    Raises:
        BadInput: The source cannot be used.
    """
    where = parse_source(source)
    if where.root is None:
        return list(FAMILIES)
    found: list[str] = FOLDERS[where.kind].present(where.root)
    return found


def names(source: str, category: str, split: Split | None = None) -> list[str]:
    """Sorted instance names of one category, without building any; of one split when given.

    Raises:
        UnknownName: No such category.
        BadInput: The source cannot be used.
    """
    where = parse_source(source)
    _check_category(where, category)
    if where.root is None:
        return FAMILIES[category].series.names(split, where.count)
    found: list[str] = FOLDERS[where.kind].names(where.root, category, split)
    return found


def load(source: str, category: str, instance: str) -> Asset:
    """The asset ``instance``, built into the cache when it is not there yet.

    Raises:
        UnknownName: No such category or instance; suggests one.
        BadAsset: The model cannot be used, with the reason.
    """
    where = parse_source(source)
    _check_category(where, category)
    if where.root is None:
        FAMILIES[category].series.index(instance, where.count)
        return FAMILIES[category].make(instance)
    made: Asset = FOLDERS[where.kind].make(where.root, where.text, category, instance)
    return made


def survey(source: str, category: str, split: Split | None = None) -> list[Asset | Rejected]:
    """Every instance in order of name, the unusable ones with their reason."""
    return [_attempt(source, category, name) for name in names(source, category, split)]


def choose(source: str, category: str, split: Split | None, seed: int) -> Asset:
    """One usable instance, each equally likely; the same for the same ``seed``.

    Raises:
        BadInput: No instance is usable.
    """
    listed = names(source, category, split)
    rejected: list[Rejected] = []
    for place in np.random.default_rng(seed).permutation(len(listed)):
        match _attempt(source, category, listed[place]):
            case Asset() as asset:
                return asset
            case Rejected() as refusal:
                rejected.append(refusal)
    reasons = "; ".join(f"{refusal.instance}: {refusal.reason}" for refusal in rejected) or "there are none"
    raise BadInput(f"No usable {category} in {source}{f' ({split})' if split else ''}: {reasons}.")


def _attempt(source: str, category: str, instance: str) -> Asset | Rejected:
    try:
        return load(source, category, instance)
    except BadAsset as refusal:
        return Rejected(source, category, instance, refusal.reason)


def _check_category(where: Source, category: str) -> None:
    valid = FAMILIES if where.root is None else CATEGORIES
    if category not in valid:
        raise UnknownName("category", category, valid)
    if where.kind == "partnet" and category not in partnet.CATEGORIES:
        read = ", ".join(partnet.CATEGORIES)
        raise BadInput(f"{category} is not read from {where.text}, only {read} are; leave out --asset for {category}.")
