"""What does a benchmark look like on one page that needs no other file?"""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from importlib import resources

from tamp.bench.charts import Series, rate_chart, series_name, series_of
from tamp.bench.classes import CLASSES
from tamp.bench.jobs import SPLITS
from tamp.bench.paper import paper_table
from tamp.bench.results import Comparison, Mean, Rate, Results

COMPARABLE = (
    "The paper's numbers are from another simulator and other objects, with hands that fly and no planner: compare the "
    "order of methods and the gaps between them, not the height."
)

FAULTS_SHOWN = 40
"""Rows of the table of faults; the rest are in episodes.jsonl."""

Counts = Callable[[Mean], dict[str, int]]
"""Which of a mean's tallies."""

TASK_NAMES = {
    "edge_push": "Edge-pushing",
    "articulated": "Articulated manipulation",
    "plate_lift": "Plate lifting",
    "handover": "Handover",
}


def page(results: Results) -> str:
    """The report as a well-formed HTML document."""
    style = (resources.files("tamp") / "bench" / "page.css").read_text("utf-8")
    parts = [_head(results), _rates(results), _means(results), _failures(results), _times(results)]
    parts += [_comparisons(results.comparisons), _faults(results), _settings(results)]
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8" />'
        '<meta name="viewport" content="width=device-width, initial-scale=1" />'
        f"<title>bipre bench</title><style>{style}</style></head>\n<body>{''.join(parts)}</body></html>\n"
    )


def _head(results: Results) -> str:
    series = series_of(results.rows)
    tiles = [_tile(f"{results.episodes}", "episodes" if results.complete else f"of {results.wanted} episodes so far")]
    for method, mode in series:
        mine = [rate for rate in results.rows if (rate.method, rate.mode) == (method, mode)]
        share = sum(rate.successes for rate in mine) / max(1, sum(rate.episodes for rate in mine))
        tiles.append(_tile(f"{100 * share:.0f} %", f"{series_name((method, mode))} succeeded"))
    if results.faults:
        tiles.append(_tile(str(len(results.faults)), "crashed, hung or raised", "tile bad"))
    absent = f"Not in this object source: {', '.join(results.absent)}." if results.absent else ""
    return (
        "<h1>bipre bench</h1><p class='soft'>Success rates of planning and executing whole episodes. "
        f"Objects: {escape(results.settings.asset)}. {escape(absent)}</p><div class='tiles'>{''.join(tiles)}</div>"
    )


def _tile(number: str, words: str, kind: str = "tile") -> str:
    return f"<div class='{kind}'><b>{escape(number)}</b>{escape(words)}</div>"


# -- success rates -----------------------------------------------------------------------------------------------------


def _rates(results: Results) -> str:
    series = series_of(results.rows)
    legend = "".join(
        f"<span class='s{place % 8}'><i></i><span>{escape(series_name(one))}</span></span>"
        for place, one in enumerate(series)
    )
    legend += "<span>□ the paper's Heuristic</span><span>◇ the paper's Ours</span>"
    charts = []
    for task_type in dict.fromkeys(rate.task_type for rate in results.rows):
        mine = [rate for rate in results.rows if rate.task_type == task_type]
        for split in results.settings.split:
            title = f"{TASK_NAMES[task_type]}, {split} objects"
            charts.append(f"<h3>{title}</h3><figure class='wide'>{rate_chart(mine, series, split)}</figure>")
    return (
        "<h2>Success by category</h2><p class='soft'>Dots are rates, lines Wilson's 95 % intervals.</p>"
        f"<div class='legend'>{legend}</div>{''.join(charts)}{_table_one(results)}"
    )


def _table_one(results: Results) -> str:
    """Our rates with the paper's Table 1 beside them, seen / unseen."""
    series, paper = series_of(results.rows), paper_table()
    groups = f"<th></th><th class='n' colspan='{len(series)}'>here</th>"
    groups += f"<th class='n split' colspan='{len(paper.methods)}'>the paper</th>"
    names = [(series_name(one), "n") for one in series]
    names += [(name, "n split" if k == 0 else "n") for k, name in enumerate(paper.methods)]
    head = "".join(f"<th class='{kind}'>{escape(name)}</th>" for name, kind in names)
    body = []
    for category in dict.fromkeys(rate.category for rate in results.rows):
        mine = [rate for rate in results.rows if rate.category == category]
        cells = "".join(f"<td class='n ours'>{_both(mine, one)}</td>" for one in series)
        for k, method in enumerate(paper.methods):
            said = " / ".join(_percent(paper.rate(method, category, split)) for split in SPLITS)
            cells += f"<td class='n{' split' if k == 0 else ''}'>{said}</td>"
        body.append(f"<tr><td>{escape(category)}</td>{cells}</tr>")
    return (
        f"<h3>Beside the paper's Table 1</h3><p class='soft'>Success [%], seen / unseen. {COMPARABLE}</p>"
        f"<div class='wide'><table><thead><tr>{groups}</tr><tr><th>category</th>{head}</tr></thead>"
        f"<tbody>{''.join(body)}</tbody>"
        f"</table></div><p class='soft'>{escape(paper.source)}.</p>"
    )


def _both(rates: list[Rate], series: Series) -> str:
    found = {rate.split: rate.rate for rate in rates if (rate.method, rate.mode) == series}
    return " / ".join(_percent(found.get(split)) for split in SPLITS)


def _percent(rate: float | None) -> str:
    return "–" if rate is None else f"{100 * rate:.0f}"


