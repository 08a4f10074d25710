"""Which verbs there are; each module is imported when it is asked for."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

NAMES = ("plan", "verify", "run", "why", "view", "assets", "doctor")


def _loader(name: str) -> Callable[[], Any]:
    return lambda: import_module(f"tamp.cli.{name}")


VERBS: dict[str, Callable[[], Any]] = {name: _loader(name) for name in NAMES}
