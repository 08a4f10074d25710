"""Laws of the PartNet-Mobility importer, on a tiny hand-written model and on the real ones where they are."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from robots.errors import BadAsset, UnknownName
from worlds.assets.asset import Asset, Rejected
from worlds.assets.convex import convex_parts, solidity
from worlds.assets.library import load, names, survey
from worlds.assets.solids import Mesh, box, merged, volume

PARTNET = Path(__file__).parents[3] / "shared/assets/objects/partnet_mobility"
SOURCE = f"partnet:{PARTNET}"
needs_partnet = pytest.mark.skipif(not PARTNET.is_dir(), reason=f"no folder {PARTNET}")


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("BIPRE_CACHE", str(tmp_path / "cache"))
    return tmp_path / "models"


def obj(size: tuple[float, float, float], centre: tuple[float, float, float]) -> str:
    mesh = box(size, centre)
    rows = [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
    rows += [f"f {a + 1}/1 {b + 1}/2 {c + 1}//3" for a, b, c in mesh.faces]
    return "\n".join(rows)


def joint(name: str, kind: str, parent: str, child: str, inside: str = "") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>'


def link(name: str, meshes: Iterable[str] = ()) -> str:
    shapes = (f'<visual><geometry><mesh filename="textured_objs/{mesh}"/></geometry></visual>' for mesh in meshes)
    return f'<link name="{name}">{"".join(shapes)}</link>'


UP = '<axis xyz="0 1 0"/>'
TURN = '<origin rpy="1.570796326794897 0 -1.570796326794897"/>'


def write(
    root: Path,
    limits: tuple[float, float] = (-0.02, 0.0),
    lid: tuple[float, float, float] = (0.3, 0.2, 0.3),
    spin: str = "continuous",
    category: str = "Bottle",
) -> Path:
    """A y-up box of 0.4 x 1.2 x 0.4 with a box for a lid on top, in the original layout."""
    folder = root / category / "4711"
    (folder / "textured_objs").mkdir(parents=True)
    (folder / "textured_objs/body.obj").write_text(obj((0.4, 1.2, 0.4), (0.0, 0.0, 0.0)))
    (folder / "textured_objs/lid.obj").write_text(obj(lid, (0.0, 0.6 + 0.5 * lid[1], 0.0)))
    (folder / "semantics.txt").write_text("link_0 slider+ rotation_lid\nlink_1 free body\n")
    slide = f'{UP}<limit lower="{limits[0]}" upper="{limits[1]}"/>'
    parts = [
        link("base"),
        link("link_0", ["lid.obj"]),
        joint("joint_0", spin, "link_0_helper", "link_0", UP),
        link("link_1", ["body.obj"]),
        joint("joint_1", "fixed", "base", "link_1", TURN),
        link("link_0_helper"),
        joint("joint_2", "prismatic", "link_1", "link_0_helper", slide),
    ]
    (folder / "mobility.urdf").write_text(f'<?xml version="1.0"?><robot name="r">{"".join(parts)}</robot>')
    return folder


def made(root: Path, category: str = "Bottle") -> Asset:
    return load(f"partnet:{root}", category, "4711")


def test_narrow_slide_is_unscrewed_from_its_lower_end(root: Path) -> None:
    write(root, limits=(-0.02, 0.0))
    asset = made(root)
    scale = 0.22 / 1.4
    assert (asset.part.kind, asset.part.link, asset.part.joint) == ("unscrew", "link_0", "joint_0")
    assert asset.part.axis == pytest.approx([0.0, 0.0, 1.0])
    assert asset.part.threshold == pytest.approx(np.pi / 2)
    assert asset.joints["joint_2"].start == pytest.approx(-0.02 * scale)
    assert asset.part.point == pytest.approx([0.0, 0.0, scale * (0.7 - 0.02)], abs=1e-3)


def test_wide_slide_is_pulled_and_limits_scale(root: Path) -> None:
    write(root, limits=(-0.1, 0.0))
    asset = made(root)
    assert (asset.part.kind, asset.part.link, asset.part.joint) == ("pull", "link_0", "joint_2")
    assert asset.part.travel == pytest.approx(0.1 * 0.22 / 1.4)
    assert asset.part.start == pytest.approx(-asset.part.travel)
    assert asset.joints["joint_0"].friction > 0.0


def test_wide_object_is_narrowed_to_the_hand(root: Path) -> None:
    folder = write(root)
    (folder / "textured_objs/body.obj").write_text(obj((0.6, 1.2, 0.9), (0.0, 0.0, 0.0)))
    assert "70 mm narrow" in made(root).notes[0]


def test_dispenser_is_pressed_from_its_upper_end(root: Path) -> None:
    write(root, limits=(-0.1, 0.0), category="Dispenser")
    asset = made(root, "Dispenser")
    scale = 0.19 / 1.4
    assert asset.part.kind == "press"
    assert asset.part.axis == pytest.approx([0.0, 0.0, -1.0])
    assert asset.part.sense == -1.0
    assert asset.part.start == pytest.approx(0.0)
    assert asset.part.travel == pytest.approx(0.1 * scale)
    assert asset.part.point == pytest.approx([0.0, 0.0, 0.8 * scale], abs=2e-3)


def test_zero_outside_the_limits_is_not_the_start(root: Path) -> None:
    write(root, limits=(-0.1, -0.05))
    assert made(root).joints["joint_2"].start == pytest.approx(-0.1 * 0.22 / 1.4)


def test_same_folder_gives_the_same_bytes(root: Path) -> None:
    write(root)
    first = made(root)
    bytes_before = {path.name: path.read_bytes() for path in first.urdf.parent.iterdir()}
    first.urdf.unlink()
    second = made(root)
    assert {path.name: path.read_bytes() for path in second.urdf.parent.iterdir()} == bytes_before
    assert first.content_hash == second.content_hash


def test_changed_geometry_or_physics_changes_the_hash(root: Path) -> None:
    hashes = set()
    for number, (limits, lid) in enumerate(
        [((-0.02, 0.0), (0.3, 0.2, 0.3)), ((-0.03, 0.0), (0.3, 0.2, 0.3)), ((-0.02, 0.0), (0.3, 0.21, 0.3))]
    ):
        write(root / str(number), limits, lid)
        hashes.add(made(root / str(number)).content_hash)
    assert len(hashes) == 3


def test_unknown_instance_gets_a_suggestion(root: Path) -> None:
    write(root)
    with pytest.raises(UnknownName, match=r'No Bottle instance "471". Did you mean "4711"\? Valid: 4711\.'):
        load(f"partnet:{root}", "Bottle", "471")


def test_missing_mesh_is_named(root: Path) -> None:
    (write(root) / "textured_objs/lid.obj").unlink()
    with pytest.raises(BadAsset, match=r"4711 cannot be used: its mesh textured_objs/lid\.obj is missing"):
        made(root)


def test_non_finite_vertex_is_named(root: Path) -> None:
    path = write(root) / "textured_objs/lid.obj"
    path.write_text(path.read_text().replace("v -0.15", "v nan", 1))
    with pytest.raises(BadAsset, match=r"vertices of textured_objs/lid\.obj are not finite"):
        made(root)


def test_broken_xml_is_named(root: Path) -> None:
    path = write(root) / "mobility.urdf"
    path.write_text(path.read_text()[:-20])
    with pytest.raises(BadAsset, match=r"its mobility\.urdf is not valid XML"):
        made(root)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('<parent link="link_1"/>', '<parent link="link_9"/>', "no joint holds the link link_9"),
        ('<parent link="link_1"/>', '<parent link="link_0"/>', "its joints form a ring at the link"),
        ('type="prismatic"', 'type="floating"', 'its joint joint_2 has the type "floating"'),
        ('lower="-0.02"', 'lower="wide"', "a limit of joint_2 cannot be read"),
        ('lower="-0.02"', 'lower="3"', "its joint joint_2 has limits in the wrong order"),
        ('xyz="0 1 0"', 'xyz="0 1"', '"0 1" in its mobility.urdf is not three numbers'),
        ('xyz="0 1 0"', 'xyz="0 0 0"', "its joint joint_0 has no axis direction"),
        ('type="continuous"', 'type="revolute"', "its joint joint_0 has no limits"),
    ],
)
def test_senseless_urdf_is_explained(root: Path, old: str, new: str, reason: str) -> None:
    path = write(root) / "mobility.urdf"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(BadAsset, match=reason):
        made(root)


def test_model_without_a_lid_is_refused(root: Path) -> None:
    (write(root) / "semantics.txt").write_text("link_0 hinge wheel\n")
    with pytest.raises(BadAsset, match="none of its moving parts is called lid or cap or cover"):
        made(root)


def test_thin_lid_is_refused_with_numbers(root: Path) -> None:
    write(root, lid=(0.3, 0.02, 0.3))
    with pytest.raises(BadAsset, match=r"fingers reach only 3\.\d mm of its lid, less than 5 mm"):
        made(root)


def test_stuck_dispenser_is_refused(root: Path) -> None:
    write(root, limits=(-0.001, 0.0), category="Dispenser")
    with pytest.raises(BadAsset, match="neither a lid that slides by 2 mm nor a hinged handle"):
        made(root, "Dispenser")


def test_box_is_one_part_and_an_angle_is_several(root: Path) -> None:
    whole = box((0.1, 0.1, 0.1), (0.0, 0.0, 0.0))
    arm = box((0.02, 0.1, 0.3), (0.04, 0.0, 0.2))
    angle = merged((box((0.3, 0.1, 0.02), (0.19, 0.0, 0.04)), arm))
    assert solidity(whole) > 0.95
    assert solidity(angle) < 0.5
    assert len(convex_parts((whole,))) == 1
    assert len(convex_parts((angle,))) > 1


def test_parts_inside_others_and_sheets_are_dropped(root: Path) -> None:
    outer, inner = box((0.1, 0.1, 0.1), (0.0, 0.0, 0.0)), box((0.02, 0.02, 0.02), (0.0, 0.0, 0.0))
    sheet = Mesh(np.array([[0.0, 0.0, 0.2], [0.1, 0.0, 0.2], [0.0, 0.1, 0.2]]), np.array([[0, 1, 2]]))
    [kept] = convex_parts((inner, outer, sheet))
    assert volume(kept) == pytest.approx(1e-3)


@needs_partnet
def test_real_folders_are_split_about_three_to_one() -> None:
    assert (len(names(SOURCE, "Bottle", "seen")), len(names(SOURCE, "Bottle", "unseen"))) == (12, 4)
    assert (len(names(SOURCE, "Dispenser", "seen")), len(names(SOURCE, "Dispenser", "unseen"))) == (4, 1)


@needs_partnet
@pytest.mark.slow
def test_at_least_three_quarters_of_the_real_models_are_usable() -> None:
    found = survey(SOURCE, "Bottle") + survey(SOURCE, "Dispenser")
    refused = [entry for entry in found if isinstance(entry, Rejected)]
    assert len(found) == 21
    assert {refusal.instance for refusal in refused} == {"3574", "6493", "8848"}
    assert all("fingers reach only" in refusal.reason for refusal in refused)


@needs_partnet
@pytest.mark.slow
def test_real_models_have_everyday_size_and_weight() -> None:
    for asset in survey(SOURCE, "Bottle") + survey(SOURCE, "Dispenser"):
        if isinstance(asset, Asset):
            assert 0.05 < asset.mass < 0.35
            assert abs(asset.part.point).max() < 0.25
            assert asset.part.point @ asset.long_axis > 0.0


def test_hinged_handle_is_pressed_where_no_lid_slides(root: Path) -> None:
    folder = write(root, limits=(-0.001, 0.0), category="Dispenser")
    path = folder / "mobility.urdf"
    handle = link("link_2", ["handle.obj"]) + joint(
        "joint_3",
        "revolute",
        "link_0",
        "link_2",
        '<origin xyz="0.2 0.7 0"/><axis xyz="0 0 1"/><limit lower="-0.3" upper="0"/>',
    )
    path.write_text(path.read_text().replace("</robot>", f"{handle}</robot>"))
    (folder / "textured_objs/handle.obj").write_text(obj((0.4, 0.1, 0.2), (0.2, 0.0, 0.0)))
    with (folder / "semantics.txt").open("a") as file:
        file.write("link_2 hinge handle\n")
    part = made(root, "Dispenser").part
    scale = 0.19 / 1.4
    assert (part.kind, part.joint, part.sense) == ("press", "joint_3", -1.0)
    assert part.travel == pytest.approx(0.3)
    assert part.axis[2] < -0.95
    assert 0.1 * scale < part.lever <= 0.41 * scale
