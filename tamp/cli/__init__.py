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
from types import ModuleType

from tamp.cli.output import Output
from tamp.cli.verbs import VERBS, Loader, subverbs

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
    verb, rest = words[0], words[1:]
    if verb not in VERBS:
        return _no_such("verb", verb, VERBS, output)
    below = subverbs(verb)
    if not below or not rest or rest[0].startswith("-"):
        return _parse_and_run(verb, VERBS[verb], rest, output)
    if rest[0] not in below:
        return _no_such(f"{verb} verb", rest[0], below, output)
    return _parse_and_run(f"{verb} {rest[0]}", below[rest[0]], rest[1:], output)


def _no_such(kind: str, word: str, valid: dict[str, Loader], output: Output) -> int:
    near = difflib.get_close_matches(word, valid, n=1)
    hint = f' Did you mean "{near[0]}"?' if near else ""
    output.fail("usage", f'No {kind} "{word}".{hint} Verbs: {", ".join(valid)}.')
    return USAGE


def _parse_and_run(verb: str, load: Loader, words: list[str], output: Output) -> int:
    import tyro

    module = load()
    said, shown = io.StringIO(), io.StringIO()
    try:
        asked = any(word in ("-h", "--help") for word in words)
        width = contextlib.nullcontext() if asked else _wide()
        with width, contextlib.redirect_stderr(said), contextlib.redirect_stdout(shown):
            arguments = tyro.cli(
                module.Arguments,
                prog=f"bipre {verb}",
                description=module.__doc__ + _below(verb),
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


def _below(verb: str) -> str:
    """The verbs below a verb, for its help."""
    lines = [f"  bipre {verb} {word} ...   {_first_line(load())}" for word, load in subverbs(verb).items()]
    return "\n".join(["", "Other forms:", *lines]) if lines else ""


def _first_line(module: ModuleType) -> str:
    return (module.__doc__ or "").strip().splitlines()[0]


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
        lines.append(f"  {name:8} {_first_line(module())}")
    return "\n".join([*lines, "", "bipre VERB --help tells a verb's arguments."])
