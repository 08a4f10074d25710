"""Episodes of a benchmark for tests of the command; workers import them by name."""

from __future__ import annotations

import time
from typing import Any

from tamp.bench.jobs import Job
from tamp.bench.row import Row
from tests.tamp.bench.rows import row


def raising(job: Job, **_: Any) -> Row:
    """Raise."""
    raise RuntimeError("out of luck")


def steady(job: Job, **_: Any) -> Row:
    """Succeed after a moment."""
    time.sleep(0.05)
    return row(job, None)
