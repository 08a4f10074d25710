"""How did a training go, at a glance? One small plot for each number of its log."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from robots.cache import write_atomic
from robots.errors import MissingDependency

WIDE, HIGH, COLUMNS, BORDER = 260, 130, 4, 26
"""Size of a plot [pixel], plots in a row, and room for its words [pixel]."""

LEFT_OUT = ("step", "seconds")


def write_curves(log: Path, png: Path) -> Path:
    """Draw a log as a PNG.

    Raises:
        MissingDependency: Pillow is not installed.
    """
    try:
        from PIL import Image, ImageDraw
    except ImportError as error:
        raise MissingDependency("pillow", "learn", "The picture of a training's curves") from error
    series = series_in(log)
    rows = -(-len(series) // COLUMNS)
    image = Image.new("RGB", (COLUMNS * WIDE, max(1, rows) * HIGH), "white")
    draw = ImageDraw.Draw(image)
    for k, (name, values) in enumerate(series.items()):
        left, top = (k % COLUMNS) * WIDE, (k // COLUMNS) * HIGH
        _plot(draw, left, top, name, values)
    memory = io.BytesIO()
    image.save(memory, format="PNG")
    return write_atomic(png, memory.getvalue())


def series_in(log: Path) -> dict[str, np.ndarray]:
    """Steps and values ``(2, n)`` of each number in a log; those of validation are named so."""
    found: dict[str, list[tuple[float, float]]] = {}
    for line in log.read_text("utf-8").splitlines():
        row: dict[str, Any] = json.loads(line)
        validation: dict[str, float] = row.pop("validation", {})
        numbers = {name: value for name, value in row.items() if name not in LEFT_OUT}
        for name, value in (numbers | {f"validation {name}": value for name, value in validation.items()}).items():
            found.setdefault(name, []).append((row["step"], value))
    return {name: np.array(values, dtype=float).T for name, values in found.items()}


def _plot(draw: Any, left: int, top: int, name: str, values: np.ndarray) -> None:
    steps, numbers = values
    low, high = float(numbers.min()), float(numbers.max())
    span = (high - low) or 1.0
    x = left + BORDER / 2 + (WIDE - BORDER) * (steps - steps.min()) / ((np.ptp(steps)) or 1.0)
    y = top + HIGH - 8 - (HIGH - BORDER - 8) * (numbers - low) / span
    draw.rectangle((left + 4, top + 4, left + WIDE - 4, top + HIGH - 4), outline="#d0d0d0")
    draw.text((left + 10, top + 8), f"{name}   last {numbers[-1]:.3g}   {low:.3g} to {high:.3g}", fill="#303030")
    if len(numbers) > 1:
        draw.line(list(zip(x.tolist(), y.tolist(), strict=True)), fill="#2060a0", width=2)
