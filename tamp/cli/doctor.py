"""Tell versions and what this machine can do: the first thing to put into a bug report."""

from __future__ import annotations

import os
import platform
import socket
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec

from msgspec import Struct

from tamp.cli.output import Output

NEEDED = {
    "pybullet": "3.2.7",
    "ompl": "2.0.1",
    "pin": "4.1",
    "coal": "3.0",
    "toppra": "0.6.10",
    "numpy": "2.",
    "scipy": "1.",
    "trimesh": "",
    "coacd": "",
    "msgspec": "",
    "tyro": "",
    "rich": "",
    "viser": "1.",
}
OPTIONAL = {"imageio-ffmpeg": "video", "h5py": "data", "torch": "learn"}


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``bipre doctor``."""

    json: bool = False
    """One JSON object on stdout, nothing else."""
    debug: bool = False
    """Show tracebacks of input errors."""


class Check(Struct, frozen=True):
    """One line of the examination."""

    name: str
    ok: bool
    needed: bool
    detail: str


def run(arguments: Arguments, output: Output) -> int:
    """Examine; 0 when everything needed is fine, else 1."""
    checks = [_python(), *(_package(name, begin) for name, begin in NEEDED.items())]
    checks += [_extra(name, extra) for name, extra in OPTIONAL.items()]
    checks += [_guarded(name, check) for name, check in MACHINE.items()]
    from rich.markup import escape

    for check in checks:
        mark = "[green]ok[/green]" if check.ok else ("[red]BAD[/red]" if check.needed else "[yellow]no[/yellow]")
        output.console.print(f"  {check.name:16} {mark:4}  {escape(check.detail)}")
    healthy = all(check.ok for check in checks if check.needed)
    output.emit({"ok": healthy, "checks": checks})
    return 0 if healthy else 1


def _python() -> Check:
    good = sys.version_info[:2] == (3, 11)
    return Check("python", good, True, f"{platform.python_version()} on {platform.platform()}, 3.11 needed")


def _package(name: str, begin: str) -> Check:
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        return Check(name, False, True, "not installed; pip install -c requirements.lock -e .")
    good = version.startswith(begin)
    return Check(name, good, True, version if good else f"{version}, {begin}* expected")


def _extra(name: str, extra: str) -> Check:
    try:
        return Check(name, True, False, metadata.version(name))
    except metadata.PackageNotFoundError:
        return Check(name, False, False, f'not installed; pip install "bipremanip[{extra}]"')


def _guarded(name: str, check: Callable[[], tuple[bool, bool, str]]) -> Check:
    try:
        ok, needed, detail = check()
    except Exception as error:  # a broken machine must not stop the examination
        return Check(name, False, True, f"{type(error).__name__}: {error}")
    return Check(name, ok, needed, detail)


def _images() -> tuple[bool, bool, str]:
    from worlds.bullet.client import Client

    client = Client()
    fast = bool(client.isNumpyEnabled())
    client.close()
    return fast, True, "with numpy" if fast else "without numpy: this pybullet was compiled, not installed from a wheel"


def _gpu() -> tuple[bool, bool, str]:
    if find_spec("torch") is None:
        return False, False, "torch is not installed; nothing in this version needs a GPU"
    present = os.path.exists("/dev/nvidia0")  # noqa: PTH110
    return present, False, "present" if present else "none; everything runs on the CPU"


def _display() -> tuple[bool, bool, str]:
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(display), False, display or "none; not needed, plan.html opens anywhere"


def _port() -> tuple[bool, bool, str]:
    with socket.socket() as probe:
        taken = probe.connect_ex(("127.0.0.1", 8080)) == 0
    return not taken, False, "8080 is taken; bipre view takes the next free one" if taken else "8080 is free"


def _cache() -> tuple[bool, bool, str]:
    from robots.cache import cache_dir, write_atomic

    path = write_atomic(cache_dir() / "doctor", "ok")
    path.unlink()
    return True, True, str(cache_dir())


def _workcell() -> tuple[bool, bool, str]:
    from robots.model import DualArm
    from robots.workcell import load_workcell, workcell_names

    for name in workcell_names():
        DualArm(load_workcell(name))
    return True, True, ", ".join(workcell_names())


MACHINE: dict[str, Callable[[], tuple[bool, bool, str]]] = {
    "camera images": _images,
    "GPU": _gpu,
    "display": _display,
    "viewer port": _port,
    "cache": _cache,
    "workcells": _workcell,
}
