"""Laws of the compiled proofs against Coal, on a robot that brings every kind of joint and shape together."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest

from planners.compiled import layout as at
from planners.compiled.cell import Cell, Motion
from planners.compiled.robot import Robot, robot_of_shapes
from planners.compiled.tables import Shape

LOWER = np.array([-0.3, -0.3, -2.8, -2.8, -2.8, -2.8])
KINDS = (at.HULL, at.BOX, at.CYLINDER, at.POINT)


def random_pose(rng: np.random.Generator, spread: float) -> pin.SE3:
    return pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3) * spread)


def random_shape(rng: np.random.Generator, kind: int, joint: int, spread: float) -> Shape:
    T = random_pose(rng, spread)
    size = rng.uniform(0.02, 0.12, 3)
    if kind == at.HULL:
        return Shape("hull", joint, kind, T, rng.normal(size=(20, 3)) * size)
    if kind == at.CYLINDER:
        return Shape("cylinder", joint, kind, T, np.array([size[0], size[1], 0.0]))
    return Shape("solid", joint, kind, T, size if kind == at.BOX else np.zeros(3), 0.0 if kind == at.BOX else size[0])


def solid(shape: Shape) -> object:
    if shape.kind == at.HULL:
        points = coal.StdVec_Vec3s()
        for vertex in shape.size:
            points.append(vertex)
        return coal.Convex.convexHull(points, True, "Qt")
    if shape.kind == at.BOX:
        return coal.Box(*(2.0 * shape.size))
    if shape.kind == at.CYLINDER:
        return coal.Cylinder(shape.size[0], 2.0 * shape.size[1])
    return coal.Sphere(shape.radius)


class Twin:
    """The same robot and obstacles for the kernels and for Coal."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.model = pin.Model()
        joint = 0
        kinds = [pin.JointModelPX(), pin.JointModelPrismaticUnaligned(pin.exp3(rng.normal(size=3))[:, 0])]
        kinds += [pin.JointModelRY(), pin.JointModelRevoluteUnaligned(pin.exp3(rng.normal(size=3))[:, 1])]
        kinds += [pin.JointModelRX(), pin.JointModelRZ()]
        for k, kind in enumerate(kinds):
            bounds = (np.array([9.0]), np.array([9.0]), np.array([LOWER[k]]), np.array([-LOWER[k]]))
            joint = self.model.addJoint(joint, kind, random_pose(rng, 0.08), f"j{k}", *bounds)
        links = [random_shape(rng, kind, j, 0.05) for j, kind in zip((2, 4, 5, 6), KINDS, strict=True)]
        world = [random_shape(rng, kind, 0, 0.6) for kind in KINDS for _ in range(2)]
        held = random_shape(rng, at.HULL, 6, 0.1)
        self.shapes = [*links, *world, held]
        self_pairs = [(0, 3), (0, 2), (1, 3)]
        others = [(k, 4 + m) for k in range(4) for m in range(8)]
        carried = [(4 + m, 12) for m in range(8)] + [(0, 12)]
        self.pairs = [*self_pairs, *others, *carried]
        made: Robot = robot_of_shapes(self.model, links, self_pairs)
        self.motion: Motion = Cell(made, [*world, held], [*others, *carried]).motion(range(6), np.zeros(6))
        self.geometry = pin.GeometryModel()
        for k, shape in enumerate(self.shapes):
            thing = pin.GeometryObject(f"{shape.name}{k}", shape.joint, 0, shape.T_joint_shape, solid(shape))
            self.geometry.addGeometryObject(thing)
        for pair in self.pairs:
            self.geometry.addCollisionPair(pin.CollisionPair(*pair))
        self.data, self.geometry_data = self.model.createData(), self.geometry.createData()

    def distance(self, q: np.ndarray) -> float:
        pin.computeDistances(self.model, self.data, self.geometry, self.geometry_data, q)
        return min(float(result.min_distance) for result in self.geometry_data.distanceResults)

    def states(self, rng: np.random.Generator, count: int) -> np.ndarray:
        return rng.uniform(LOWER, -LOWER, (count, 6))


@pytest.fixture(scope="module", params=range(4))
def twin(request: pytest.FixtureRequest) -> Twin:
    return Twin(request.param)


def test_the_smallest_distance_is_where_the_verdict_turns(twin: Twin) -> None:
    rng, seen = np.random.default_rng(1), set()
    for q in twin.states(rng, 150):
        distance = twin.distance(q)
        if distance > 1e-3:
            assert twin.motion.states(q[None], distance - 2e-5)[0] == at.FREE
            assert twin.motion.states(q[None], distance + 2e-5)[0] != at.FREE
            assert twin.motion.states(q[None], distance + 1e-3)[0] == at.HIT
        elif distance < -1e-3:
            assert twin.motion.states(q[None])[0] == at.HIT
        seen.add(distance > 0.0)
    assert seen == {True, False}


