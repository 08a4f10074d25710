"""Every number of the simulated physics, with where it comes from.

Object masses and joint resistances belong to the assets (``worlds/assets``), arm limits to the workcell file.
"""

from __future__ import annotations

GRAVITY = 9.81
"""Downward acceleration [m/s^2]."""

STEP = 1.0 / 240.0
"""Simulation step [s]; PyBullet's default, the rate used by VGN, GIGA and panda-gym."""

SOLVER_ITERATIONS = 150
"""Constraint solver iterations; VGN's value. Measured on held plates: slip 0.4 mm at 150, 4.7 mm at 10."""

PAD_FRICTION = 1.0
"""Lateral friction of the finger pads; rubber on plastic 0.8-1.2, PyBullet's panda.urdf says 1.0."""

PAD_SPINNING = 0.02
"""Spinning friction of a pad [m]: a patch of radius r resists a turn with 2/3 mu r N; r = 30 mm / 2 gives 0.01-0.02."""

PAD_ROLLING = 0.0005
"""Rolling friction of a pad [m]."""

PAD_STIFFNESS = 3.0e4
"""Contact stiffness of a pad [N/m], as in PyBullet's panda.urdf: 40 N press a rubber pad in by 1.3 mm."""

PAD_DAMPING = 1.0e3
"""Contact damping of a pad [N s/m], as in PyBullet's panda.urdf."""

OBJECT_FRICTION = 0.8
"""Lateral friction of objects; PyBullet multiplies the two bodies' values, so pad on object has 0.8."""

OBJECT_SPINNING = 0.005
"""Spinning friction of objects [m]."""

OBJECT_ROLLING = 0.001
"""Rolling friction of objects [m]; a full bottle on a desk comes to rest within a few turns."""

OBJECT_DAMPING = 0.04
"""Linear and angular damping of objects [1/s]; PyBullet's default."""

TABLE_FRICTION = 0.7
"""Lateral friction of the table top; with the object's 0.8 this gives 0.56 (plastic on wood 0.4-0.6)."""

GRIP_FORCE = 40.0
"""Force of one finger while holding [N]; the Franka Hand's continuous limit is 70 N."""

OPEN_FORCE = 20.0
"""Force limit of one finger while opening or holding still without an object [N]."""

FINGER_GEAR_FORCE = 50.0
"""Largest force of the gear that couples the two fingers [N]; the real hand has one motor (bullet3's Panda demo)."""

FINGER_GEAR_ERP = 0.1
"""Error reduction of the finger gear, from bullet3's Panda grasp demo."""

ARM_POSITION_GAIN = 0.3
"""Fraction of the joint position error corrected each step under position control."""

ARM_VELOCITY_GAIN = 1.0
"""Fraction of the joint velocity error corrected each step under position control."""

DROP_HEIGHT = 0.002
"""Gap between object and table when an episode begins [m]."""

SETTLE_LIMIT = 4.0
"""Longest time an object may take to come to rest before another pose is drawn [s]."""

SETTLE_DAMPING = 0.9
"""Linear and angular damping of the object while it settles [1/s]; back to ``OBJECT_DAMPING`` afterwards."""

REST_SPEED = 0.004
"""Below this linear [m/s] and ten times this angular speed [rad/s] an object counts as at rest."""

CAMERA_NEAR = 0.2
"""Near plane of the rendered cameras [m]."""

CAMERA_FAR = 3.0
"""Far plane of the rendered cameras [m]."""
