"""How does a hinged lid open? Its hinge lies along y at the lid's back, on the -x side; its front, at +x, rises."""

from __future__ import annotations

import numpy as np

from robots.spatial import Array
from worlds.assets.asset import FunctionalPart, JointPhysics
from worlds.assets.build import Joint

FRONT_FORCE = (3.0, 6.0)
"""Force that lifts the lid's front [N]; estimated: a thumb's push, child-resistant lids ask for far more."""

RANGE = (np.radians(100.0), np.radians(110.0))
"""How far a lid opens [rad]: past upright, where it stays by itself."""

OPENED = 0.7
"""Angle that counts as opened [rad]: the mouth is half clear."""

STANDOFF = 0.001
"""How far the hinge line stands off the back of the lid [m]."""


def hinge(rng: np.random.Generator, back: Array, depth: float) -> Joint:
    """The joint of a lid: the middle of its hinge line is ``back`` ``(3,)``, its front ``depth`` away from that [m].

    A right-hand turn about the joint axis opens.
    """
    return Joint(
        name="lid_joint",
        type="revolute",
        parent="body",
        child="lid",
        origin=back,
        axis=np.array([0.0, -1.0, 0.0]),
        lower=0.0,
        upper=rng.uniform(*RANGE),
        physics=JointPhysics(start=0.0, friction=rng.uniform(*FRONT_FORCE) * depth),
    )


def flip_part(joint: Joint) -> FunctionalPart:
    """The lid on ``joint`` as a part that is gripped by its two sides and turned open."""
    return FunctionalPart(
        kind="flip",
        link=joint.child,
        joint=joint.name,
        axis=joint.axis,
        point=joint.origin,
        sense=1.0,
        start=0.0,
        travel=joint.upper,
        threshold=OPENED,
        facing=np.array([0.0, 0.0, 1.0]),
    )