def test_a_rake_judges_as_one_state_after_the_other(twin: Twin) -> None:
    q = twin.states(np.random.default_rng(2), 50)
    alone = [int(twin.motion.states(row[None], 0.01)[0] == at.FREE) for row in q]
    assert [int(v == at.FREE) for v in twin.motion.states(q, 0.01)] == alone


def test_whatever_lies_in_a_proven_cell_keeps_the_margin(twin: Twin) -> None:
    rng, proven = np.random.default_rng(3), 0
    centres = twin.states(rng, 400)
    plays = rng.uniform(0.0, 1.0, (400, 6)) * rng.choice([0.01, 0.1, 0.4], (400, 1))
    for verdict, centre, play in zip(twin.motion.cells(centres, plays, 0.004), centres, plays, strict=True):
        if verdict != at.FREE:
            continue
        proven += 1
        corners = centre + play * rng.choice([-1.0, 1.0], (12, 6)) * rng.choice([1.0, 0.6], (12, 1))
        assert all(twin.distance(q) > 0.004 - 1e-9 for q in corners)
    assert proven > 10


def test_a_proven_edge_keeps_the_margin_and_an_open_one_ends_somewhere(twin: Twin) -> None:
    rng, verdicts = np.random.default_rng(4), []
    for _ in range(40):
        a = twin.states(rng, 1)[0]
        b = a + rng.normal(size=6) * 0.3
        free = twin.motion.path(np.stack([a, b]), 0.002)[1] == at.FREE
        closest = min(twin.distance(a + s * (b - a)) for s in np.linspace(0.0, 1.0, 60))
        if free:
            assert closest > 0.002 - 1e-9
        else:
            fine = min(twin.distance(a + s * (b - a)) for s in np.linspace(0.0, 1.0, 500))
            assert fine < 0.002 + 4e-3
        verdicts.append(free)
    assert 0 < sum(verdicts) < 40


def test_slack_may_be_lost_between_centres_but_no_more(twin: Twin) -> None:
    rng, gained = np.random.default_rng(5), 0
    for _ in range(80):
        a = twin.states(rng, 1)[0]
        b = a + rng.normal(size=6) * 0.2
        strict, loose = (twin.motion.path(np.stack([a, b]), 0.004, slack)[1] == at.FREE for slack in (0.0, 0.002))
        assert loose or not strict
        gained += loose
        if loose:
            assert min(twin.distance(a + s * (b - a)) for s in np.linspace(0.0, 1.0, 200)) > 0.002 - 1e-9
    assert gained > 3


def test_joints_that_rest_are_where_they_rest(twin: Twin) -> None:
    rng = np.random.default_rng(6)
    rest = twin.states(rng, 1)[0]
    cell_motion = Motion(twin.motion.tables, rest, np.array([3, 5], dtype=np.int32))
    for q in twin.states(rng, 30):
        whole = rest.copy()
        whole[[3, 5]] = q[[3, 5]]
        assert (cell_motion.states(q[None, [3, 5]])[0] == at.FREE) == (twin.motion.states(whole[None])[0] == at.FREE)


def test_paths_are_proven_repeatable_and_never_longer_after_shortening(twin: Twin) -> None:
    rng = np.random.default_rng(7)
    states = twin.states(rng, 200)
    free = states[twin.motion.states(states, 0.002) == at.FREE][:12]
    bounds = np.stack([LOWER, -LOWER])
    for pair in free.reshape(-1, 2, free.shape[1]):
        found, again = (
            twin.motion.connect(pair[0], pair[1:], bounds, seed=3, margin=0.002, samples=20_000) for _ in range(2)
        )
        assert np.array_equal(found.points, again.points)
        if len(found.points):
            break
    assert len(found.points), "none of six pairs of free states was connected in 20 000 samples"
    assert np.array_equal(found.points[[0, -1]], pair)
    assert twin.motion.path(found.points, 0.002) == (len(found.points) - 1, at.FREE)
    short = twin.motion.shorten(found.points, seed=1, margin=0.002)
    assert np.array_equal(short[[0, -1]], pair)
    assert twin.motion.path(short, 0.002)[1] == at.FREE
    length = [np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p in (found.points, short)]
    assert length[1] <= length[0] + 1e-9


def test_an_enclosed_robot_finds_no_path_at_once_and_an_empty_world_needs_no_samples(twin: Twin) -> None:
    bare = Cell(robot_of_shapes(twin.model, twin.shapes[:4], []), [], []).motion(range(6), np.zeros(6))
    ends = twin.states(np.random.default_rng(8), 2)
    found = bare.connect(ends[0], ends[1:], np.stack([LOWER, -LOWER]), seed=0)
    assert found.samples == 0
    assert len(found.points) == 2
    box = Shape("wall", 0, at.BOX, pin.SE3.Identity(), np.full(3, 2.0))
    walled = Cell(robot_of_shapes(twin.model, twin.shapes[:4], []), [box], [(k, 4) for k in range(4)])
    motion = walled.motion(range(6), np.zeros(6))
    assert (motion.states(ends) == at.HIT).all()
    assert len(motion.connect(ends[0], ends[1:], np.stack([LOWER, -LOWER]), seed=0, samples=500).points) == 0
