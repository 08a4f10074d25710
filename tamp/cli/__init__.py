"""What ``bipre`` does with its arguments: one verb a module, JSON on stdout, text on stderr.

Exit codes: 0 success; 1 the task was not solved, or a check found something; 2 wrong use or bad input, with one
readable message; 130 interrupted. An exception that is nobody's input error is a bug: a traceback and exit code 70.
"""

from __future__ import annotations

import contextlib
import difflib
import io
import os
import re
import sys
import traceback
from collections.abc import Iterator, Sequence

from tamp.cli.output import Output
from tamp.cli.verbs import VERBS

USAGE, INTERRUPTED, BUG = 2, 130, 70


def entry() -> None:
    """The console script."""
    sys.exit(main())


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``bipre`` with ``argv`` (without the program name) and return its exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    with Output(json="--json" in words) as output:
        try:
            return _dispatch(words, output)
        except KeyboardInterrupt:
            output.fail("interrupted", "Interrupted. What was written so far is kept.")
            return INTERRUPTED
        except Exception as error:
            return _failed(error, output, debug="--debug" in words)


def _dispatch(words: list[str], output: Output) -> int:
    if not words or words[0] in ("-h", "--help"):
        output.text(_overview())
        return 0 if words else USAGE
    if words[0] == "--version":
        from importlib.metadata import version

        output.text(f"bipremanip {version('bipremanip')}")
        return 0
    verb = words[0]
    if verb not in VERBS:
        near = difflib.get_close_matches(verb, VERBS, n=1)
        hint = f' Did you mean "{near[0]}"?' if near else ""
        output.fail("usage", f'No verb "{verb}".{hint} Verbs: {", ".join(VERBS)}.')
        return USAGE
    return _parse_and_run(verb, words[1:], output)


def _parse_and_run(verb: str, words: list[str], output: Output) -> int:
    import tyro

    module = VERBS[verb]()
    said, shown = io.StringIO(), io.StringIO()
    try:
        asked = any(word in ("-h", "--help") for word in words)
        width = contextlib.nullcontext() if asked else _wide()
        with width, contextlib.redirect_stderr(said), contextlib.redirect_stdout(shown):
            arguments = tyro.cli(
                module.Arguments,
                prog=f"bipre {verb}",
                description=module.__doc__,
                args=words,
                config=(tyro.conf.FlagCreatePairsOff,),
            )
    except SystemExit as stop:
        if not stop.code:
            output.text(shown.getvalue())
            return 0
        output.fail("usage", _unboxed(said.getvalue() + shown.getvalue()))
        return USAGE
    return int(module.run(arguments, output))


def _unboxed(text: str) -> str:
    """An argument error as one message: without the frame around it and the repeated help of each argument."""
    lines = [line.strip(" │╭╮╰╯─") for line in text.splitlines()]
    kept = [
        line
        for line in lines
        if line and set(line) != {"-"} and not line.startswith(("For full", "Argument help", "bipre "))
    ]
    helps = [k for k, line in enumerate(kept) if line.startswith("-") or "(default:" in line or "(required)" in line]
    flags = [kept[k].partition("  ")[0] for k in helps if kept[k].startswith("-")]
    message = (
        ". ".join(line for k, line in enumerate(kept) if k not in helps and k > 0).rstrip(".").replace(":. ", ": ")
    )
    message = re.sub(r"invalid literal for int\(\) with base 10: (\S+)", r"\1 is not a whole number", message)
    message = re.sub(r"could not convert string to float: (\S+)", r"\1 is not a number", message)
    if message.endswith(":") and flags:
        message += " " + ", ".join(flags)
    return message + ". --help tells more."


@contextlib.contextmanager
def _wide() -> Iterator[None]:
    """Let tyro write lines of any length, so that no message is broken in two."""
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = "1000"
    try:
        yield
    finally:
        os.environ.pop("COLUMNS")
        if before is not None:
            os.environ["COLUMNS"] = before


def _failed(error: Exception, output: Output, *, debug: bool) -> int:
    from robots.errors import BadInput, TampError

    if debug or not isinstance(error, TampError):
        output.text(traceback.format_exc())
    if isinstance(error, TampError):
        output.fail("bad_input" if isinstance(error, BadInput) else "failed", str(error))
        return USAGE if isinstance(error, BadInput) else 1
    output.fail("bug", f"{type(error).__name__}: {error}. This is a bug; please report it with the lines above.")
    return BUG


def _overview() -> str:
    lines = [
        "usage: bipre VERB [ARGUMENTS] [--json] [--debug]",
        "",
        "Plans and runs two-arm preparatory manipulation.",
        "",
    ]
    for name, module in VERBS.items():
        first = (module().__doc__ or "").strip().splitlines()[0]
        lines.append(f"  {name:8} {first}")
    return "\n".join([*lines, "", "bipre VERB --help tells a verb's arguments."])
