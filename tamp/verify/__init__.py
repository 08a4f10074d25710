"""Whether a saved plan is right, checked without any of the code that made it.

Its own rules of what each stage may do, its own curves (SciPy's Hermite splines), its own kinematics and contacts
(PyBullet's), and the asset's true geometry at its true pose, against the limits and contacts that the plan claims.
"""

from __future__ import annotations

from tamp.verify.check import verify
from tamp.verify.found import Kind, Verification, Violation

__all__ = ["Kind", "Verification", "Violation", "verify"]
