"""Which pliers can be generated? Four kinds of spring-open ones: two crossing halves, a pivot, numbers from the index.

The pliers lie in the x-z plane, y is their thickness. The pivot is the origin; the handles reach towards +z, the fixed
one on the +x side, and the jaws towards -z, each on the other side of its handle. A half is drawn closed, at x > 0
above and at x < 0 below the pivot; the other half is its mirror image. The strap with which the moving half crosses
the pivot is seen but not touched: the boss of the fixed half fills the pivot's whole thickness.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robots.spatial import Array, frozen, rotation_about, unit
from worlds.assets.asset import Asset, FunctionalPart, JointPhysics
from worlds.assets.build import Design, Joint, Link, realise
from worlds.assets.solids import BULLET_MARGIN, Mesh, hull, merged
from worlds.assets.synthetic.series import Series, mixed, pastel

SERIES = Series("Pliers", count=25, seed=20_260_108)
"""As many as in the paper's table; the seed starts every instance's own generator."""


@dataclass(frozen=True, slots=True)
class _Kind:
    """Proportions of one kind of pliers.

    Attributes:
        length: Jaw tip to handle end [m].
        jaw: Pivot to jaw tip as a share of the length.
        root: Width of one closed jaw at the pivot [m].
        tip: Width of one closed jaw at its tip [m].
        bend: Turn of both jaws against the handles [rad].
        bow: Largest distance of a closed handle's inner edge from the middle [m].
    """

    length: tuple[float, float]
    jaw: tuple[float, float]
    root: tuple[float, float]
    tip: tuple[float, float]
    bend: tuple[float, float]
    bow: tuple[float, float]


KINDS = {
    "combination": _Kind((0.160, 0.200), (0.24, 0.28), (0.011, 0.013), (0.007, 0.009), (0.0, 0.0), (0.010, 0.015)),
    "needle-nose": _Kind((0.140, 0.190), (0.34, 0.40), (0.009, 0.011), (0.002, 0.003), (0.0, 0.0), (0.010, 0.015)),
    "cutting": _Kind((0.125, 0.180), (0.18, 0.22), (0.011, 0.014), (0.004, 0.005), (0.0, 0.0), (0.009, 0.013)),
    "water-pump": _Kind((0.175, 0.200), (0.24, 0.27), (0.010, 0.012), (0.008, 0.010), (0.45, 0.70), (0.006, 0.009)),
}
"""Combination, needle-nose and diagonal cutting pliers are sold from 125 to 200 mm, water-pump pliers from 180 mm."""

WIDTH, THICKNESS = (0.0095, 0.0150), (0.009, 0.013)
"""Of one handle [m]: a dipped steel handle is 9 mm wide, a two-component grip 15 mm or more."""

WEIGHT = (3800.0, 4800.0)
"""Mass over volume [kg/m^3]: a steel core (7850) in plastic grips (1100). Catalogues have 90 g for 125 mm cutters,
185 g for 160 mm and 240 g for 180 mm combination pliers."""

OPENING = (np.radians(18.0), np.radians(25.0))
"""Angle between the halves when the spring has opened them [rad]."""

SHUT = np.radians(3.0)
"""What is left of it at the end of the travel [rad]: the solids keep clear of each other."""

HANDLE_FORCE = (3.0, 6.0)
"""Force near the end of the handle [N]; estimated: the leaf springs of electronics pliers yield to two fingers."""

GAP = 2.0 * BULLET_MARGIN + 0.0007
"""Least distance between the halves [m]: the simulator's margins leave 0.7 mm."""

SPOT = 0.016
"""Distance of the pressed spot from the end of the handle [m]."""

CORNERS = 8
"""Corners of the boss around the pivot: two flats along the handles for fingers."""


