"""What an object model is once it can be simulated: a metric URDF, one functional part, and physical numbers."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from robots.spatial import Array, frozen

PartKind = Literal["pull", "unscrew", "press", "flip"]
"""How the functional part is operated."""

Split = Literal["seen", "unseen"]


@dataclass(frozen=True, slots=True, eq=False)
class FunctionalPart:
    """The part the primary arm operates, in the frame of the body link at the closed state.

    Attributes:
        kind: ``pull`` - slides outwards; ``unscrew`` - turns counter-clockwise seen from outside;
            ``press`` - moves inwards; ``flip`` - is gripped and turned open about a hinge.
        link: URDF link of the part.
        joint: URDF joint whose travel counts.
        axis: Unit vector ``(3,)``. pull, press: the direction in which operating moves the part where it is
            touched; unscrew: the turning axis, pointing out of the body (right-hand turn opens); flip: the hinge
            line's direction (right-hand turn opens).
        point: A point ``(3,)`` [m]. pull, unscrew: on the part's centre line; press: where to press, on the part's
            outer surface; flip: the middle of the hinge line.
        sense: +1.0 when operating increases the joint position, else -1.0.
        start: Joint position of the closed state [m] or [rad].
        travel: Motion available from the closed state in the operating sense [m] or [rad].
        threshold: Motion in the operating sense that counts as operated [m] or [rad].
        lever: Distance of ``point`` from the hinge line [m] when ``joint`` is revolute and ``kind`` is press,
            else 0.0. The linear motion at ``point`` is ``lever * angle``.
        facing: Unit vector ``(3,)`` from the closed part towards free space, along which it is approached; needed for
            flip, else it follows from the axis.
    """

    kind: PartKind
    link: str
    joint: str
    axis: Array
    point: Array
    sense: float
    start: float
    travel: float
    threshold: float
    lever: float = 0.0
    facing: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "axis", frozen(self.axis))
        object.__setattr__(self, "point", frozen(self.point))
        if self.facing is not None:
            object.__setattr__(self, "facing", frozen(self.facing))
        elif self.kind == "flip":
            raise ValueError(f"{self.link} flips open: say which way it faces when closed")
        for name in ("sense", "start", "travel", "threshold", "lever"):  # plain floats, which files can hold
            object.__setattr__(self, name, float(getattr(self, name)))

    @property
    def outward(self) -> Array:
        """Unit vector ``(3,)`` from the part towards free space."""
        if self.facing is not None:
            return self.facing
        return frozen(-self.axis) if self.kind == "press" else self.axis


@dataclass(frozen=True, slots=True)
class JointPhysics:
    """How one movable joint of the object resists.

    Attributes:
        start: Position at the beginning of an episode [m] or [rad].
        friction: Constant resistance: a force [N] for prismatic, a torque [N m] for turning joints.
    """

    start: float
    friction: float


@dataclass(frozen=True, slots=True, eq=False)
class Asset:
    """One object instance, ready to load.

    Attributes:
        source: ``synthetic``, ``partnet:DIR`` or ``mesh:DIR`` as given by the user.
        category: For example ``Bottle``.
        instance: Identifier within source and category.
        topology: Profile of the family, for example ``screw-cap``; for imported models their joint types.
        split: ``seen`` or ``unseen``.
        urdf: A metric, self-contained URDF: z-up in its own frame, root link ``body`` (the fixed body), every link
            with mass and inertia, convex collision shapes, absolute mesh file names. Lives in the cache.
        function: What to operate; ``None`` for an object that is only pushed, pressed or handed over.
        joints: Every movable joint of the URDF by name.
        long_axis: Unit vector ``(3,)`` in the body frame along the object's long axis, towards the functional end if
            there is one.
        mass: Total mass [kg].
        content_hash: Digest of everything above that shapes the physics, and of the mesh files.
        notes: What the importer had to supply or repair, one clause each.
    """

    source: str
    category: str
    instance: str
    topology: str
    split: Split
    urdf: Path
    function: FunctionalPart | None
    joints: dict[str, JointPhysics]
    long_axis: Array
    mass: float
    content_hash: str
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        object.__setattr__(self, "long_axis", frozen(self.long_axis))

    @property
    def part(self) -> FunctionalPart:
        """What to operate; ``ValueError`` when the object has no functional part."""
        if self.function is None:
            raise ValueError(f"{self.category} {self.instance} has no functional part")
        return self.function


@dataclass(frozen=True, slots=True)
class Rejected:
    """An object model that cannot be used, and why.

    Attributes:
        source: As in ``Asset``.
        category: As in ``Asset``.
        instance: As in ``Asset``.
        reason: One clause with numbers where there are any.
    """

    source: str
    category: str
    instance: str
    reason: str
