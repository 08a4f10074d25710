"""Which episodes a benchmark has, and that nobody chose the seeds."""

from __future__ import annotations

from pathlib import Path

import pytest

from robots.errors import BadInput, UnknownName
from tamp.bench.classes import CLASSES, failure_class
from tamp.bench.jobs import SPLITS, chosen, chosen_categories, jobs_of, required
from tamp.bench.paper import paper_table
from tamp.bench.seeds import PER_LIST, RESERVED, SEED_END, benchmark_seeds, every_benchmark_seed, seed_at
from tests.tamp.bench.rows import settings
from worlds.assets import library
from worlds.tasks import COLUMNS, HANDOVER, TASKS

OBJECTS = Path(__file__).parents[4] / "shared/assets/objects"


def test_the_committed_seeds_are_those_of_the_rule() -> None:
    for category in TASKS:
        for split in SPLITS:
            rule = [seed_at(f"bipremanip benchmark 1/{category}/{split}", k) for k in range(PER_LIST)]
            assert benchmark_seeds(category, split) == rule


def test_no_two_lists_share_a_seed_and_none_is_a_development_seed() -> None:
    every = every_benchmark_seed()
    assert len(every) == len(TASKS) * len(SPLITS) * PER_LIST
    assert RESERVED <= min(every) <= max(every) < SEED_END


def test_every_combination_is_one_job_and_an_early_end_has_some_of_each() -> None:
    wanted = settings(methods=["heuristic", "uniform"], mode=["E1", "E2"], categories=["Bottle", "USB"], episodes=3)
    jobs = jobs_of(wanted)
    assert len({job.key for job in jobs}) == len(jobs) == 2 * 2 * 2 * 2 * 3
    assert len({(job.method, job.mode, job.category, job.split) for job in jobs[:16]}) == 16
    for job in jobs:
        assert job.seed in benchmark_seeds(job.category, job.split)[:3]


def test_every_instance_is_named_once_an_episode() -> None:
    jobs = jobs_of(settings(categories=["Lighter"], episodes=2, every_instance=True))
    assert len({job.key for job in jobs}) == len(jobs)
    for split in SPLITS:
        named = [job.named for job in jobs if job.split == split]
        assert named == 2 * library.names("synthetic", "Lighter", split)
    assert {job.seed for job in jobs} == {s for split in SPLITS for s in benchmark_seeds("Lighter", split)[:2]}


def test_methods_and_modes_get_the_same_seeds() -> None:
    jobs = jobs_of(settings(methods=["heuristic", "uniform"], mode=["E1", "E2"], episodes=5))
    seeds = {
        (m, e): [j.seed for j in jobs if (j.method, j.mode) == (m, e)]
        for m in ("heuristic", "uniform")
        for e in ("E1", "E2")
    }
    assert len({tuple(found) for found in seeds.values()}) == 1


def test_groups_of_columns() -> None:
    assert chosen_categories("all") == list(COLUMNS)
    assert chosen_categories("handover") == list(HANDOVER)
    assert chosen_categories("USB, all,handover") == ["USB", *(c for c in COLUMNS if c != "USB"), *HANDOVER]


def test_wrong_names_are_told_with_the_nearest() -> None:
    with pytest.raises(UnknownName, match=r'No category "Botle". Did you mean "Bottle"\?'):
        chosen_categories("Bottle,Botle")
    with pytest.raises(UnknownName, match=r'No method "heuristc". Did you mean "heuristic"\?'):
        chosen("method", "heuristc", ["heuristic"])
    with pytest.raises(BadInput, match=r'"," names no method. Valid: all, heuristic.'):
        chosen("method", ",", ["heuristic"])


def test_a_group_leaves_out_what_a_source_lacks_but_a_name_does_not(tmp_path: Path) -> None:
    (tmp_path / "Bottle").mkdir()
    source = f"partnet:{tmp_path}"
    with pytest.raises(BadInput, match="has no seen objects for"):
        required(source, ["Bottle"], ["seen"], "Bottle")
    found, absent = required("synthetic", chosen_categories("all"), ["seen"], "all")
    assert "Bottle" in found
    assert sorted([*found, *absent]) == sorted(COLUMNS)


def test_a_class_of_the_paper_for_every_failure() -> None:
    assert failure_class("Bowl", "grasp", "collision", "left/panda_hand hits table 6 mm deep") == "near-table geometry"
    assert failure_class("Bowl", "push", "slipped", "it turned away") == "one-shot push instability"
    assert failure_class("Remote", "retreat", "fell", "the object fell off the table") == "one-shot push instability"
    assert failure_class("USB", "pregrasp", "not_held", "fingers closed beside it") == "small parts"
    assert failure_class("Bottle", "operate", "not_moved", "joint moved 3 of 16 mm") == "interaction-pose sensitivity"
    assert failure_class("Lighter", "operate", "proposal", "out of view") == "occlusion"
    for reason in ("budget", "crashed", "error", "timed_out", "timing"):
        assert failure_class("USB", None, reason, "") == "other"
    assert len(CLASSES) == 6


def test_the_papers_table_has_its_columns_and_known_means() -> None:
    """Averages as they were computed by hand from the paper's table, one decimal."""
    table = paper_table()
    assert list(table.methods) == ["W2A", "ACT", "3DA", "3DFA", "Heuristic", "Ours"]
    assert all(set(columns) == set(COLUMNS) for columns in table.methods.values())
    edge, articulated = COLUMNS[:9], COLUMNS[9:17]
    for method, columns, seen, unseen in (
        ("Ours", edge, 58.3, 59.0),
        ("Ours", articulated, 35.9, 39.6),
        ("Heuristic", edge, 31.1, 34.0),
        ("3DFA", articulated, 17.4, 13.8),
        ("ACT", ("Plate",), 30.0, 26.0),
    ):
        for split, mean in (("seen", seen), ("unseen", unseen)):
            rates = [table.methods[method][column][split] for column in columns]  # type: ignore[index]
            assert sum(rates) / len(rates) == pytest.approx(mean, abs=0.06)
    assert table.rate("Ours", "Handover-Bottle", "seen") is None


@pytest.mark.skipif(not OBJECTS.is_dir(), reason=f"{OBJECTS} is not here")
def test_one_usable_instance_in_any_split_is_enough_to_try_every_one() -> None:
    """The scans have one cap and no split; their bottles have no joints."""
    wanted = ["Cap", "Bottle"]
    assert required(f"mesh:{OBJECTS}", wanted, SPLITS, "all", every=True) == (["Cap"], ["Bottle"])
    with pytest.raises(BadInput, match="has no seen and unseen objects for Bottle"):
        required(f"mesh:{OBJECTS}", wanted, SPLITS, "Cap,Bottle", every=True)
