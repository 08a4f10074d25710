"""Which episodes make up a benchmark?"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Literal, get_args

from msgspec import Struct

from robots.errors import BadInput, UnknownName
from tamp.bench.seeds import PER_LIST, benchmark_seeds
from worlds.assets import library
from worlds.assets.asset import Asset, Split
from worlds.tasks import COLUMNS, HANDOVER, TASKS, task_of

Mode = Literal["E1", "E2", "E3"]
"""E1: the best candidate of each stage only. E2: candidates are resampled. E3: closed loop, several pushes."""

MODES: tuple[Mode, ...] = get_args(Mode)
SPLITS: tuple[Split, ...] = get_args(Split)


class Settings(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that decides a benchmark's results; the names are those of the command line's flags."""

    methods: list[str]
    mode: list[Mode]
    categories: list[str]
    split: list[Split]
    asset: str
    episodes: int
    """Of each method, mode, category and split, or instance."""
    every_instance: bool
    """Whether each usable instance is tried, instead of the one that the seed chooses."""
    timeout: float
    """Wall time of one search [s]."""
    versions: dict[str, str]
    """Installed packages."""
    program: str
    """Digest of this program's code."""


class Job(Struct, frozen=True, kw_only=True):
    """One episode."""

    method: str
    mode: Mode
    category: str
    split: Split
    seed: int
    named: str | None = None
    """The instance, where the seed does not choose it."""

    @property
    def key(self) -> str:
        """Its name, unique in a benchmark and usable as a folder's name."""
        chosen = "" if self.named is None else f"-{self.named}"
        return f"{self.method}-{self.mode}-{self.category}-{self.split}-{self.seed}{chosen}"


def jobs_of(settings: Settings) -> list[Job]:
    """Every episode. The seeds' numbers are the outermost loop, so an interrupted run has some of every column."""
    return [
        Job(
            method=method,
            mode=mode,
            category=category,
            split=split,
            seed=benchmark_seeds(category, split)[number],
            named=named,
        )
        for number in range(settings.episodes)
        for category in settings.categories
        for split in settings.split
        for named in (usable(settings.asset, category, split) if settings.every_instance else (None,))
        for mode in settings.mode
        for method in settings.methods
    ]


@cache
def usable(asset: str, category: str, split: Split) -> tuple[str, ...]:
    """Names of the instances of a column's objects that can be used, in order; each is built once."""
    found = library.survey(asset, task_of(category).objects, split)
    return tuple(each.instance for each in found if isinstance(each, Asset))


def check_episodes(episodes: int) -> None:
    """Refuse a number of episodes for which there are no seeds."""
    if not 1 <= episodes <= PER_LIST:
        raise BadInput(f"--episodes {episodes}: each column and split has {PER_LIST} seeds; give 1 to {PER_LIST}.")


def chosen(kind: str, text: str, valid: Sequence[str]) -> list[str]:
    """The names in a comma list, ``all`` standing for every valid one.

    Raises:
        UnknownName: One does not exist.
        BadInput: There is none.
    """
    return _expanded(kind, text, valid, {"all": list(valid)})


def chosen_categories(text: str) -> list[str]:
    """The columns in a comma list: ``all`` stands for the paper's eighteen, ``handover`` for the handover columns."""
    return _expanded("category", text, list(TASKS), {"all": list(COLUMNS), "handover": list(HANDOVER)})


def _expanded(kind: str, text: str, valid: Sequence[str], groups: dict[str, list[str]]) -> list[str]:
    names: list[str] = []
    for word in (part.strip() for part in text.split(",")):
        if word in groups:
            names += groups[word]
        elif word in valid:
            names.append(word)
        elif word:
            raise UnknownName(kind, word, [*valid, *groups])
    if not names:
        raise BadInput(f'"{text}" names no {kind}. Valid: {", ".join([*groups, *valid])}.')
    return list(dict.fromkeys(names))


def required(
    asset: str, wanted: list[str], splits: Sequence[Split], text: str, *, every: bool = False
) -> tuple[list[str], list[str]]:
    """The columns for whose objects a source has instances in every split, and the others.

    Args:
        asset: The source.
        wanted: Columns that are asked for.
        splits: Where instances are needed.
        text: The comma list that asked for them.
        every: Whether each usable instance is tried: then one usable in any of the splits is enough.

    Raises:
        BadInput: The source cannot be used, has nothing, or lacks a column that the list names itself, not by a group.
    """
    has = set(library.categories(asset))
    found = [
        category
        for category in wanted
        if (objects := task_of(category).objects) in has
        and (
            any(usable(asset, category, split) for split in splits)
            if every
            else all(library.names(asset, objects, split) for split in splits)
        )
    ]
    absent = [category for category in wanted if category not in found]
    named = [category for category in absent if category in [word.strip() for word in text.split(",")]]
    if named or not found:
        raise BadInput(
            f"{asset} has no {' and '.join(splits)} objects for {', '.join(named or absent)}; "
            f"of the columns asked for it has {', '.join(found) or 'none'}."
        )
    return found, absent
