"""An episode of a benchmark that always raises; workers import it by name."""

from __future__ import annotations

from typing import Any

from tamp.bench.jobs import Job


def raising(job: Job, **_: Any) -> None:
    """Raise."""
    raise RuntimeError("out of luck")
