"""Which verbs there are; each module is imported when it is asked for."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

NAMES = ("plan", "verify", "run", "why", "view", "bench", "collect", "data", "train", "assets", "doctor")

Loader = Callable[[], Any]


def _loader(name: str) -> Loader:
    return lambda: import_module(f"tamp.cli.{name}")


VERBS: dict[str, Loader] = {name: _loader(name) for name in NAMES}


def subverbs(verb: str) -> dict[str, Loader]:
    """The words that may follow a verb: every module ``VERB_WORD`` of this package is one."""
    folder = str(Path(__file__).parent)
    found = sorted(name for _, name, _ in pkgutil.iter_modules([folder]) if name.startswith(f"{verb}_"))
    return {name.removeprefix(f"{verb}_"): _loader(name) for name in found}
