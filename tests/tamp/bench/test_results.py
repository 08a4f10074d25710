"""What a benchmark reports: counts that add up, pairs that are pairs, a page that stands alone."""

from __future__ import annotations

import csv
import random
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import msgspec
import pytest

from tamp.bench.jobs import jobs_of
from tamp.bench.paper import paper_table
from tamp.bench.report import PAGE_FILE, RESULTS_FILE, TABLE_FILE, write
from tamp.bench.results import Results, summarise
from tamp.bench.row import Row
from tamp.bench.run import fault_of
from tamp.bench.statistics import mcnemar, wilson
from tests.tamp.bench.rows import row, settings

WANTED = settings(
    methods=["heuristic", "uniform"], mode=["E1", "E2"], categories=["Bottle", "Plate", "Handover-Bottle"], episodes=12
)


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    draw = random.Random(4)
    reasons = [None, None, "unreachable", "not_held", "proposal"]
    found = [row(job, draw.choice(reasons), draw.uniform(0.5, 2.0)) for job in jobs_of(WANTED)]
    found[5] = fault_of(found[5].job, "crashed", "the worker process was killed by <SIGSEGV>")
    return found


@pytest.fixture(scope="module")
def results(rows: list[Row]) -> Results:
    return summarise(WANTED, rows, ["Window"], "out")


def test_every_episode_is_counted_once(rows: list[Row], results: Results) -> None:
    assert results.complete
    assert sum(rate.episodes for rate in results.rows) == len(rows) == results.episodes == results.wanted
    assert sum(rate.successes for rate in results.rows) == sum(r.success for r in rows)
    for rate in [*results.rows, *results.means]:
        assert rate.successes + sum(rate.failures.values()) == rate.episodes
        assert sum(rate.failure_classes.values()) == sum(rate.failures.values())
        assert (rate.ci_low, rate.ci_high) == wilson(rate.successes, rate.episodes)
    assert [fault.reason for fault in results.faults] == ["crashed"]


def test_means_give_each_category_the_same_weight(results: Results) -> None:
    for mean in results.means:
        mine = [
            rate.rate
            for rate in results.rows
            if (rate.method, rate.mode, rate.split, rate.task_type)
            == (mean.method, mean.mode, mean.split, mean.task_type)
        ]
        assert mean.rate == pytest.approx(sum(mine) / len(mine))
        assert mean.categories == len(mine)


def test_comparisons_are_between_the_same_episodes(rows: list[Row], results: Results) -> None:
    by = {(r.method, r.mode, r.category, r.split, r.seed): r.success for r in rows}
    (found,) = [c for c in results.comparisons if (c.kind, c.within, c.task_type) == ("method", "E1", "articulated")]
    pairs = [
        (by["heuristic", "E1", *rest], by["uniform", "E1", *rest])
        for method, mode, *rest in by
        if (method, mode, rest[0]) == ("heuristic", "E1", "Bottle")
    ]
    assert (found.first, found.second) == ("heuristic", "uniform")
    assert found.pairs == len(pairs) == 24
    assert found.only_first == sum(a and not b for a, b in pairs)
    assert found.only_second == sum(b and not a for a, b in pairs)
    assert found.both + found.neither + found.only_first + found.only_second == found.pairs
    assert found.p == mcnemar(found.only_first, found.only_second)
    kinds = {(c.kind, c.first, c.second, c.within) for c in results.comparisons if c.task_type == "all"}
    assert kinds == {
        ("method", "heuristic", "uniform", "E1"),
        ("method", "heuristic", "uniform", "E2"),
        ("mode", "E1", "E2", "heuristic"),
        ("mode", "E1", "E2", "uniform"),
    }


def test_an_interrupted_run_compares_what_both_have(rows: list[Row]) -> None:
    half = summarise(WANTED, [r for r in rows if r.method == "heuristic" or r.category == "Plate"], [], "out")
    assert not half.complete
    (found,) = [c for c in half.comparisons if (c.kind, c.within, c.task_type) == ("method", "E2", "all")]
    assert found.pairs == 24
    assert summarise(WANTED, [], [], "out").rows == []


def test_the_files_hold_the_same_numbers(results: Results, tmp_path: Path) -> None:
    write(results, tmp_path)
    assert msgspec.json.decode((tmp_path / RESULTS_FILE).read_bytes(), type=Results) == results
    table = list(csv.DictReader((tmp_path / TABLE_FILE).read_text().splitlines()))
    assert [int(line["successes"]) for line in table] == [rate.successes for rate in results.rows]
    for line, rate in zip(table, results.rows, strict=True):
        tallies = dict(part.split(":") for part in line["failures"].split(";") if part)
        assert {name: int(count) for name, count in tallies.items()} == rate.failures
    assert sorted(entry.name for entry in tmp_path.iterdir()) == sorted([RESULTS_FILE, TABLE_FILE, PAGE_FILE])


def test_the_page_is_well_formed_and_needs_no_other_file(results: Results, tmp_path: Path) -> None:
    write(results, tmp_path)
    text = (tmp_path / PAGE_FILE).read_text("utf-8")
    assert text.startswith("<!DOCTYPE html>")
    page = ET.fromstring(text.removeprefix("<!DOCTYPE html>"))
    assert not {"script", "img", "link", "iframe", "object"} & {node.tag for node in page.iter()}
    assert not re.search(r"https?:|url\(|@import|src=|href=", text)
    assert "prefers-color-scheme: dark" in text
    words = " ".join(page.itertext())
    for rate in results.rows:
        assert rate.category in words
    assert "the worker process was killed by <SIGSEGV>" in words
    assert "Not in this object source: Window." in words


def test_the_page_has_the_papers_numbers_beside_ours(results: Results, tmp_path: Path) -> None:
    write(results, tmp_path)
    page = ET.fromstring((tmp_path / PAGE_FILE).read_text("utf-8").removeprefix("<!DOCTYPE html>"))
    lines = [[" ".join(cell.itertext()) for cell in line] for line in page.iter("tr")]
    (bottle,) = [line for line in lines if line[0] == "Bottle" and len(line) > 8]
    ours = {
        (rate.method, rate.mode, rate.split): f"{100 * rate.rate:.0f}"
        for rate in results.rows
        if rate.category == "Bottle"
    }
    assert bottle[1] == f"{ours['heuristic', 'E1', 'seen']} / {ours['heuristic', 'E1', 'unseen']}"
    assert bottle[-6:] == ["1 / 2", "2 / 0", "0 / 0", "4 / 2", "19 / 14", "30 / 26"]
    (handover,) = [line for line in lines if line[0] == "Handover-Bottle"]
    assert handover[-1] == "– / –"
    assert len(paper_table().methods) == 6


def test_a_page_of_an_empty_run_is_well_formed_too() -> None:
    from tamp.bench.page import page

    ET.fromstring(page(summarise(WANTED, [], [], "out")).removeprefix("<!DOCTYPE html>"))