def make(instance: str) -> Asset:
    """The pliers called ``instance``; ``UnknownName`` when there are none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    name = list(KINDS)[mixed(index, len(KINDS))]
    half, opening = _draw(KINDS[name], rng), rng.uniform(*OPENING)
    fixed = rotation_about([0.0, 1.0, 0.0], 0.5 * opening)
    moving = fixed.T @ np.diag([-1.0, 1.0, 1.0])
    bent = rotation_about([0.0, 1.0, 0.0], half.bend)
    inside = 0.5 * half.boss_radius
    body = (
        *(_turned(solid, fixed) for solid in half.handle(inside)),
        _turned(half.jaw_solid(inside), fixed @ bent),
        _turned(half.boss(), fixed),
    )
    handle = tuple(_turned(solid, moving) for solid in half.handle(half.clear))
    jaw = _turned(half.jaw_solid(half.clear), fixed.T @ bent @ np.diag([-1.0, 1.0, 1.0]))
    strap = _strap(handle[0], jaw, half.thick)
    point = moving @ half.spot()
    lever = float(np.hypot(point[0], point[2]))
    joint = Joint(
        name="handle_joint",
        type="revolute",
        parent="body",
        child="handle",
        origin=np.zeros(3),
        axis=np.array([0.0, 1.0, 0.0]),
        lower=0.0,
        upper=opening - SHUT,
        physics=JointPhysics(start=0.0, friction=rng.uniform(*HANDLE_FORCE) * lever),
    )
    density, colour = rng.uniform(*WEIGHT), pastel(rng)
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=name,
            split=SERIES.split(index),
            links=(
                Link("body", body, density, colour),
                Link("handle", (*handle, jaw), density, pastel(rng, dark=True), merged((*handle, jaw, strap))),
            ),
            joints=(joint,),
            part=FunctionalPart(
                kind="press",
                link="handle",
                joint=joint.name,
                axis=unit(np.cross(joint.axis, point)),
                point=point,
                sense=1.0,
                start=0.0,
                travel=joint.upper,
                threshold=0.5 * joint.upper,
                lever=lever,
            ),
            long_axis=np.array([0.0, 0.0, 1.0]),
        )
    )


@dataclass(frozen=True, slots=True)
class _Half:
    """One half as drawn: closed, handle at x > 0 and z > 0, jaw at x < 0 and z < 0.

    Attributes:
        thick: Thickness [m].
        boss_radius: Half width of the boss between its flats [m].
        reach: Pivot to the end of the handle [m].
        bow: Distance of the grip's inner edge from the middle [m].
        width: Width of the grip [m].
        jaw: Pivot to jaw tip [m].
        root: Width of the jaw at the pivot [m].
        tip: Width of the jaw at its tip [m].
        bend: As in ``_Kind``.
    """

    thick: float
    boss_radius: float
    reach: float
    bow: float
    width: float
    jaw: float
    root: float
    tip: float
    bend: float

    @property
    def clear(self) -> float:
        """Distance from the pivot at which the other half may begin [m]."""
        return self.boss_radius / float(np.cos(np.pi / CORNERS)) + GAP

    def handle(self, low: float) -> tuple[Mesh, ...]:
        """The neck, which leads outwards from a distance ``low`` [m], and the grip with its straight outer edge."""
        knee, end = self.clear + 0.26 * self.reach, self.reach
        slim = 0.75 * self.width
        outer = self.bow + self.width
        neck = [(0.5 * GAP, low), (0.5 * GAP + slim, low), (outer, knee), (self.bow, knee)]
        grip = [(self.bow, knee), (outer, knee), (outer, end - 0.004), (outer - 0.004, end)]
        grip += [(self.bow + 0.003, end), (self.bow, end - 0.004)]
        return _plate(neck, self.thick), _plate(grip, self.thick)

    def jaw_solid(self, low: float) -> Mesh:
        """The jaw from a distance ``low`` of the pivot [m], tapered towards its tip."""
        edge = 0.5 * GAP
        outline = [
            (-edge, -low),
            (-edge - self.root, -low),
            (-edge - self.root, -self.clear - 0.25 * (self.jaw - self.clear)),
        ]
        outline += [(-edge - self.tip, -self.jaw + 0.002), (-edge - 0.6 * self.tip, -self.jaw), (-edge, -self.jaw)]
        return _plate(outline, self.thick)

    def boss(self) -> Mesh:
        """The part of the fixed half around the pivot, thinner than the rest by the strap that crosses it."""
        angles = np.pi / CORNERS * (2.0 * np.arange(CORNERS) + 1.0)
        radius = self.boss_radius / np.cos(np.pi / CORNERS)
        return _plate([(radius * np.cos(a), radius * np.sin(a)) for a in angles], self.thick - 0.002)

    def spot(self) -> Array:
        """Where to press: on the outer edge of the grip, near its end."""
        return frozen([self.bow + self.width, 0.0, self.reach - SPOT])


def _draw(kind: _Kind, rng: np.random.Generator) -> _Half:
    length = rng.uniform(*kind.length)
    jaw = rng.uniform(*kind.jaw) * length
    root = rng.uniform(*kind.root)
    return _Half(
        thick=rng.uniform(*THICKNESS),
        boss_radius=rng.uniform(0.95, 1.1) * root,
        reach=length - jaw,
        bow=rng.uniform(*kind.bow),
        width=rng.uniform(*WIDTH),
        jaw=jaw,
        root=root,
        tip=rng.uniform(*kind.tip),
        bend=rng.uniform(*kind.bend),
    )


def _plate(outline: list[tuple[float, float]], thick: float) -> Mesh:
    """A convex plate with corners ``(x, z)`` [m], its edges bevelled."""
    flat = np.array(outline)
    middle = flat.mean(axis=0)
    inset = middle + 0.9 * (flat - middle)
    layers = [(inset, -0.5 * thick), (flat, -0.3 * thick), (flat, 0.3 * thick), (inset, 0.5 * thick)]
    return hull(np.concatenate([np.column_stack([xz[:, 0], np.full(len(xz), y), xz[:, 1]]) for xz, y in layers]))


def _turned(mesh: Mesh, R: Array) -> Mesh:
    return hull(mesh.vertices @ R.T)


def _strap(neck: Mesh, jaw: Mesh, thick: float) -> Mesh:
    """What is seen of the moving half over the pivot: a bar from the foot of its neck to the root of its jaw."""
    foot = neck.vertices[np.argsort(neck.vertices[:, 2])[:8]]
    root = jaw.vertices[np.argsort(-jaw.vertices[:, 2])[:8]]
    bar = np.concatenate([foot, root]) * np.array([1.0, 0.0, 1.0])
    return hull(np.concatenate([bar + np.array([0.0, side * 0.48 * thick, 0.0]) for side in (-1.0, 1.0)]))
