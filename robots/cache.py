"""Where derived files live, and how a file is written so that nobody ever sees half of it."""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path


def cache_dir() -> Path:
    """The folder for derived files: ``$BIPRE_CACHE``, else ``$XDG_CACHE_HOME/bipremanip``."""
    if named := os.environ.get("BIPRE_CACHE"):
        return Path(named)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "bipremanip"


def content_hash(*parts: bytes | str) -> str:
    """A short hexadecimal digest of the parts, in order."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    return digest.hexdigest()[:24]


def write_atomic(path: Path, data: bytes | str) -> Path:
    """Write ``data`` to ``path`` so that the file is either absent, old or complete."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data.encode() if isinstance(data, str) else data)
        Path(name).chmod(0o644)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return path
