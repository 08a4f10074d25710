"""What does the paper report for its methods?"""

from __future__ import annotations

from functools import cache
from importlib import resources

import msgspec
from msgspec import Struct

from worlds.assets.asset import Split


class PaperTable(Struct, frozen=True, forbid_unknown_fields=True):
    """Table 1 of the paper."""

    source: str
    methods: dict[str, dict[str, dict[Split, int]]]
    """Success rate [%] by method, category and split."""

    def rate(self, method: str, category: str, split: Split) -> float | None:
        """A success rate in ``[0, 1]``; ``None`` for a column that the paper does not have."""
        columns = self.methods[method]
        return columns[category][split] / 100 if category in columns else None


@cache
def paper_table() -> PaperTable:
    """The numbers as printed."""
    return msgspec.json.decode((resources.files("tamp") / "bench" / "paper.json").read_bytes(), type=PaperTable)
