"""``python -m tamp.cli`` is ``bipre``."""

from tamp.cli import entry

entry()
