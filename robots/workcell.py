"""What stands in the cell: two arms, their grippers, the table and the cameras, read from one TOML file."""

from __future__ import annotations

import difflib
import importlib.util
import math
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal, get_args

import msgspec
from msgspec import Meta, Struct

from robots.errors import BadWorkcell, UnknownName

Side = Literal["left", "right"]
"""One of the two arms, by where it stands; never a role."""

SIDES: tuple[Side, Side] = get_args(Side)

Vec3 = tuple[float, float, float]
Vec7 = tuple[float, float, float, float, float, float, float]
Positive = Annotated[float, Meta(gt=0.0)]
Positive7 = tuple[Positive, Positive, Positive, Positive, Positive, Positive, Positive]
Names7 = tuple[str, str, str, str, str, str, str]


class Described(Struct, frozen=True, forbid_unknown_fields=True):
    """Base of every part of a workcell file: immutable, and strict about unknown keys."""


class Gripper(Described, frozen=True, kw_only=True):
    """A parallel gripper with two fingers that move together."""

    hand_link: str
    """Link whose frame has z along the approach and y along the opening."""
    finger_links: tuple[str, str]
    """The finger that opens towards +y of the hand, then the one towards -y."""
    finger_joints: tuple[str, str]
    """Their prismatic joints, in the same order."""
    finger_travel: Positive
    """Opening of one finger from closed to open [m]."""
    finger_velocity: Positive
    """Largest finger velocity [m/s]."""
    force_limit: Positive
    """Largest force of one finger [N]."""
    tcp_offset: Positive
    """Hand frame to the tool centre point between the finger pads, along z [m]."""
    tip_offset: Positive
    """Hand frame to the very end of the fingers, along z [m]."""


class ArmModel(Described, frozen=True, kw_only=True):
    """A kind of arm: seven joints, their limits and where those limits come from."""

    urdf: str
    """A path beside the workcell file, or ``package:path`` inside an installed Python package."""
    base_link: str
    joints: Names7
    lower: Vec7
    """Lower joint limits [rad]."""
    upper: Vec7
    """Upper joint limits [rad]."""
    velocity: Positive7
    """Joint velocity limits [rad/s]."""
    acceleration: Positive7
    """Joint acceleration limits [rad/s^2]."""
    torque: Positive7
    """Joint torque limits [N m]."""
    limits_source: str
    """The document the limits were read from."""
    gripper: Gripper

    def __post_init__(self) -> None:
        for name, low, high in zip(self.joints, self.lower, self.upper, strict=True):
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise ValueError(f"{name}: lower limit {low} rad is not below upper limit {high} rad")


class ArmPlacement(Described, frozen=True, kw_only=True):
    """Where one arm stands and how it waits."""

    model: str
    """A key of ``Workcell.models``."""
    base_xyz: Vec3
    """Base position in the world frame [m]."""
    base_rpy: Vec3 = (0.0, 0.0, 0.0)
    """Base orientation, roll, pitch, yaw about fixed axes [rad]."""
    home: Vec7
    """Waiting configuration, out of the cameras' view [rad]."""


class Arms(Described, frozen=True, kw_only=True):
    """The two arms."""

    left: ArmPlacement
    right: ArmPlacement


class Table(Described, frozen=True, kw_only=True):
    """A rectangular table top; its upper face is at ``top``."""

    centre: tuple[float, float]
    """Centre of the top, x and y in the world frame [m]."""
    size: tuple[Positive, Positive]
    """Full extents along x and y [m]."""
    top: float
    """Height of the upper face in the world frame [m]."""
    thickness: Positive
    """Thickness of the top [m]."""


class Camera(Described, frozen=True, kw_only=True):
    """A pinhole RGB-D camera."""

    name: str
    eye: Vec3
    """Position in the world frame [m]."""
    target: Vec3
    """A point on the optical axis, in the world frame [m]."""
    up: Vec3 = (0.0, 0.0, 1.0)
    width: Annotated[int, Meta(ge=16, le=4096)]
    """Image width [pixel]."""
    height: Annotated[int, Meta(ge=16, le=4096)]
    """Image height [pixel]."""
    fov_deg: Annotated[float, Meta(gt=1.0, lt=170.0)]
    """Vertical field of view [deg]."""


