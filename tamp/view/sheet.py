"""Object instances side by side on one picture, each with its name."""

from __future__ import annotations

import importlib
import io
from collections.abc import Sequence
from pathlib import Path

from robots.cache import write_atomic
from robots.errors import BadInput, MissingDependency
from worlds.assets.asset import Asset
from worlds.bullet.portrait import portrait

MOST = 24
"""Instances on a sheet of one category, the first ones: kinds and splits alternate by number."""

COLUMNS = 8
"""Pictures in a row, which is also how many instances of a category a sheet of all categories shows."""

SIZE, CAPTION = 200, 34
"""Side of one picture and height of the two lines below it [pixel]."""

FINER = 2
"""How much finer a picture is drawn than shown, which smooths its edges."""

INK, FAINT, PAPER = (30, 32, 36), (120, 124, 130), (255, 255, 255)


def require_sheet(path: Path) -> None:
    """Raise before anything is drawn when no sheet can be written to ``path``.

    Raises:
        MissingDependency: Pillow is not installed.
        BadInput: It is no name of a PNG file, or a folder, or lies below a file.
    """
    try:
        importlib.import_module("PIL")
    except ImportError as error:
        raise MissingDependency("PIL", "video", "Drawing a contact sheet") from error
    if path.suffix.lower() != ".png":
        raise BadInput(f"--sheet {path} is not a PNG file; give a name that ends in .png.")
    if path.is_dir():
        raise BadInput(f"--sheet {path} is a folder; give the name of a PNG file.")
    for folder in path.absolute().parents:
        if folder.exists():
            if not folder.is_dir():
                raise BadInput(f"--sheet {path} cannot be written: {folder} is a file, not a folder.")
            return


def write_sheet(path: Path, rows: Sequence[Sequence[Asset]]) -> Path:
    """Draw ``rows`` of assets, each wrapped after ``COLUMNS``, into the PNG file ``path``.

    Raises:
        MissingDependency: Pillow is not installed.
        BadInput: The file cannot be written.
    """
    require_sheet(path)
    lines = [row[k : k + COLUMNS] for row in rows for k in range(0, len(row), COLUMNS)]
    try:
        return write_atomic(path, _drawn(lines))
    except OSError as error:
        raise BadInput(f"--sheet {path} cannot be written: {error.strerror}.") from error


def _drawn(lines: Sequence[Sequence[Asset]]) -> bytes:
    from PIL import Image, ImageDraw, ImageFont

    width = max((len(line) for line in lines), default=1)
    image = Image.new("RGB", (width * SIZE, max(1, len(lines)) * (SIZE + CAPTION)), PAPER)
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(13)
    for number, line in enumerate(lines):
        for column, asset in enumerate(line):
            x, y = column * SIZE, number * (SIZE + CAPTION)
            image.paste(Image.fromarray(portrait(asset, FINER * SIZE)).resize((SIZE, SIZE)), (x, y))
            pen.text((x + SIZE // 2, y + SIZE + 8), asset.instance, INK, font, anchor="mm")
            pen.text((x + SIZE // 2, y + SIZE + 23), f"{asset.topology}, {asset.split}", FAINT, font, anchor="mm")
    buffer = io.BytesIO()
    image.save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()
