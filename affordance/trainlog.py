"""What is told of a training while it runs: a log of lines, and an interruption that waits for the end of a step."""

from __future__ import annotations

import json
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

import torch

from affordance.losses import Parts, total
from affordance.settings import Settings
from robots.cache import write_atomic

Watch = Callable[[int, Mapping[str, float]], None]
"""Is told the step and the numbers of every line of the log."""


class Log:
    """Means of the losses since the last line, written as lines."""

    def __init__(self, path: Path, settings: Settings, step: int, watch: Watch) -> None:
        """Go on in the file of a training that has done so many steps."""
        self.path, self.settings, self.watch = path, settings, watch
        self.loss = float("nan")
        self._before = _cut_back(path, step)
        self._began = time.monotonic()
        self._sums: dict[str, float] = {}
        self._count = 0

    def add(self, parts: Parts) -> None:
        """Take in the losses of a step."""
        self._count += 1
        for f in fields(Parts):
            self._sums[f.name] = self._sums.get(f.name, 0.0) + float(getattr(parts, f.name).detach())

    def write(self, step: int, rate: float) -> None:
        """Write a line of what was taken in up to a step with its learning rate."""
        line = {name: value / self._count for name, value in self._sums.items()}
        self.loss = _weighed(line, self.settings)
        seconds = self._before + time.monotonic() - self._began
        line |= {"loss": self.loss, "rate": rate, "seconds": seconds}
        self.append({"step": step, **line})
        self.watch(step, line)
        self._sums, self._count = {}, 0

    def append(self, values: Mapping[str, Any]) -> None:
        """Write any line."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(values) + "\n")


@contextmanager
def interruptible() -> Iterator[list[int]]:
    """A list that an interruption fills, so that it is heard between two steps; a second one is not waited for.

    Outside of the main thread, where signals cannot be handled, the list stays empty.
    """
    heard: list[int] = []

    def hear(number: int, frame: object) -> None:
        if heard:
            raise KeyboardInterrupt
        heard.append(number)

    if threading.current_thread() is not threading.main_thread():
        yield heard
        return
    before = signal.signal(signal.SIGINT, hear)
    try:
        yield heard
    finally:
        signal.signal(signal.SIGINT, before)


def _weighed(parts: Mapping[str, float], settings: Settings) -> float:
    tensors = {f.name: torch.tensor(parts[f.name]) for f in fields(Parts)}
    return float(total(Parts(**tensors), settings.losses))


def _cut_back(path: Path, step: int) -> float:
    """Forget what the log says of steps after a checkpoint, and a cut off line; returns the seconds spent till then."""
    if not path.is_file():
        return 0.0
    kept, seconds = [], 0.0
    for line in path.read_text("utf-8").splitlines():
        try:
            row = json.loads(line)
            if row["step"] <= step:
                kept.append(line)
                seconds = float(row.get("seconds", seconds))
        except (json.JSONDecodeError, KeyError, TypeError):
            break
    write_atomic(path, "".join(f"{line}\n" for line in kept).encode())
    return seconds
