"""Where are episodes that were played but are in no shard yet? Each in a file of its own, so that a kill loses none.

The files are shards of one episode in a folder beside the shards, which nothing but the collection looks into.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from tamp.data.shards import DamagedShard, Entry, read_shard, shard_number, shard_paths, write_shard

FOLDER = "pending"


class Pending:
    """The episodes of a collection that are in no shard."""

    def __init__(self, folder: Path, settings: str) -> None:
        """Look for what an earlier call left.

        Args:
            folder: Of the data set.
            settings: Its settings as JSON.

        Raises:
            DamagedShard: A file there is not what was written.
        """
        self.folder, self.settings = folder / FOLDER, settings
        self.folder.mkdir(exist_ok=True)
        self._paths: dict[str, Path] = {}
        self.left: list[Entry] = []
        """What an earlier call left, in the order in which it was played."""
        for path in shard_paths(self.folder):
            for entry in _read(path):
                self._paths[entry.name] = path
                self.left.append(entry)
        self._next = 1 + max((shard_number(path) for path in self._paths.values()), default=-1)

    def keep(self, entry: Entry) -> None:
        """Write an episode down."""
        self._paths[entry.name] = write_shard(self.folder, self._next, [entry], self.settings)
        self._next += 1

    def drop(self, names: Iterable[str]) -> None:
        """Forget episodes that are in a shard by now, or not wanted."""
        for name in names:
            self._paths.pop(name).unlink()


def _read(path: Path) -> list[Entry]:
    try:
        return list(read_shard(path))
    except DamagedShard as error:
        raise DamagedShard(f"{error} Remove it; its episode is played again.") from error
