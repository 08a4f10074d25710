"""A contact sheet is whole or absent, and refused before anything is drawn."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from robots.errors import BadInput, MissingDependency
from tamp.view.sheet import CAPTION, COLUMNS, SIZE, require_sheet, write_sheet
from worlds.assets.library import load, names


def test_rows_wrap_and_the_file_is_a_png_of_their_size(tmp_path: Path) -> None:
    from PIL import Image

    assets = [load("synthetic", "USB", name) for name in names("synthetic", "USB")[: COLUMNS + 1]]
    path = write_sheet(tmp_path / "new" / "sheet.png", [assets, assets[:1]])
    with Image.open(path) as image:
        assert image.format == "PNG"
        assert image.size == (COLUMNS * SIZE, 3 * (SIZE + CAPTION))
        pixels = np.asarray(image)
    assert len(np.unique(pixels[:SIZE, :SIZE].reshape(-1, 3), axis=0)) > 50
    assert (pixels[SIZE + CAPTION : 2 * (SIZE + CAPTION), SIZE:] == 255).all()
    assert [entry.name for entry in path.parent.iterdir()] == ["sheet.png"]


def test_the_same_assets_give_the_same_bytes(tmp_path: Path) -> None:
    rows = [[load("synthetic", "Plate", "plate-000")]]
    assert write_sheet(tmp_path / "a.png", rows).read_bytes() == write_sheet(tmp_path / "b.png", rows).read_bytes()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("sheet.jpg", r"sheet\.jpg is not a PNG file; give a name that ends in \.png\."),
        ("folder.png", r"folder\.png is a folder; give the name of a PNG file\."),
        ("file/sheet.png", r"file/sheet\.png cannot be written: .*file is a file, not a folder\."),
    ],
)
def test_a_path_that_cannot_be_a_sheet_is_refused(name: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match=words):
        require_sheet(tmp_path / name)


def test_a_place_where_nothing_can_be_written_is_one_message() -> None:
    with pytest.raises(BadInput, match=r"--sheet /proc/sheet\.png cannot be written: "):
        write_sheet(Path("/proc/sheet.png"), [[load("synthetic", "USB", "usb-000")]])


def test_without_pillow_the_message_names_the_pip_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(MissingDependency, match=r'Drawing a contact sheet needs .*pip install "bipremanip\[video\]"'):
        require_sheet(tmp_path / "sheet.png")
