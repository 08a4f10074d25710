"""How are success rates drawn? One line a category, a dot with its interval a method, the paper's beside them."""

from __future__ import annotations

from html import escape

from tamp.bench.paper import paper_table
from tamp.bench.results import Rate
from worlds.assets.asset import Split

LEFT, WIDTH, RIGHT, TOP = 150, 800, 30, 8
"""Space for category names, length of the axis, margin, and height above the first line [px]."""

PITCH, AXIS = 11, 26
"""Height of one series in a line, and of the axis below [px]."""

PAPER_MARKS = {"Heuristic": "M-4,-4H4V4H-4Z", "Ours": "M0,-5L5,0L0,5L-5,0Z"}
"""The paper's methods that are drawn: a square and a diamond, hollow."""

Series = tuple[str, str]
"""A method and a mode."""


def series_of(rates: list[Rate]) -> list[Series]:
    """Every method and mode, in the order of first appearance: the place decides the colour."""
    return list(dict.fromkeys((rate.method, rate.mode) for rate in rates))


def series_name(series: Series) -> str:
    """For legends and tables."""
    return f"{series[0]} {series[1]}"


def rate_chart(rates: list[Rate], series: list[Series], split: Split) -> str:
    """An SVG of the rates of one split; colours come from the page's style sheet."""
    categories = list(dict.fromkeys(rate.category for rate in rates))
    height = PITCH * (len(series) + 1) + 6
    bottom = TOP + height * len(categories)
    title = f"Success rate on {split} objects with 95 % intervals"
    lines = [
        f'<svg viewBox="0 0 {LEFT + WIDTH + RIGHT} {bottom + AXIS}" role="img" aria-label="{escape(title)}">',
        *_grid(bottom),
    ]
    for row, category in enumerate(categories):
        middle = TOP + row * height + height / 2
        lines.append(f'<text x="{LEFT - 10}" y="{middle + 4:.1f}" text-anchor="end">{escape(category)}</text>')
        for rate in (rate for rate in rates if rate.category == category and rate.split == split):
            place = series.index((rate.method, rate.mode))
            lines.append(_dot(rate, place, middle + (place - (len(series) - 1) / 2) * PITCH))
        lines += _paper_marks(category, split, middle)
    return "\n".join([*lines, "</svg>"])


def _x(rate: float) -> float:
    return LEFT + WIDTH * rate


def _grid(bottom: float) -> list[str]:
    lines = []
    for percent in range(0, 101, 20):
        x = _x(percent / 100)
        lines.append(f'<line class="grid" x1="{x}" x2="{x}" y1="{TOP}" y2="{bottom}" />')
        lines.append(f'<text class="tick" x="{x}" y="{bottom + 16}" text-anchor="middle">{percent} %</text>')
    return lines


def _dot(rate: Rate, place: int, y: float) -> str:
    low, high, at = _x(rate.ci_low), _x(rate.ci_high), _x(rate.rate)
    said = (
        f"{rate.category} {rate.split}, {rate.method} {rate.mode}: {rate.successes} of {rate.episodes}, "
        f"{100 * rate.rate:.0f} % ({100 * rate.ci_low:.0f} to {100 * rate.ci_high:.0f})"
    )
    return (
        f'<g class="s{place % 8}"><title>{escape(said)}</title>'
        f'<line class="whisker" x1="{low:.1f}" x2="{high:.1f}" y1="{y:.1f}" y2="{y:.1f}" />'
        f'<circle class="dot" cx="{at:.1f}" cy="{y:.1f}" r="4" /></g>'
    )


def _paper_marks(category: str, split: Split, y: float) -> list[str]:
    marks = []
    for method, shape in PAPER_MARKS.items():
        rate = paper_table().rate(method, category, split)
        if rate is not None:
            marks.append(
                f'<path class="paper" d="{shape}" transform="translate({_x(rate):.1f},{y:.1f})">'
                f"<title>{category} {split}, the paper's {method}: {100 * rate:.0f} %</title></path>"
            )
    return marks