def _means(results: Results) -> str:
    rows = "".join(
        _row(
            TASK_NAMES[mean.task_type],
            mean.method,
            mean.mode,
            mean.split,
            f"{mean.categories}",
            f"{100 * mean.rate:.1f}",
            f"{mean.successes} / {mean.episodes}",
            f"{100 * mean.ci_low:.1f} to {100 * mean.ci_high:.1f}",
            numbers=4,
        )
        for mean in results.means
    )
    heads = ("task type", "method", "mode", "split", "categories", "mean of rates [%]", "pooled", "95 % interval [%]")
    return f"<h2>Means by task type</h2>{_table(heads, rows, 4)}"


def _table(heads: tuple[str, ...], rows: str, numbers: int, caption: str = "") -> str:
    """A table whose columns from ``numbers`` on are right-aligned."""
    head = "".join(f"<th{_aligned(k, numbers)}>{escape(name)}</th>" for k, name in enumerate(heads))
    said = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<div class='wide'><table>{said}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>"


def _row(*cells: str, numbers: int) -> str:
    return f"<tr>{''.join(f'<td{_aligned(k, numbers)}>{escape(cell)}</td>' for k, cell in enumerate(cells))}</tr>"


def _aligned(column: int, numbers: int) -> str:
    return " class='n'" if column >= numbers else ""


# -- failures and times ------------------------------------------------------------------------------------------------


def _failures(results: Results) -> str:
    causes = list(dict.fromkeys(name for mean in results.means for name in mean.failures))
    return (
        "<h2>Failures</h2><p class='soft'>Counts by our causes, and by the paper's five classes; the mapping is a "
        "reading of the paper's examples.</p>"
        + _histogram(results.means, causes, "cause", lambda mean: mean.failures)
        + _histogram(results.means, list(CLASSES), "the paper's class", lambda mean: mean.failure_classes)
    )


def _histogram(means: list[Mean], names: list[str], what: str, counts: Counts) -> str:
    series = list(dict.fromkeys((mean.method, mean.mode) for mean in means))
    totals = {
        (one, name): sum(counts(mean).get(name, 0) for mean in means if (mean.method, mean.mode) == one)
        for one in series
        for name in names
    }
    largest = max([1, *totals.values()])
    names = sorted(names, key=lambda name: -sum(totals[one, name] for one in series))
    heads = (what, *(series_name(one) for one in series))
    rows = []
    for name in names:
        cells = "".join(f"<td>{_bar(totals[one, name], largest)}</td>" for one in series)
        rows.append(f"<tr><td>{escape(name.replace('_', ' '))}</td>{cells}</tr>")
    return _table(heads, "".join(rows), len(heads)) if rows else "<p>None.</p>"


def _bar(count: int, largest: int) -> str:
    return f"<span class='bar' style='width:{160 * count / largest:.0f}px'></span> {count}"


def _times(results: Results) -> str:
    rows = "".join(
        _row(
            TASK_NAMES[mean.task_type],
            mean.method,
            mean.mode,
            mean.split,
            _seconds(mean.plan_seconds_median),
            _seconds(mean.plan_seconds_p95),
            numbers=4,
        )
        for mean in results.means
    )
    heads = ("task type", "method", "mode", "split", "median [s]", "95th percentile [s]")
    note = "From the observation to the plan or to giving up, on the machine and with the workers that ran."
    return f"<h2>Planning time</h2><p class='soft'>{note}</p>{_table(heads, rows, 4)}"


def _seconds(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def _comparisons(comparisons: list[Comparison]) -> str:
    if not comparisons:
        return ""
    rows = "".join(
        _row(
            "all" if c.task_type == "all" else TASK_NAMES[c.task_type],
            f"{c.first} / {c.second}",
            c.within,
            str(c.pairs),
            str(c.both),
            str(c.only_first),
            str(c.only_second),
            str(c.neither),
            f"{c.p:.2g}",
            numbers=3,
        )
        for c in comparisons
    )
    heads = ("task type", "first / second", "within", "pairs", "both", "only first", "only second", "neither", "p")
    note = "The same seeds for both. McNemar's exact test, two-sided, not corrected for the number of tests."
    return f"<h2>Paired comparisons</h2><p class='soft'>{note}</p>{_table(heads, rows, 3)}"


def _faults(results: Results) -> str:
    if not results.faults:
        return ""
    rows = "".join(
        f"<tr><td><code>{escape(fault.episode)}</code></td><td>{escape(fault.reason)}</td>"
        f"<td class='words'>{escape(fault.detail)}</td></tr>"
        for fault in results.faults[:FAULTS_SHOWN]
    )
    note = "Episodes without an outcome. They count as failures."
    return f"<h2>Faults</h2><p class='soft'>{note}</p>{_table(('episode', 'reason', 'detail'), rows, 3)}"


def _settings(results: Results) -> str:
    settings = results.settings
    versions = ", ".join(f"{name} {version}" for name, version in settings.versions.items())
    command = (
        f"bipre bench --methods {','.join(settings.methods)} --mode {','.join(settings.mode)} "
        f"--categories {','.join(settings.categories)} --split {','.join(settings.split)} --asset {settings.asset} "
        f"--episodes {settings.episodes}{' --every-instance' * settings.every_instance} --timeout {settings.timeout:g}"
    )
    return (
        f"<h2>To repeat it</h2><p><code>{escape(command)}</code></p><p class='soft'>{escape(versions)}; "
        f"code {escape(settings.program)}; {results.seconds:.0f} s of episodes. Seeds: tamp/bench/seeds.json.</p>"
    )
