"""A plan as one page: a file that needs nothing else, or a server with a time line."""

from __future__ import annotations

import html
import socket
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from affordance.maps import load_maps
from robots.cache import write_atomic
from robots.errors import BadInput
from robots.spatial import Array
from tamp.plan import Plan
from tamp.trace import Trace
from tamp.view.scene import PlanScene
from tamp.view.section import maps_section
from worlds.bullet.client import quiet
from worlds.tasks import TaskType

HTML_FILE = "plan.html"
FRAME_TIME = 0.08
"""Time between frames of the saved page [s]."""

PORTS_TRIED = 50

ROLES: dict[TaskType, str] = {
    "articulated": "The {assistant} arm prepares, the {primary} arm acts.",
    "edge_push": "The {assistant} arm pushes the object over the edge, the {primary} arm takes it there.",
    "plate_lift": "The {assistant} arm presses one side down, the {primary} arm takes the other.",
    "handover": "The {assistant} arm holds the object out and lets go when the human pulls.",
}
"""What the arms do, by task type."""

_PANEL = """
<style>
#bipre {{ position: fixed; left: 12px; top: 12px; z-index: 10; max-width: 30rem; max-height: 90vh; overflow: auto;
  font: 13px/1.45 system-ui, sans-serif; color: #1b1f24; background: rgba(255, 255, 255, .92); border-radius: 8px;
  padding: 10px 14px; box-shadow: 0 1px 6px rgba(0, 0, 0, .25) }}
#bipre summary {{ font-weight: 600; cursor: pointer }}
#bipre table {{ border-collapse: collapse; margin-top: 6px }}
#bipre td, #bipre th {{ text-align: left; padding: 1px 10px 1px 0; vertical-align: top }}
</style>
<details id="bipre" open><summary>{title}</summary>
<p>{lead}</p>
<table><tr><th></th><th>stage</th><th>arm</th><th>s</th><th>tried</th></tr>{stages}</table>
{maps}
{rejected}
</details>
"""


def write_html(plan: Plan, cloud: Array, colours: Array, folder: Path, trace: Trace | None) -> Path:
    """Write ``plan.html`` into the run folder: the animated plan and its stages, without a server.

    Args:
        plan: What to show.
        cloud: Observed points in the world frame ``(n, 3)`` [m].
        colours: Their colours ``(n, 3)`` in ``[0, 1]``.
        folder: The run folder.
        trace: What was rejected on the way, if known.
    """
    server = _server(_free_port(8080))
    try:
        scene = PlanScene(server, plan, cloud, colours, trace)
        scene.show(0.0)
        recorder = server.get_scene_serializer()
        for t in np.arange(0.0, scene.playback.duration, FRAME_TIME):
            scene.show(float(t))
            recorder.insert_sleep(FRAME_TIME)
        scene.show(scene.playback.duration)
        recorder.insert_sleep(1.0)
        page = recorder.as_html()
    finally:
        _stop(server)
    head, body, tail = page.rpartition("</body>")
    if not body:
        head, tail = page, ""
    maps = maps_section(load_maps(folder), cloud, colours, plan.workcell.table)
    return write_atomic(folder / HTML_FILE, head + _panel(plan, trace, maps) + body + tail)


def serve(
    plan: Plan, cloud: Array, colours: Array, trace: Trace | None, port: int, *, say: Callable[[str], None]
) -> None:
    """Serve the plan to browsers until interrupted, with play, pause and a time slider."""
    port = _free_port(port)
    server = _server(port)
    try:
        scene = PlanScene(server, plan, cloud, colours, trace)
        scene.show(0.0)
        slider, playing, speed = _controls(server, scene)
        say(f"viewing http://localhost:{port}   (from elsewhere: ssh -L {port}:localhost:{port} you@host)")
        say("Ctrl-C ends it.")
        before = time.monotonic()
        while True:
            time.sleep(0.03)
            now = time.monotonic()
            if playing.value and server.get_clients():
                t = slider.value + speed.value * (now - before)
                slider.value = 0.0 if t > scene.playback.duration else float(t)
                scene.show(slider.value)
            before = now
    except KeyboardInterrupt:
        return
    finally:
        _stop(server)


def _controls(server: Any, scene: PlanScene) -> tuple[Any, Any, Any]:
    plan, duration = scene.playback.plan, scene.playback.duration
    playing = server.gui.add_checkbox("play", True)
    speed = server.gui.add_slider("speed", 0.1, 4.0, 0.1, 1.0)
    slider = server.gui.add_slider("time [s]", 0.0, round(duration, 2), 0.01, 0.0)
    slider.on_update(lambda _: scene.show(slider.value))
    for number, begin in enumerate(scene.playback.stage_times()[:-1]):
        stage = plan.stages[number]
        button = server.gui.add_button(f"{number + 1} {stage.name} ({stage.arm}, {stage.role})")
        button.on_click(lambda _, begin=begin: setattr(slider, "value", round(begin, 2)))
    return slider, playing, speed


def _server(port: int) -> Any:
    """A viser server that says nothing."""
    with quiet():
        import viser

        return viser.ViserServer(host="127.0.0.1", port=port, verbose=False)


def _stop(server: Any) -> None:
    """End a server without its farewell."""
    with quiet():
        server.stop()


def _free_port(first: int) -> int:
    """The first port from ``first`` on that nobody listens on; ``BadInput`` when there is none nearby."""
    for port in range(first, min(first + PORTS_TRIED, 65536)):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise BadInput(f"No free port from {first} to {min(first + PORTS_TRIED, 65536) - 1}; give another --port.")


def _panel(plan: Plan, trace: Trace | None, maps: str) -> str:
    stages = "".join(
        f"<tr><td>{k + 1}</td><td>{s.name}</td><td>{s.arm} ({s.role})</td><td>{s.duration:.1f}</td>"
        f"<td>{s.candidates_tried}</td></tr>"
        for k, s in enumerate(plan.stages)
    )
    arms = ROLES[plan.task].format(assistant=plan.assistant, primary=plan.primary)
    lead = f"{html.escape(plan.instruction.capitalize())}. {arms}"
    return _PANEL.format(
        title=html.escape(f"{plan.category} {plan.asset.instance}, seed {plan.seed}, {plan.proposer}"),
        lead=lead, stages=stages, rejected=_rejections(trace), maps=maps,
    )  # fmt: skip


def _rejections(trace: Trace | None) -> str:
    if trace is None or not trace.rejections:
        return ""
    tally = Counter((r.stage, r.arm, r.cause) for r in trace.rejections)
    rows = "".join(
        f"<tr><td>{count}</td><td>{stage}</td><td>{arm}</td><td>{cause}</td></tr>"
        for (stage, arm, cause), count in tally.most_common(10)
    )
    return f"<p>Rejected on the way ({len(trace.rejections)}):</p><table>{rows}</table>"
