"""What does the folder of a long run remember, so that it can be killed at any moment and go on later?

``settings.json`` says what the run is, and a later call must say the same; ``*.jsonl`` files grow by whole lines; a
lock keeps a second process out.
"""

from __future__ import annotations

import fcntl
import importlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec import Struct

from robots.cache import content_hash, write_atomic
from robots.errors import BadRunFolder

SETTINGS_FILE = "settings.json"
LOCK_FILE = "lock"
LOG_FILE = "workers.log"

PACKAGES = ("robots", "worlds", "planners", "affordance", "tamp")
CODE_SUFFIXES = (".py", ".toml", ".json", ".safetensors")

Row = TypeVar("Row", bound=Struct)


def program_digest() -> str:
    """A digest of every source and data file of this program, so that results of two versions are not mixed."""
    parts: list[bytes | str] = []
    for package in PACKAGES:
        root = Path(str(importlib.import_module(package).__file__)).parent
        for path in sorted(root.rglob("*")):
            if path.suffix in CODE_SUFFIXES:
                parts += [f"{package}/{path.relative_to(root).as_posix()}", path.read_bytes()]
    return content_hash(*parts)


@contextmanager
def claimed(folder: Path, settings: Struct) -> Iterator[None]:
    """The folder is this process's alone, and holds a run with just these settings.

    Raises:
        BadRunFolder: The path is a file, the folder holds something else, a run with other settings, or a run that
            another process is busy with. Nothing has been changed then.
    """
    _check_folder(folder)
    began = _began(folder)
    if began is not None:
        _check_same(folder, began, msgspec.json.decode(msgspec.json.encode(settings)))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = os.open(folder / LOCK_FILE, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise BadRunFolder(f"--out {folder} cannot be written: {error.strerror}.") from error
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise BadRunFolder(f"Another process is writing to {folder}; wait for it or give another --out.") from error
        if began is None:
            encoded = msgspec.json.format(msgspec.json.encode(settings), indent=1)
            write_atomic(folder / SETTINGS_FILE, encoded + b"\n")
        yield
    finally:
        os.close(lock)


def _check_folder(folder: Path) -> None:
    if folder.exists() and not folder.is_dir():
        raise BadRunFolder(f"--out {folder} is a file; give a folder.")
    if not folder.is_dir() or (folder / SETTINGS_FILE).is_file():
        return
    foreign = sorted(entry.name for entry in folder.iterdir() if entry.name != LOCK_FILE)
    if foreign:
        raise BadRunFolder(f"--out {folder} holds files of something else ({foreign[0]}); give a new or empty folder.")


def _began(folder: Path) -> dict[str, Any] | None:
    """The settings with which the run in a folder began."""
    path = folder / SETTINGS_FILE
    if not path.is_file():
        return None
    try:
        began = msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise BadRunFolder(f"{path} cannot be read: {error}. Give another --out.") from error
    return began


def read_settings(folder: Path, kind: type[Row]) -> Row:
    """The settings of the run in a folder.

    Raises:
        BadRunFolder: There is none, or it is a run of another kind.
    """
    path = folder / SETTINGS_FILE
    if not path.is_file():
        raise BadRunFolder(f"{folder} {'has no ' + SETTINGS_FILE if folder.is_dir() else 'does not exist'}.")
    try:
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise BadRunFolder(f"{path} cannot be read: {error}.") from error


def _check_same(folder: Path, began: dict[str, Any], now: dict[str, Any]) -> None:
    for name in [*now, *(name for name in began if name not in now)]:
        was, wanted = began.get(name), now.get(name)
        if was != wanted:
            raise BadRunFolder(
                f"{folder} was begun with {_said(name, was, wanted)}; "
                "a run keeps its settings: give the same ones, or another --out."
            )


def _said(name: str, was: Any, wanted: Any) -> str:
    """A difference in words."""
    if name == "program":
        return "another version of this program's code"
    if isinstance(was, dict) and isinstance(wanted, dict):
        key = next(key for key in sorted({*was, *wanted}) if was.get(key) != wanted.get(key))
        return f"{key} {was.get(key, 'absent')}, now it is {wanted.get(key, 'absent')}"
    return f"--{name.replace('_', '-')} {_word(was)}, not {_word(wanted)}"


def _word(value: Any) -> str:
    return ",".join(str(item) for item in value) if isinstance(value, list) else str(value)


def append(path: Path, row: Struct) -> None:
    """Add a row as one line: on disk whole when this returns."""
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    try:
        os.write(handle, msgspec.json.encode(row) + b"\n")
        os.fsync(handle)
    finally:
        os.close(handle)


def rows(path: Path, kind: type[Row]) -> list[Row]:
    """Every row of a file, none when it is absent; a last line without its end was cut off by a kill and is removed.

    Raises:
        BadRunFolder: A line is not such a row.
    """
    if not path.is_file():
        return []
    data = path.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    if len(whole) < len(data):
        os.truncate(path, len(whole))
    found = []
    for number, line in enumerate(whole.splitlines(), start=1):
        try:
            found.append(msgspec.json.decode(line, type=kind))
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise BadRunFolder(f"{path}, line {number}: {error}. Remove that line to run its episode again.") from error
    return found
