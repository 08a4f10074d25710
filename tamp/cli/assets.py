"""List the object instances of a source and check that they can be used."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from tamp.cli.output import Output

if TYPE_CHECKING:
    from worlds.assets.asset import Asset


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``bipre assets``."""

    category: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="CATEGORY")] = None
    """One category; without it all."""
    asset: str = "synthetic"
    """synthetic, partnet:DIR with PartNet-Mobility folders, or mesh:DIR with rigid meshes."""
    split: Literal["seen", "unseen"] | None = None
    """Only the seen or the held-out instances."""
    sheet: Annotated[Path | None, tyro.conf.arg(metavar="FILE.png")] = None
    """Draw the first 24 instances, or the first 8 of every category, on a picture."""
    json: bool = False
    """One JSON object on stdout, nothing else."""
    debug: bool = False
    """Show tracebacks of input errors."""


def run(arguments: Arguments, output: Output) -> int:
    """List; 0 when at least one instance can be used, else 1."""
    from worlds.tasks import task_of

    wanted = None if arguments.category is None else task_of(arguments.category).objects
    from worlds.assets.asset import Asset
    from worlds.assets.library import categories, survey

    if arguments.sheet is not None:
        from tamp.view.sheet import require_sheet

        require_sheet(arguments.sheet)
    rows: list[dict[str, Any]] = []
    usable_assets: dict[str, list[Asset]] = {}
    for category in categories(arguments.asset) if wanted is None else [wanted]:
        for found in survey(arguments.asset, category, arguments.split):
            usable = isinstance(found, Asset)
            rows.append({"category": category, "instance": found.instance, "usable": usable, **_facts(found)})
            if isinstance(found, Asset):
                usable_assets.setdefault(category, []).append(found)
    _show(rows, output)
    if arguments.sheet is not None:
        _draw(arguments.sheet, usable_assets, output)
    usable_count = sum(row["usable"] for row in rows)
    output.emit(
        {
            "source": arguments.asset,
            "instances": rows,
            "usable": usable_count,
            "rejected": len(rows) - usable_count,
            "rejected_share": (len(rows) - usable_count) / max(1, len(rows)),
            "sheet": None if arguments.sheet is None else str(arguments.sheet),
        }
    )
    return 0 if usable_count else 1


def _draw(path: Path, found: dict[str, list[Asset]], output: Output) -> None:
    """Write the contact sheet: one category over several rows, or a row for each."""
    from tamp.view.sheet import COLUMNS, MOST, write_sheet

    most = MOST if len(found) == 1 else COLUMNS
    write_sheet(path, [assets[:most] for assets in found.values()])
    output.console.print(f"drawn on {path}")


def _facts(found: Any) -> dict[str, Any]:
    from worlds.assets.asset import Asset

    if not isinstance(found, Asset):
        return {"reason": found.reason}
    return {
        "kind": "-" if found.function is None else found.function.kind,
        "topology": found.topology,
        "split": found.split,
        "mass": round(found.mass, 4),
        "travel": None if found.function is None else round(found.function.travel, 5),
        "notes": list(found.notes),
        "content_hash": found.content_hash,
    }


def _show(rows: list[dict[str, Any]], output: Output) -> None:
    from rich.table import Column, Table

    instance = Column("instance", overflow="fold", min_width=12)
    table = Table(
        "category", instance, "operated by", "topology", "split", "mass", "remark", box=None, header_style="dim"
    )
    for row in rows:
        if row["usable"]:
            mass, remark = (
                f"{1e3 * row['mass']:.0f} g",
                f"{len(row['notes'])} supplied (--json)" if row["notes"] else "",
            )
            table.add_row(*(row[key] for key in ("category", "instance", "kind", "topology", "split")), mass, remark)
        else:
            table.add_row(row["category"], row["instance"], "[red]rejected[/red]", "", "", "", row["reason"])
    output.console.print(table)
    for category in dict.fromkeys(row["category"] for row in rows):
        mine = [row for row in rows if row["category"] == category]
        good = sum(row["usable"] for row in mine)
        output.console.print(f"{category}: {good} of {len(mine)} usable, {len(mine) - good} rejected")
