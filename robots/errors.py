"""Which errors a caller may have to handle: one tree, said once.

```
TampError                    everything this project raises on purpose
+-- BadInput                 wrong use: the command line exits with 2
|   +-- UnknownName          a name that does not exist; lists those that do
|   +-- BadWorkcell          a workcell file that cannot be used
|   +-- BadAsset             an object model that cannot be used
|   +-- BadRunFolder         a run folder or plan file that cannot be read
|   +-- MissingDependency    an optional package is absent; names the pip line
+-- SimulationDiverged       the physics produced a non-finite state
```

A search that finds nothing is not an error: it is a value (see ``planners``).
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LISTED = 24
"""How many valid choices a message spells out."""


class TampError(Exception):
    """Base of every error raised on purpose in this project."""


class BadInput(TampError):
    """What the user gave cannot be used; the message says why and what to do."""


class UnknownName(BadInput):
    """A name that does not exist, with the closest one that does.

    Attributes:
        kind: What the name should have been, for example ``"category"``.
        name: The name as given.
        choices: Every valid name.
    """

    def __init__(self, kind: str, name: str, choices: Iterable[str]) -> None:
        self.kind = kind
        self.name = name
        self.choices = tuple(sorted(choices))
        super().__init__(f'No {kind} "{name}".{self._hint()} Valid: {self._listed()}.')

    def _listed(self) -> str:
        if len(self.choices) <= LISTED:
            return ", ".join(self.choices)
        return f"{', '.join(self.choices[:3])} ... {self.choices[-1]} ({len(self.choices)} in all)"

    def _hint(self) -> str:
        folded = {choice.casefold(): choice for choice in self.choices}
        near = difflib.get_close_matches(self.name.casefold(), folded, n=1)
        return f' Did you mean "{folded[near[0]]}"?' if near else ""


class BadWorkcell(BadInput):
    """A workcell description that cannot be read or makes no sense."""


class BadAsset(BadInput):
    """An object model that cannot be used, with its reason.

    Attributes:
        reason: Why, in one clause.
    """

    def __init__(self, instance: str, reason: str) -> None:
        self.instance = instance
        self.reason = reason
        super().__init__(f"Asset {instance} cannot be used: {reason}")


class BadRunFolder(BadInput):
    """A run folder or a file in it that is missing, corrupt or of a foreign version."""


class MissingDependency(BadInput):
    """An optional package is not installed.

    Attributes:
        package: The import name.
        extra: The extra of this distribution that brings it.
    """

    def __init__(self, package: str, extra: str, purpose: str) -> None:
        self.package = package
        self.extra = extra
        super().__init__(
            f"{purpose} needs the package {package}, which is not installed. "
            f'Install it with: pip install "bipremanip[{extra}]"'
        )


class TrainingDiverged(TampError):
    """A loss or its gradient is no longer a finite number."""


class SimulationDiverged(TampError):
    """The simulated state stopped being finite."""
