"""How PyBullet is loaded and spoken to: quietly, one client an owner, poses as ``pin.SE3``."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from robots.errors import BadAsset


@contextmanager
def quiet() -> Iterator[None]:
    """Silence what C code prints on the process's stdout and stderr."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(1), os.dup(2)]
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 1)
        os.dup2(sink, 2)
        yield
    finally:
        os.dup2(kept[0], 1)
        os.dup2(kept[1], 2)
        for fd in (*kept, sink):
            os.close(fd)


class Client:
    """One PyBullet physics server without a window; every PyBullet function is an attribute.

    ``client.stepSimulation()`` is ``pybullet.stepSimulation(physicsClientId=...)`` of this server.
    """

    def __init__(self) -> None:
        with quiet():
            import pybullet
            from pybullet_utils.bullet_client import BulletClient

            self._bullet = BulletClient(pybullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._bullet, name)
        self.__dict__[name] = found  # looked up once: a step asks for a dozen of them
        return found

    def close(self) -> None:
        """End the server; closing twice does nothing."""
        if self._bullet is not None and self._bullet.isConnected():
            self._bullet.disconnect()

    def load_urdf(self, path: Path, T_world_base: pin.SE3, *, fixed: bool, flags: int = 0) -> int:
        """Load a URDF file and return its body number; ``BadAsset`` when PyBullet refuses it."""
        xyz, quaternion = bullet_pose(T_world_base)
        try:
            with quiet():
                return int(self._bullet.loadURDF(str(path), xyz, quaternion, useFixedBase=fixed, flags=flags))
        except self._bullet.error as error:
            raise BadAsset(path.stem, f"PyBullet cannot load {path}") from error


def bullet_pose(T: pin.SE3) -> tuple[list[float], list[float]]:
    """Position and xyzw quaternion, as PyBullet wants them."""
    values = [float(v) for v in pin.SE3ToXYZQUAT(T)]
    return values[:3], values[3:]


def from_bullet(xyz: Any, quaternion: Any) -> pin.SE3:
    """The pose of a PyBullet position and xyzw quaternion."""
    quaternion = np.asarray(quaternion, dtype=np.float64)
    return pin.XYZQUATToSE3(
        np.concatenate([np.asarray(xyz, dtype=np.float64), quaternion / np.linalg.norm(quaternion)])
    )


def joint_numbers(client: Client, body: int) -> tuple[dict[str, int], dict[str, int]]:
    """Joint numbers by joint name and link numbers by link name; the root link is -1."""
    joints: dict[str, int] = {}
    links = {client.getBodyInfo(body)[0].decode(): -1}
    for number in range(client.getNumJoints(body)):
        info = client.getJointInfo(body, number)
        joints[info[1].decode()] = number
        links[info[12].decode()] = number
    return joints, links
