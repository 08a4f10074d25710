"""An execution as a film from two viewpoints with the running stage below, and as a sheet of still frames."""

from __future__ import annotations

import importlib
import io
import os
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from robots.cache import write_atomic
from robots.errors import MissingDependency
from robots.workcell import Camera
from worlds.bullet.render import render
from worlds.bullet.world import BulletWorld

VIDEO_FILE, SHEET_FILE = "execution.mp4", "execution.png"

FRAME_RATE = 8
"""Frames a second of simulated time."""

WIDTH, HEIGHT, CAPTION = 480, 400, 28
"""Size of one view and height of the caption below [pixel]; all even, as the codec wants."""

SHEET_COLUMNS, SHEET_ROWS = 3, 4
"""Frames on the sheet of stills."""

Frame = np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]


def require_video() -> None:
    """``MissingDependency`` when a film cannot be written here."""
    for package in ("imageio", "imageio_ffmpeg", "PIL"):
        try:
            importlib.import_module(package)
        except ImportError as error:
            raise MissingDependency(package, "video", "Recording a video") from error


def viewpoints(world: BulletWorld) -> tuple[Camera, Camera]:
    """Where the film is taken from: in front of the table, and beside it from above."""
    x, y, z = world.workcell.shared
    common = {"width": WIDTH, "height": HEIGHT, "target": (x, y, z - 0.12)}
    return (
        Camera(name="front", eye=(x + 0.15, y - 1.25, z + 0.45), fov_deg=40.0, **common),  # type: ignore[arg-type]
        Camera(name="side", eye=(x - 0.80, y + 0.75, z + 0.65), fov_deg=44.0, **common),  # type: ignore[arg-type]
    )


class Recorder:
    """Records while the world runs. Leaves a complete film and sheet, or after an error neither.

    Args:
        world: The world to film.
        path: The film; the sheet of stills goes beside it.
    """

    def __init__(self, world: BulletWorld, path: Path) -> None:
        require_video()
        self._world, self._path, self._cameras = world, path, viewpoints(world)
        self._partial = path.with_name(f".{path.stem}-{os.getpid()}{path.suffix}")
        self._frames: list[Frame] = []
        self._next = 0.0
        self._writer: Any = None

    def __enter__(self) -> Recorder:
        import imageio

        self._writer = imageio.get_writer(
            self._partial, format="FFMPEG", mode="I", fps=FRAME_RATE, codec="libx264", quality=7,
            pixelformat="yuv420p", macro_block_size=2, ffmpeg_log_level="error",
        )  # fmt: skip
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.close()
        if kind is not None or not self._frames:
            self._partial.unlink(missing_ok=True)
            return
        self._partial.replace(self._path)
        write_atomic(self._path.with_name(SHEET_FILE), _sheet(self._frames))

    def due(self, time: float) -> bool:
        """Whether the next frame is due at a simulated time [s]."""
        return time >= self._next

    def frame(self, caption: str) -> None:
        """Take a frame from both viewpoints."""
        self._next = max(self._next + 1.0 / FRAME_RATE, self._world.time)
        views = np.concatenate([render(self._world, camera).rgb for camera in self._cameras], axis=1)
        frame = _captioned(views, f"{self._world.time:5.1f} s   {caption}")
        self._frames.append(frame)
        self._writer.append_data(frame)


def _captioned(views: Frame, caption: str) -> Frame:
    from PIL import Image, ImageDraw, ImageFont

    image = Image.new("RGB", (views.shape[1], views.shape[0] + CAPTION), (24, 26, 30))
    image.paste(Image.fromarray(views), (0, 0))
    ImageDraw.Draw(image).text((12, views.shape[0] + 5), caption, (240, 240, 240), ImageFont.load_default(16))
    return np.asarray(image, dtype=np.uint8)


def _sheet(frames: list[Frame]) -> bytes:
    """Evenly spaced frames, the first and the last among them, as PNG."""
    from PIL import Image

    chosen = np.linspace(0, len(frames) - 1, SHEET_COLUMNS * SHEET_ROWS).round().astype(int)
    height, width = (side * 2 // 3 for side in frames[0].shape[:2])
    sheet = Image.new("RGB", (SHEET_COLUMNS * width, SHEET_ROWS * height))
    for place, number in enumerate(chosen):
        row, column = divmod(place, SHEET_COLUMNS)
        sheet.paste(Image.fromarray(frames[number]).resize((width, height)), (column * width, row * height))
    buffer = io.BytesIO()
    sheet.save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()