class Human(Described, frozen=True, kw_only=True):
    """Where a human takes objects from the arms."""

    zone_centre: Vec3
    """Middle of the reach zone in the world frame [m]."""
    zone_size: tuple[Positive, Positive, Positive]
    """Full extents of the reach zone along x, y and z [m]."""
    towards: Vec3
    """Horizontal direction from the zone to the human."""

    def __post_init__(self) -> None:
        if self.towards[2] != 0.0 or math.hypot(*self.towards) < 1e-6:
            raise ValueError(f"human.towards {self.towards} is not a horizontal direction")


class Workcell(Described, frozen=True, kw_only=True):
    """Everything in the cell that does not change between episodes."""

    name: str
    floor: float
    """Height of the floor in the world frame [m]."""
    models: dict[str, ArmModel]
    arms: Arms
    table: Table
    shared: Vec3
    """Middle of the space where both arms work on a held object [m]; objects start on the table below it."""
    cameras: Annotated[tuple[Camera, ...], Meta(min_length=1)]
    human: Human | None = None
    """Where a human stands; needed for handovers only."""

    def __post_init__(self) -> None:
        for side in SIDES:
            model = self.placement(side).model
            if model not in self.models:
                raise ValueError(f'arms.{side}.model "{model}" is not among models: {", ".join(self.models)}')
            self._check_home(side)
        if self.table.top - self.table.thickness < self.floor:
            raise ValueError("the table top reaches below the floor")

    def _check_home(self, side: Side) -> None:
        arm = self.arm(side)
        for joint, value, low, high in zip(arm.joints, self.placement(side).home, arm.lower, arm.upper, strict=True):
            if not low <= value <= high:
                raise ValueError(f"arms.{side}.home: {joint} = {value} rad is outside [{low}, {high}] rad")

    def placement(self, side: Side) -> ArmPlacement:
        """Where the arm on ``side`` stands."""
        return self.arms.left if side == "left" else self.arms.right

    def arm(self, side: Side) -> ArmModel:
        """What kind of arm stands on ``side``."""
        return self.models[self.placement(side).model]


def other(side: Side) -> Side:
    """The opposite side."""
    return "right" if side == "left" else "left"


def workcell_names() -> list[str]:
    """Names of the workcells that ship with the project."""
    folder = resources.files("robots") / "workcells"
    return sorted(Path(entry.name).stem for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_workcell(name_or_file: str) -> Workcell:
    """The workcell of a shipped name or of a TOML file.

    Raises:
        UnknownName: Neither a shipped name nor an existing file.
        BadWorkcell: The file is not valid; the message names the key and the reason.
    """
    if name_or_file in workcell_names():
        text = (resources.files("robots") / "workcells" / f"{name_or_file}.toml").read_text("utf-8")
        return parse_workcell(text, name_or_file)
    path = Path(name_or_file)
    if path.suffix != ".toml":
        raise UnknownName("workcell", name_or_file, workcell_names())
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BadWorkcell(f"Workcell file {path} cannot be read: {error}") from error
    return parse_workcell(text, str(path))


def parse_workcell(text: str, origin: str) -> Workcell:
    """The workcell that TOML ``text`` describes; ``origin`` names it in error messages."""
    try:
        return msgspec.toml.decode(text, type=Workcell)
    except msgspec.ValidationError as error:
        raise BadWorkcell(f"Workcell {origin}: {error}{_near_key(str(error))}") from error
    except msgspec.DecodeError as error:
        raise BadWorkcell(f"Workcell {origin} is not valid TOML: {error}") from error


def _near_key(message: str) -> str:
    """A did-you-mean for msgspec's unknown-field message."""
    if "unknown field" not in message:
        return ""
    given = message.split("`")[1]
    known = {
        field
        for part in (Workcell, Arms, ArmPlacement, ArmModel, Gripper, Table, Camera, Human)
        for field in part.__struct_fields__
    }
    near = difflib.get_close_matches(given, known, n=1)
    return f'. Did you mean "{near[0]}"?' if near else f". Known keys: {', '.join(sorted(known))}."


def urdf_file(model: ArmModel, beside: Path | None = None) -> Path:
    """The URDF file of an arm model.

    Raises:
        BadWorkcell: The package or file does not exist.
    """
    package, _, inside = model.urdf.rpartition(":")
    if package:
        spec = importlib.util.find_spec(package)
        if spec is None or not spec.submodule_search_locations:
            raise BadWorkcell(f"Arm URDF {model.urdf}: the Python package {package} is not installed.")
        path = Path(spec.submodule_search_locations[0]) / inside
    else:
        path = (beside or Path.cwd()) / inside
    if not path.is_file():
        raise BadWorkcell(f"Arm URDF {path} does not exist.")
    return path
