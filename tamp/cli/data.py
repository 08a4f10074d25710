"""Count and check a data set, or play one of its episodes again and compare.

Damaged shards are named and moved to DIR/quarantine; `bipre collect` then collects what is missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from tamp.cli.output import Output

if TYPE_CHECKING:
    from tamp.data.check import Examination
    from tamp.data.replay import Replay

PROBLEMS_SHOWN = 20


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``bipre data``."""

    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR")]
    """Folder of the data set."""
    replay: Annotated[str | None, tyro.conf.arg(metavar="EPISODE")] = None
    """Play this episode again, for example Bottle-000012, and compare."""
    json: bool = False
    """One JSON object on stdout, nothing else."""
    debug: bool = False
    """Show tracebacks of input errors."""


def run(arguments: Arguments, output: Output) -> int:
    """Check or replay; 0 when nothing is wrong, and the replay came out the same, else 1."""
    from tamp.data.shards import require_h5py

    require_h5py()
    if arguments.replay is not None:
        from tamp.data.replay import replay

        again = replay(arguments.folder, arguments.replay)
        _show_replay(again, output)
        output.emit(again)
        return 0 if again.same else 1
    from tamp.data.check import examine

    found = examine(arguments.folder)
    _show(found, output)
    output.emit(found)
    return 0 if found.ok else 1


def _show(found: Examination, output: Output) -> None:
    from rich.markup import escape
    from rich.table import Table

    from tamp.cli.counting import print_table

    table = Table("category", box=None, header_style="dim")
    for name in ("episodes", "successes", "failures", "objects", "rejections"):
        table.add_column(name, justify="right")
    table.add_column("outcomes")
    table.add_column("failing stages")
    for column in found.columns:
        numbers = (column.episodes, column.successes, column.failures, column.instances, column.rejections)
        table.add_row(
            column.category, *(str(n) for n in numbers), _listed(column.outcomes), _listed(column.failing_stages)
        )
    console = output.console
    print_table(table, output)
    for problem in found.problems[:PROBLEMS_SHOWN]:
        console.print(f"[red]{problem.kind}[/red] {escape(problem.where)}: {escape(problem.detail)}")
    if len(found.problems) > PROBLEMS_SHOWN:
        console.print(f"... and {len(found.problems) - PROBLEMS_SHOWN} more (--json)")
    verdict = "[green]ok[/green]" if found.ok else f"[red]{len(found.problems)} problem(s)[/red]"
    console.print(f"{verdict}  {found.episodes} episodes in {found.shards} shards")
    if found.pending:
        console.print(f"{found.pending} more were played, but are not kept yet: `bipre collect` goes on with them")


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items())


def _show_replay(again: Replay, output: Output) -> None:
    console = output.console
    if again.same:
        console.print(f"[green]same[/green]  {again.episode}: {again.stored.outcome}")
        return
    console.print(f"[red]different[/red]  {again.episode}: {'; '.join(again.differences)}", soft_wrap=True)
    changed = [
        f"{name} {version} then, {again.now.versions.get(name, 'absent')} now"
        for name, version in again.stored.versions.items()
        if again.now.versions.get(name) != version
    ]
    if changed:
        console.print(f"versions differ: {', '.join(changed)}")
