"""Laws of the imported staplers, pliers, pens, USB sticks, laptops, remotes and windows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robots.errors import BadAsset
from robots.spatial import pose
from worlds.assets.asset import Asset, Rejected
from worlds.assets.everyday import EVERYDAY, MOST_MASS
from worlds.assets.library import load, survey
from worlds.assets.mobility import Mobility, MovingJoint
from worlds.assets.shape import collision_vertices
from worlds.assets.solids import Mesh, box
from worlds.assets.weld import displacement, minor, posed, welded
from worlds.bullet.client import Client, joint_numbers

PARTNET = Path(__file__).parents[3] / "shared/assets/objects/partnet_mobility"
SOURCE = f"partnet:{PARTNET}"
needs_partnet = pytest.mark.skipif(not PARTNET.is_dir(), reason=f"no folder {PARTNET}")

OPERATED = {
    "Stapler": ("102990", "103100", "103104", "103275", "103283", "103307"),
    "Pliers": ("100705", "102074"),
    "USB": ("100061",),
    "Pen-Cap": ("102939",),
}
"""The real models with a functional part that are usable."""

REFUSED = {
    ("Pliers", "100142"): "no flat spot",
    ("USB", "100109"): r"none of its moving parts is a lid .* it has: usb_rotation \(continuous\)",
    ("Pen-Button", "102939"): "its cap slides off by 37 mm: it is a pen with a cap, see Pen-Cap",
}

EDGE = {"Keyboard": 1, "Laptop": 8, "Remote": 1, "Scissors": 3, "Switch": 4, "Window": 3}
"""How many real models there are of each category that is only pushed and lifted; all are usable."""


def obj(mesh: Mesh) -> str:
    rows = [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
    return "\n".join(rows + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces])


def write(root: Path, category: str, parts: dict[str, tuple[Mesh, str, str]], joints: str) -> str:
    """A PartNet-Mobility folder of boxes: raw mesh, semantics and name by link; the body is ``link_9``."""
    folder = root / category / "1"
    (folder / "textured_objs").mkdir(parents=True)
    links, semantics = ['<link name="base"/>'], []
    for link, (mesh, kind, name) in parts.items():
        (folder / f"textured_objs/{link}.obj").write_text(obj(mesh))
        shape = f'<visual><geometry><mesh filename="textured_objs/{link}.obj"/></geometry></visual>'
        links.append(f'<link name="{link}">{shape}</link>')
        semantics.append(f"{link} {kind} {name}")
    (folder / "semantics.txt").write_text("\n".join(semantics))
    turn = '<origin rpy="1.570796326794897 0 -1.570796326794897"/>'
    joints += f'<joint name="joint_9" type="fixed"><parent link="base"/><child link="link_9"/>{turn}</joint>'
    (folder / "mobility.urdf").write_text(f'<robot name="r">{"".join(links)}{joints}</robot>')
    return f"partnet:{root}"


def hinge(child: str, at: str, axis: str, low: float, high: float, number: int = 0) -> str:
    inside = f'<origin xyz="{at}"/><axis xyz="{axis}"/><limit lower="{low}" upper="{high}"/>'
    return (
        f'<joint name="joint_{number}" type="revolute"><parent link="link_9"/><child link="{child}"/>{inside}</joint>'
    )


def laptop(root: Path, low: float, high: float) -> str:
    """A base 1.4 wide and 1 deep, a screen standing at its back edge; raw axes: x across, y up, z to the front."""
    screen = box((1.4, 1.0, 0.05), (0.0, 0.55, 0.0))
    parts = {
        "link_0": (screen, "hinge", "screen"),
        "link_9": (box((1.4, 0.06, 1.0), (0.0, 0.0, 0.5)), "free", "laptop_base"),
    }
    return write(root, "Laptop", parts, hinge("link_0", "0 0.05 0", "1 0 0", low, high))


def pushed(asset: Asset, newtons: float) -> float:
    """Motion of the functional joint in its sense after a second of a force at the functional point."""
    part = asset.part
    client = Client()
    try:
        client.setPhysicsEngineParameter(numSolverIterations=150)
        body = client.load_urdf(asset.urdf, pose((0.0, 0.0, 0.0)), fixed=True, flags=client.URDF_USE_INERTIA_FROM_FILE)
        joints, links = joint_numbers(client, body)
        for name, joint in asset.joints.items():
            client.resetJointState(body, joints[name], joint.start)
            client.setJointMotorControl2(
                body, joints[name], client.VELOCITY_CONTROL, targetVelocity=0.0, force=joint.friction
            )
        link = links[part.link]
        client.changeDynamics(body, link, jointDamping=0.0)
        for _ in range(240):
            at = part.point if part.lever else client.getLinkState(body, link)[0]
            client.applyExternalForce(body, link, list(newtons * part.axis), list(at), client.WORLD_FRAME)
            client.stepSimulation()
        return float(part.sense * (client.getJointState(body, joints[part.joint])[0] - part.start))
    finally:
        client.close()


def size(asset: Asset) -> np.ndarray:
    return np.asarray(np.ptp(np.concatenate(list(collision_vertices(asset).values())), axis=0))


def test_displacement_turns_about_the_hinge_line_and_stacks() -> None:
    lever = MovingJoint("a", "revolute", "base", "arm", np.array([1.0, 0, 0]), np.array([0.0, 0, 1]), 0.0, 3.0)
    slide = MovingJoint("b", "prismatic", "arm", "tip", np.zeros(3), np.array([1.0, 0, 0]), 0.0, 1.0)
    shapes = {"base": (box((1, 1, 1), (0, 0, 0)),), "arm": (), "tip": (box((0.1, 0.1, 0.1), (2, 0, 0)),)}
    model = Mobility("m", shapes, {"arm": lever, "tip": slide}, {})
    T = displacement(model, "tip", {"a": np.pi / 2, "b": 0.5})
    assert T.act(np.array([1.0, 0.0, 0.0])) == pytest.approx([1.0, 0.5, 0.0])
    assert len(posed(model, {})) == 16


def test_small_links_are_welded_where_they_rest_and_large_ones_stay() -> None:
    door = MovingJoint("d", "revolute", "base", "door", np.zeros(3), np.array([0.0, 0, 1]), 0.0, 1.0)
    knob = MovingJoint("k", "prismatic", "door", "knob", np.zeros(3), np.array([0.0, 0, 1]), 0.3, 0.4)
    shapes = {
        "base": (box((2, 2, 0.1), (0, 0, 0)),),
        "door": (box((1, 1, 0.1), (0, 0, 0)),),
        "knob": (box((0.1, 0.1, 0.1), (0, 0, 0)),),
    }
    model = Mobility("m", shapes, {"door": door, "knob": knob}, {"knob": ("slider", "button")})
    assert minor(model) == {"knob"}
    smaller, [note] = welded(model, {"knob"})
    assert note == "1 moving parts fixed in place (button)"
    assert set(smaller.joints) == {"door"}
    assert len(smaller.meshes["door"]) == 2
    assert smaller.meshes["door"][1].vertices[:, 2].mean() == pytest.approx(0.3)


@pytest.mark.parametrize(("low", "high"), [(-0.3, np.pi / 2), (0.0, np.pi / 2), (-np.pi / 2, np.pi / 2)])
def test_laptop_starts_shut_whatever_its_hinge_allows(tmp_path: Path, low: float, high: float) -> None:
    asset = load(laptop(tmp_path, low, high), "Laptop", "1")
    assert asset.function is None
    assert asset.joints["joint_0"].start == pytest.approx(np.pi / 2, abs=0.06)
    assert size(asset).max() == pytest.approx(EVERYDAY["Laptop"].size, rel=0.03)
    assert size(asset).min() < 0.04
    assert asset.mass <= MOST_MASS + 1e-9


def test_laptop_that_does_not_shut_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadAsset, match=r"shut, it is still \d+ % as thick as long, more than 35 %"):
        load(laptop(tmp_path, -0.2, 0.1), "Laptop", "1")


def test_remote_keeps_no_joint_for_its_buttons_and_lies_on_its_back(tmp_path: Path) -> None:
    parts = {"link_9": (box((0.5, 2.0, 0.2), (0.0, 0.0, 0.0)), "free", "remote_base")}
    joints = ""
    for number in range(3):
        parts[f"link_{number}"] = (box((0.1, 0.1, 0.05), (0.0, 0.3 * number, 0.12)), "slider", "button")
        joints += hinge(f"link_{number}", "0 0 0", "1 0 0", 0.0, 0.1, number)
    asset = load(write(tmp_path, "Remote", parts, joints), "Remote", "1")
    assert asset.joints == {}
    assert "3 moving parts fixed in place (button)" in asset.notes
    assert size(asset) == pytest.approx(0.085 * np.array([2.0, 0.5, 0.245]), rel=0.01)
    body = asset.urdf.parent / "body_visual.obj"
    rows = [row.split()[1:] for row in body.read_text().splitlines() if row.startswith("v ")]
    vertices = np.array([[float(word) for word in row] for row in rows])
    top = vertices[vertices[:, 2] > vertices[:, 2].max() - 1e-6]
    assert np.abs(top[:, 1]).max() < 0.01  # only the buttons, which face the front, are that narrow


def test_stapler_without_an_arm_is_refused(tmp_path: Path) -> None:
    parts = {
        "link_0": (box((0.2, 0.2, 1.5), (0.0, 0.3, 0.0)), "hinge", "wheel"),
        "link_9": (box((0.3, 0.1, 1.8), (0.0, 0.0, 0.0)), "free", "stapler_base"),
    }
    source = write(tmp_path, "Stapler", parts, hinge("link_0", "0 0.3 -0.8", "1 0 0", -0.2, 0.5))
    with pytest.raises(BadAsset, match="none of its parts is an arm"):
        load(source, "Stapler", "1")


def stapler(root: Path, low: float, high: float) -> Asset:
    """A base and an arm hinged at their back (raw -z); a positive turn about raw x presses the front down."""
    parts = {
        "link_0": (box((0.3, 0.2, 1.6), (0.0, 0.1, 0.8)), "hinge", "lid"),
        "link_9": (box((0.3, 0.1, 1.8), (0.0, -0.3, 0.0)), "free", "stapler_base"),
    }
    source = write(root, "Stapler", parts, hinge("link_0", "0 0.1 -0.8", "1 0 0", low, high))
    return load(source, "Stapler", "1")


def test_stapler_is_pressed_down_at_its_front(tmp_path: Path) -> None:
    asset = stapler(tmp_path, -1.0, 0.2)
    part = asset.part
    assert (part.kind, part.sense, part.start, part.travel) == ("press", 1.0, 0.0, pytest.approx(0.2))
    assert part.axis == pytest.approx([0.0, 0.0, -1.0], abs=0.15)
    assert part.point[0] < -0.03  # the front of a PartNet model faces -x
    assert part.lever > 0.1
    resistance = asset.joints[part.joint].friction / part.lever
    assert pushed(asset, 0.6 * resistance) < 0.1 * part.travel
    assert pushed(asset, 1.6 * resistance) > part.threshold


def test_stapler_modelled_shut_is_opened_first(tmp_path: Path) -> None:
    asset = stapler(tmp_path, -1.0, 0.01)
    assert asset.part.start < -0.05
    assert asset.part.lever * asset.part.travel == pytest.approx(0.014, rel=0.1)
    assert any("before it is pressed" in note for note in asset.notes)


@needs_partnet
@pytest.mark.parametrize(("category", "instance"), [("USB", "100061"), ("Pen-Cap", "102939"), ("Stapler", "103100")])
def test_a_real_part_gives_way_above_its_resistance_and_not_below(category: str, instance: str) -> None:
    check_gives_way(load(SOURCE, category, instance))


@needs_partnet
@pytest.mark.parametrize(("category", "instance"), REFUSED)
def test_real_models_of_another_kind_say_so(category: str, instance: str) -> None:
    with pytest.raises(BadAsset, match=REFUSED[category, instance]):
        load(SOURCE, category, instance)


@needs_partnet
@pytest.mark.slow
@pytest.mark.parametrize("category", OPERATED)
def test_every_real_part_gives_way(category: str) -> None:
    usable = [found for found in survey(SOURCE, category) if isinstance(found, Asset)]
    assert tuple(asset.instance for asset in usable) == OPERATED[category]
    for asset in usable:
        check_gives_way(asset)


def check_gives_way(asset: Asset) -> None:
    part = asset.part
    assert np.linalg.norm(part.axis) == pytest.approx(1.0)
    assert 0.0 < part.threshold < part.travel
    resistance = asset.joints[part.joint].friction / (part.lever or 1.0)
    assert pushed(asset, 0.6 * resistance) < 0.15 * part.travel
    assert pushed(asset, 1.6 * resistance) > part.threshold


@needs_partnet
@pytest.mark.slow
@pytest.mark.parametrize("category", EDGE)
def test_every_real_flat_object_fits_table_and_hand(category: str) -> None:
    found = survey(SOURCE, category)
    assert len(found) == EDGE[category]
    assert not [refusal for refusal in found if isinstance(refusal, Rejected)]
    for asset in found:
        assert isinstance(asset, Asset)
        assert asset.function is None
        assert size(asset).max() < 0.42
        assert size(asset).min() < 0.072
        assert 0.01 < asset.mass <= MOST_MASS + 1e-9
        assert len(asset.joints) <= 1
