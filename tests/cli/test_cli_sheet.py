"""The contact sheet as scripts meet it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.test_cli import answer, bipre, refused


def test_a_sheet_of_one_category_is_drawn_and_named(tmp_path: Path) -> None:
    file = tmp_path / "plates.png"
    done = bipre("assets", "Plate", "--sheet", str(file), "--json")
    assert done.returncode == 0, done.stderr
    assert answer(done)["sheet"] == str(file)
    assert f"drawn on {file}" in done.stderr
    assert file.read_bytes().startswith(b"\x89PNG")
    assert [entry.name for entry in tmp_path.iterdir()] == ["plates.png"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sheet.gif", "sheet.gif is not a PNG file; give a name that ends in .png."),
        ("taken.png", "taken.png is a folder; give the name of a PNG file."),
    ],
)
def test_a_bad_sheet_is_one_message_and_leaves_nothing(name: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "taken.png").mkdir()
    assert message in refused("assets", "Plate", "--sheet", str(tmp_path / name))
    assert [entry.name for entry in tmp_path.iterdir()] == ["taken.png"]
