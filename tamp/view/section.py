"""The affordance maps as a part of plan.html: one drawing to turn, a choice of maps, a legend, the ranked hands."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib import resources
from typing import Any

import numpy as np

from affordance.maps import AffordanceMap, MapName
from robots.spatial import Array
from robots.workcell import Table
from tamp.view.affordance import BEST, EYE, OTHER, RAMP, stroke
from tamp.view.scene import CLOUD_SHOWN

CHOICES: dict[MapName, str] = {
    "goal_before": "where the primary could act, before",
    "pre": "where the assistant could act",
    "goal_after": "where the primary could act, after preparation",
}

CLOUD_CHOICE = "cloud colours"

WIDTH, HEIGHT = 840, 680
"""Size of the drawing [pixel]; shown at half of it, so that edges are smooth."""

DIGITS = 4
"""Decimals of what is written: a tenth of a millimetre, and more of a score than colours tell apart."""

_SECTION = """
<style>
#bipre-maps canvas {{ width: {width}px; max-width: 100%; touch-action: none; cursor: grab; background: #fff;
  border-radius: 6px; margin: 6px 0 }}
#bipre-maps-bar {{ display: inline-block; width: 12rem; height: .8rem; margin: 0 .5rem; vertical-align: middle }}
#bipre-maps-hands {{ white-space: pre-wrap }}
</style>
<section id="bipre-maps">
<p><label>Affordance: <select id="bipre-maps-select">{options}</select></label></p>
<canvas id="bipre-maps-canvas" width="{canvas_width}" height="{canvas_height}"
  title="Drag to turn, wheel to zoom, double click to reset."></canvas>
<div id="bipre-maps-legend"><span id="bipre-maps-low"></span><span id="bipre-maps-bar"></span><span
  id="bipre-maps-high"></span> &ensp;<label><input type="checkbox" id="bipre-maps-stretch"> stretch</label></div>
<div id="bipre-maps-hands"></div>
<script type="application/json" id="bipre-maps-data">{data}</script>
<script>{script}</script>
</section>
"""


def maps_section(maps: Sequence[AffordanceMap], cloud: Array, colours: Array, table: Table) -> str:
    """HTML that needs nothing else, empty without maps.

    Args:
        maps: What to choose from, besides the cloud.
        cloud: Observed points in the world frame ``(n, 3)`` [m].
        colours: Their colours ``(n, 3)`` in ``[0, 1]``.
        table: Its edge is drawn, since some objects reach over it.
    """
    if not maps:
        return ""
    titles = [CLOUD_CHOICE, *(CHOICES[one.name] for one in maps)]
    options = "".join(f'<option value="{k}"{" selected" * (k == 1)}>{title}</option>' for k, title in enumerate(titles))
    data = {
        "ramp": RAMP,
        "best": _css(BEST),
        "other": _css(OTHER),
        "turn": float(np.arctan2(EYE[1], EYE[0])),
        "tilt": float(np.arcsin(EYE[2])),
        "table": _corners(table),
        "views": [_cloud(cloud, colours), *(_view(one) for one in maps)],
    }
    script = (resources.files("tamp") / "view" / "maps.js").read_text("utf-8")
    return _SECTION.format(
        width=WIDTH // 2, canvas_width=WIDTH, canvas_height=HEIGHT, options=options,
        data=json.dumps(data, separators=(",", ":")), script=script,
    )  # fmt: skip


def _cloud(cloud: Array, colours: Array) -> dict[str, Any]:
    """The observed points in their own colours."""
    keep = _kept(len(cloud))
    return _framed(cloud[keep], []) | {"colours": np.rint(255 * colours[keep]).astype(int).tolist()}


def _view(one: AffordanceMap) -> dict[str, Any]:
    """A map: its points, scores and hands."""
    keep = _kept(len(one.points))
    lines = [stroke(T.homogeneous) for T in one.hands]
    return _framed(one.points[keep], lines) | {
        "scores": _rounded(one.scores[keep]),
        "least": float(one.scores.min()),
        "most": float(one.scores.max()),
        "hands": [
            {"line": _rounded(line), "score": f"{score:.2f}"}
            for line, score in zip(lines, one.hand_scores, strict=True)
        ],
    }


def _framed(points: Array, lines: Sequence[Array]) -> dict[str, Any]:
    """Points with the middle and the radius of the sphere that holds them and the lines, however it is turned."""
    everything = np.concatenate([points, *lines])
    centre = (everything.min(axis=0) + everything.max(axis=0)) / 2
    radius = max(float(np.linalg.norm(everything - centre, axis=1).max()), 1e-3)
    return {"points": _rounded(points), "centre": _rounded(centre), "radius": radius, "hands": []}


def _corners(table: Table) -> Any:
    """The corners of the table top, around it ``(4, 3)`` [m]."""
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    flat = np.array(table.centre) + signs * np.array(table.size) / 2
    return _rounded(np.column_stack([flat, np.full(4, table.top)]))


def _kept(count: int) -> Any:
    """Numbers of the points that are drawn."""
    return np.linspace(0, count - 1, min(count, CLOUD_SHOWN)).astype(int)


def _rounded(values: Array) -> Any:
    return np.round(values, DIGITS).tolist()


def _css(rgb: tuple[int, int, int]) -> str:
    return f"rgb{rgb}"
