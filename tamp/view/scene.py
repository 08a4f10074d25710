"""A plan drawn in viser: arms, table, the observed object, the ways of the hands, and what was rejected."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from robots.model import arm_urdf_file
from robots.spatial import Array
from robots.workcell import SIDES, Side
from tamp.plan import Plan
from tamp.trace import Trace
from tamp.view.playback import Moment, Playback

if TYPE_CHECKING:
    import viser

ARM_COLOURS: dict[Side, tuple[int, int, int]] = {"left": (222, 226, 232), "right": (196, 206, 222)}
STAGE_COLOURS = ((66, 133, 244), (52, 168, 83), (251, 188, 4), (234, 67, 53), (171, 71, 188), (0, 172, 193))
REJECTED_SHOWN = 60
"""How many rejected hand poses are drawn."""

CLOUD_SHOWN = 4000
"""How many observed points are drawn."""


class PlanScene:
    """The drawn plan; ``show`` moves it to a time."""

    def __init__(
        self, server: viser.ViserServer, plan: Plan, cloud: Array, colours: Array, trace: Trace | None
    ) -> None:
        self.playback = Playback(plan, cloud)
        self._server, self._plan = server, plan
        self._links: list[tuple[Any, Side, int, pin.SE3]] = []
        self._shown: dict[int, bytes] = {}
        server.scene.set_up_direction("+z")
        self._cell()
        for side in SIDES:
            self._arm(side)
        keep = np.linspace(0, len(cloud) - 1, min(len(cloud), CLOUD_SHOWN)).astype(int)
        self._object = server.scene.add_frame("/object", axes_length=0.05, axes_radius=0.002)
        server.scene.add_point_cloud(
            "/object/cloud", (cloud - np.asarray(plan.T_world_object)[:3, 3])[keep].astype(np.float32),
            (255 * colours[keep]).astype(np.uint8), point_size=0.004, point_shape="circle",
        )  # fmt: skip
        self._labels = [self._way(number) for number in range(len(plan.stages))]
        if trace is not None:
            self._rejected(trace)

    def _cell(self) -> None:
        table = self._plan.workcell.table
        self._server.scene.add_box(
            "/table", (204, 194, 173), (*table.size, table.thickness),
            position=(*table.centre, table.top - table.thickness / 2),
        )  # fmt: skip
        for camera in self._plan.workcell.cameras:
            self._server.scene.add_label(f"/cameras/{camera.name}", f"camera {camera.name}", position=camera.eye)
        if (human := self._plan.workcell.human) is not None and self._plan.task == "handover":
            self._server.scene.add_box(
                "/human", (217, 166, 133), human.zone_size, wireframe=True, position=human.zone_centre
            )
            self._server.scene.add_label("/human/label", "human's reach", position=(0.0, 0.0, human.zone_size[2] / 2))

    def _arm(self, side: Side) -> None:
        urdf = str(arm_urdf_file(self._plan.workcell, side))
        self._models = getattr(self, "_models", {})
        model = pin.buildModelFromUrdf(urdf)
        self._models[side] = (model, model.createData())
        geometry = pin.buildGeomFromUrdf(model, urdf, pin.GeometryType.COLLISION)
        for number, shape in enumerate(geometry.geometryObjects):
            vertices, faces = _mesh(shape.geometry)
            handle = self._server.scene.add_mesh_simple(
                f"/{side}/{number}", vertices, faces, color=ARM_COLOURS[side], flat_shading=False
            )
            self._links.append((handle, side, int(shape.parentJoint), shape.placement.copy()))

    def _way(self, number: int) -> Any:
        """The path of the hand in one stage, and its label, which shows while the stage runs."""
        stage, way = self._plan.stages[number], self.playback.path(number)
        colour = STAGE_COLOURS[number % len(STAGE_COLOURS)]
        if np.linalg.norm(np.diff(way, axis=0), axis=1).sum() > 1e-3:
            lines = np.stack([way[:-1], way[1:]], axis=1).astype(np.float32)
            self._server.scene.add_line_segments(f"/ways/{number}_{stage.name}", lines, colour, thickness=0.002)
        text = f"{number + 1} {stage.name}: {stage.arm} arm ({stage.role})"
        return self._server.scene.add_label(
            f"/stage/{number}", text, position=(0.0, 0.0, 0.75), visible=False, anchor="center-center"
        )

    def _rejected(self, trace: Trace) -> None:
        poses = [
            np.array(rejection.approach).reshape(4, 4) for rejection in trace.rejections if rejection.approach
        ][:REJECTED_SHOWN]  # fmt: skip
        if not poses:
            return
        quaternions = [_wxyz(pin.SE3(T)) for T in poses]
        self._server.scene.add_batched_axes(
            "/rejected", np.array(quaternions), np.array([T[:3, 3] for T in poses]),
            axes_length=0.03, axes_radius=0.0008,
        )  # fmt: skip

    def show(self, t: float) -> Moment:
        """Put everything where it is at ``t`` [s]; only what has moved is sent."""
        moment = self.playback.at(t)
        for side in SIDES:
            model, data = self._models[side]
            pin.forwardKinematics(model, data, np.concatenate([moment.q[side], [moment.opening[side]] * 2]))
        for handle, side, joint, placement in self._links:
            self._put(handle, self._models[side][1].oMi[joint] * placement)
        self._put(self._object, moment.T_world_object)
        for number, label in enumerate(self._labels):
            if label.visible != (number == moment.stage):
                label.visible = number == moment.stage
        return moment

    def _put(self, handle: Any, T: pin.SE3) -> None:
        key = np.round(T.homogeneous, 5).tobytes()
        if self._shown.get(id(handle)) != key:
            self._shown[id(handle)] = key
            handle.wxyz, handle.position = _wxyz(T), tuple(float(v) for v in T.translation)


def _wxyz(T: pin.SE3) -> Array:
    """The rotation as the quaternion that viser wants."""
    x, y, z, w = pin.SE3ToXYZQUAT(T)[3:]
    return np.array([w, x, y, z])


def _mesh(geometry: Any) -> tuple[Array, Any]:
    """Vertices and triangles of a collision mesh of Pinocchio's."""
    vertices = np.asarray(geometry.vertices())
    count = geometry.num_tris if hasattr(geometry, "num_tris") else geometry.num_polygons
    triangle = geometry.tri_indices if hasattr(geometry, "tri_indices") else geometry.polygons
    faces = np.array([[triangle(k)[0], triangle(k)[1], triangle(k)[2]] for k in range(count)], dtype=np.uint32)
    return vertices, faces
