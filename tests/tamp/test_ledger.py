"""A long run's folder: settings that must stay, lines that are whole, one writer at a time."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec import Struct, field

from robots.errors import BadRunFolder
from tamp import ledger


class Settings(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    episodes: int = 3
    methods: tuple[str, ...] = ("heuristic",)
    versions: dict[str, str] = field(default_factory=lambda: {"ompl": "2.0.1"})
    program: str = "abc"


class Line(Struct, frozen=True, forbid_unknown_fields=True):
    number: int
    words: str = "x" * 50


def refusal(folder: Path, settings: Settings) -> str:
    """What is said to a claim that must be refused."""
    with pytest.raises(BadRunFolder) as error, ledger.claimed(folder, settings):
        pass
    return str(error.value)


def test_a_folder_can_be_claimed_again_with_the_same_settings_only(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    for _ in range(2):
        with ledger.claimed(folder, Settings()):
            pass
    assert ledger.read_settings(folder, Settings) == Settings()
    for other, words in (
        (Settings(episodes=4), "was begun with --episodes 3, not 4; a run keeps its settings: give the same ones"),
        (Settings(methods=("heuristic", "uniform")), "--methods heuristic, not heuristic,uniform"),
        (Settings(versions={"ompl": "2.1"}), "ompl 2.0.1, now it is 2.1"),
        (Settings(program="def"), "another version of this program's code"),
    ):
        assert words in refusal(folder, other)
    assert ledger.read_settings(folder, Settings) == Settings()


def test_two_processes_do_not_share_a_folder(tmp_path: Path) -> None:
    with ledger.claimed(tmp_path, Settings()):
        assert "Another process is writing to" in refusal(tmp_path, Settings())
    with ledger.claimed(tmp_path, Settings()):
        pass


def test_a_file_or_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    assert "holds files of something else (thesis.tex)" in refusal(tmp_path, Settings())
    assert "is a file; give a folder" in refusal(tmp_path / "thesis.tex", Settings())
    assert [entry.name for entry in tmp_path.iterdir()] == ["thesis.tex"]


def test_lines_cut_off_anywhere_leave_the_whole_ones_before(tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    assert ledger.rows(path, Line) == []
    lines = [Line(number) for number in range(3)]
    for line in lines:
        ledger.append(path, line)
    data = path.read_bytes()
    third = len(data) // 3
    for end in range(len(data) + 1):
        path.write_bytes(data[:end])
        assert ledger.rows(path, Line) == lines[: end // third]
        assert path.read_bytes() == data[: end // third * third]
    ledger.append(path, Line(7))
    assert ledger.rows(path, Line)[-1].number == 7


def test_a_line_that_is_no_row_is_named(tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    path.write_text('{"number": 1}\n{"numbre": 2}\n')
    with pytest.raises(BadRunFolder, match=r"lines.jsonl, line 2: .*numbre.*Remove that line"):
        ledger.rows(path, Line)


def test_settings_that_are_no_settings_are_one_message(tmp_path: Path) -> None:
    (tmp_path / ledger.SETTINGS_FILE).write_text("{")
    assert "settings.json cannot be read: " in refusal(tmp_path, Settings())
    with pytest.raises(BadRunFolder, match=r"settings\.json cannot be read"):
        ledger.read_settings(tmp_path, Settings)
    with pytest.raises(BadRunFolder, match="does not exist"):
        ledger.read_settings(tmp_path / "absent", Settings)


def test_the_digest_of_the_program_follows_its_sources() -> None:
    assert ledger.program_digest() == ledger.program_digest()
    assert len(ledger.program_digest()) == 24
