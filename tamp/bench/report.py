"""How are a benchmark's results written: for programs, for tables and for people?"""

from __future__ import annotations

import csv
import io
from pathlib import Path

import msgspec

from robots.cache import write_atomic
from tamp.bench.page import page
from tamp.bench.results import Rate, Results

RESULTS_FILE, TABLE_FILE, PAGE_FILE = "results.json", "results.csv", "report.html"


def write(results: Results, folder: Path) -> None:
    """Write ``results.json``, ``results.csv`` and ``report.html``, each at once or not at all."""
    write_atomic(folder / RESULTS_FILE, msgspec.json.format(msgspec.json.encode(results), indent=1) + b"\n")
    write_atomic(folder / TABLE_FILE, table(results.rows))
    write_atomic(folder / PAGE_FILE, page(results))


def table(rates: list[Rate]) -> str:
    """The rates as CSV; tallies are written ``name:count`` with semicolons between."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(Rate.__struct_fields__)
    for rate in rates:
        writer.writerow([_cell(value) for value in msgspec.structs.astuple(rate)])
    return text.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, dict):
        return ";".join(f"{name}:{count}" for name, count in value.items())
    return round(value, 6) if isinstance(value, float) else value
