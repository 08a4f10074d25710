"""Where a run is kept: the run folder and what may stand in it."""

from __future__ import annotations

import shutil
from pathlib import Path

from affordance.maps import MAPS_FILE
from robots.errors import BadRunFolder
from tamp import plan as plan_file
from tamp import trace as trace_file
from worlds import observe

OUTCOME_FILE = "outcome.json"

OWN_FILES = (
    plan_file.PLAN_FILE,
    trace_file.TRACE_FILE,
    observe.OBSERVATION_FILE,
    MAPS_FILE,
    OUTCOME_FILE,
    MAPS_FILE,
    "plan.html",
    "execution.mp4",
    "execution.png",
)

EARLIER = "round-"
"""Prefix of the folders of a closed loop's earlier rounds."""


def prepared(out: Path | None, name: str) -> Path:
    """The run folder, empty of an earlier run's files.

    Args:
        out: As asked for, or ``None`` for one under ``runs/``.
        name: Its name there.

    Raises:
        BadRunFolder: The path is a file, or a folder that holds something else.
    """
    folder = out or Path("runs") / name
    if folder.exists() and not folder.is_dir():
        raise BadRunFolder(f"--out {folder} is a file; give a folder.")
    foreign = sorted(entry.name for entry in folder.iterdir() if not _own(entry)) if folder.is_dir() else []
    if foreign:
        raise BadRunFolder(f"--out {folder} holds files of something else ({foreign[0]}); give a new or empty folder.")
    try:
        if folder.is_dir():
            shutil.rmtree(folder)
        folder.mkdir(parents=True)
    except OSError as error:
        raise BadRunFolder(f"Run folder {folder} cannot be made: {error.strerror}.") from error
    return folder


def _own(entry: Path) -> bool:
    unfinished = any(entry.name.startswith(f".{Path(name).stem}") for name in OWN_FILES)
    return entry.name in OWN_FILES or unfinished or (entry.is_dir() and entry.name.startswith(EARLIER))


def earlier_rounds(folder: Path) -> list[Path]:
    """The folders of a closed loop's earlier rounds, in order; none after a single round."""
    places = [entry for entry in folder.glob(f"{EARLIER}*") if entry.name.removeprefix(EARLIER).isdigit()]
    return sorted(places, key=lambda place: int(place.name.removeprefix(EARLIER)))
