"""Where a verb's words go: one JSON object on stdout when asked for, everything human on stderr."""

from __future__ import annotations

import contextlib
import json as json_library
import os
import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, Any, ClassVar, TextIO

if TYPE_CHECKING:
    from rich.console import Console


class Output:
    """The process's two streams while a verb runs.

    With ``json`` the real stdout is put aside until the one object is written, and whatever else writes to file
    descriptor 1 meanwhile, C libraries included, ends on stderr.
    """

    def __init__(self, *, json: bool) -> None:
        self.json = json
        self._kept: int | None = None
        self._console: Console | None = None
        self.emitted = False

    def __enter__(self) -> Output:
        if self.json:
            sys.stdout.flush()
            with contextlib.suppress(OSError):
                self._kept = os.dup(1)
                os.dup2(2, 1)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        sys.stdout.flush()
        if self._kept is not None:
            os.dup2(self._kept, 1)
            os.close(self._kept)
            self._kept = None

    @property
    def console(self) -> Console:
        """A rich console on stderr: colours and motion only on a terminal."""
        if self._console is None:
            from rich.console import Console

            self._console = Console(stderr=True, highlight=False, soft_wrap=True)
        return self._console

    def text(self, words: str) -> None:
        """Words for people, as they are."""
        sys.stderr.write(words.rstrip("\n") + "\n")
        sys.stderr.flush()

    def emit(self, value: Any) -> None:
        """The verb's result object, once, on the real stdout; nothing without ``--json``."""
        if not self.json or self.emitted:
            return
        import msgspec

        data = msgspec.json.encode(value) + b"\n"
        self.emitted = True
        if self._kept is not None:
            with os.fdopen(os.dup(self._kept), "wb") as stream:
                stream.write(data)
        else:
            sys.stdout.write(data.decode())

    def fail(self, kind: str, message: str) -> None:
        """An error: one message on stderr, and with ``--json`` an object that says the same."""
        self.text(f"error: {message}" if kind != "interrupted" else message)
        if self.json and not self.emitted:
            self.emitted = True
            line = json_library.dumps({"error": {"kind": kind, "message": message}}) + "\n"
            if self._kept is not None:
                os.write(self._kept, line.encode())
            else:
                sys.stdout.write(line)


class Progress:
    """A line on stderr that says what is going on; silent when stderr is no terminal."""

    PHASES: ClassVar[dict[str, str]] = {
        "world": "building the scene",
        "observe": "looking at the object",
        "plan": "searching for a plan",
        "execute": "executing",
        "write": "writing the run folder",
        "verify": "checking the plan",
    }

    def __init__(self, output: Output, stream: TextIO | None = None) -> None:
        self.output = output
        self.live = (stream or sys.stderr).isatty()
        self._status: Any = None
        self._started = time.monotonic()

    def __enter__(self) -> Progress:
        if self.live:
            self._status = self.output.console.status("starting")
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._status is not None:
            self._status.stop()

    def begin(self, phase: str) -> None:
        """A phase begins."""
        if self._status is not None:
            self._status.update(f"{self.PHASES.get(phase, phase)}  [dim]{time.monotonic() - self._started:.0f} s[/dim]")

    def note(self, text: str) -> None:
        """More about the phase that runs."""
        if self._status is not None:
            self._status.update(text)
