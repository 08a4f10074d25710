"""Laws of the importer of rigid meshes, on small files written here and on the real ones where they are."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from robots.errors import BadAsset, BadInput, UnknownName
from robots.spatial import pose
from worlds.assets.asset import Asset, Rejected
from worlds.assets.everyday import EVERYDAY, MOST_MASS
from worlds.assets.hollow import coacd_parts, measure, wedges
from worlds.assets.library import categories, choose, load, names, survey
from worlds.assets.meshfile import MOST_KEPT, read_mesh, simplified
from worlds.assets.posture import fuller_side_down, wider_end_up
from worlds.assets.shape import collision_vertices
from worlds.assets.solids import Mesh, box, hull, merged, volume
from worlds.bullet.client import Client

OBJECTS = Path(__file__).parents[3] / "shared/assets/objects"
SOURCE = f"mesh:{OBJECTS}"
needs_objects = pytest.mark.skipif(not OBJECTS.is_dir(), reason=f"no folder {OBJECTS}")

USABLE = {
    "Bowl": 4,
    "Cap": 1,
    "Laptop": 1,
    "Phone": 3,
    "Plate": 4,
    "Remote": 2,
    "Scissors": 3,
    "Switch": 3,
    "Window": 2,
}
"""How many real rigid objects there are of each category that needs no joint; all are usable."""

JOINTLESS = {"Bottle": 2, "Dispenser": 1, "Pen-Button": 3, "Pen-Cap": 3, "Pliers": 1, "Stapler": 3, "USB": 1}
"""How many there are of each category that needs one; none is usable."""


def bowl(radius: float = 0.075, height: float = 0.06, wall: float = 0.004, sections: int = 48) -> trimesh.Trimesh:
    """A cone-shaped bowl with its opening up."""
    profile = [(0.0, 0.0), (0.5 * radius, 0.0), (radius, height), (radius - wall, height), (0.5 * radius - wall, wall)]
    return trimesh.creation.revolve(np.array([*profile, (0.0, wall)]), sections=sections)


def own(mesh: trimesh.Trimesh) -> Mesh:
    return Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def put(root: Path, name: str, mesh: trimesh.Trimesh) -> Path:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    mesh.export(path)
    return path


def slab(size: tuple[float, float, float] = (0.15, 0.07, 0.01)) -> trimesh.Trimesh:
    return trimesh.creation.box(extents=size)


def index(root: Path, **fields: object) -> str:
    """A folder with an index of one entry; returns its source."""
    row = {"category": "Phone", "id": "a", "source": "s", "path": "Phone/a", "entry": "a.obj", "kind": "obj"}
    root.mkdir(parents=True, exist_ok=True)
    (root / "INDEX.json").write_text(json.dumps([row | fields]))
    return f"mesh:{root}"


def size(asset: Asset) -> np.ndarray:
    return np.asarray(np.ptp(np.concatenate(list(collision_vertices(asset).values())), axis=0))


@pytest.mark.parametrize("suffix", ["obj", "stl", "ply", "glb"])
def test_every_format_gives_the_same_metric_object(tmp_path: Path, suffix: str) -> None:
    size_in_file = (0.15, 0.01, 0.07) if suffix == "glb" else (0.15, 0.07, 0.01)
    put(tmp_path, f"Phone/one.{suffix}", slab(size_in_file))
    asset = load(f"mesh:{tmp_path}", "Phone", "one")
    assert size(asset) == pytest.approx([0.15, 0.07, 0.01], abs=1e-6)
    assert asset.mass == pytest.approx(1700.0 * 0.15 * 0.07 * 0.01, rel=1e-4)
    assert (asset.function, asset.joints, asset.topology) == (None, {}, "rigid")


def test_shapenet_layout_is_unit_free_and_y_up(tmp_path: Path) -> None:
    put(tmp_path, "03085013/abc/models/model_normalized.obj", slab((0.9, 0.04, 0.36)))
    source = f"mesh:{tmp_path}"
    assert (categories(source), names(source, "Keyboard")) == (["Keyboard"], ["abc"])
    asset = load(source, "Keyboard", "abc")
    assert size(asset) == pytest.approx(np.array([0.9, 0.36, 0.04]) * EVERYDAY["Keyboard"].size / 0.9)
    assert asset.notes[0] == "size supplied: 400 mm long; as modelled it is without a unit"


@pytest.mark.parametrize(("unit", "supplied"), [(1.0, False), (1000.0, True), (0.01, True)])
def test_a_size_that_no_such_object_has_is_replaced_and_said(tmp_path: Path, unit: float, supplied: bool) -> None:
    put(tmp_path, "Phone/one.obj", slab((0.14 * unit, 0.07 * unit, 0.01 * unit)))
    asset = load(f"mesh:{tmp_path}", "Phone", "one")
    assert size(asset).max() == pytest.approx(EVERYDAY["Phone"].size if supplied else 0.14)
    assert any(note.startswith("size supplied") for note in asset.notes) == supplied


def test_heavy_object_is_made_liftable_and_says_so(tmp_path: Path) -> None:
    put(tmp_path, "Laptop/big.stl", slab((0.34, 0.24, 0.03)))
    asset = load(f"mesh:{tmp_path}", "Laptop", "big")
    assert asset.mass == pytest.approx(MOST_MASS)
    assert any("not 800, to weigh 1 kg" in note for note in asset.notes)


def test_wall_switch_lies_on_its_back(tmp_path: Path) -> None:
    plate, rocker = slab((0.08, 0.01, 0.08)), slab((0.03, 0.01, 0.03))
    for name, side in (("front", -0.01), ("back", 0.01)):
        whole = trimesh.util.concatenate([plate, rocker.copy().apply_translation((0.0, side, 0.0))])
        put(tmp_path, f"Switch/{name}.stl", whole)
        asset = load(f"mesh:{tmp_path}", "Switch", name)
        top = max((row for row in _visual(asset)), key=lambda vertex: vertex[2])
        assert abs(top[0]) < 0.02
        assert size(asset)[2] < 0.025


def _visual(asset: Asset) -> list[list[float]]:
    rows = (asset.urdf.parent / "body_visual.obj").read_text().splitlines()
    return [[float(word) for word in row.split()[1:]] for row in rows if row.startswith("v ")]


def test_upside_down_bowl_is_turned_over_and_its_cavity_stays_open(tmp_path: Path) -> None:
    down = bowl().apply_transform(np.diag([1.0, -1.0, -1.0, 1.0]))
    put(tmp_path, "Bowl/down.ply", down)
    asset = load(f"mesh:{tmp_path}", "Bowl", "down")
    assert "turned to lie as on a table" in asset.notes
    widths = {z > 0.0: abs(x) for x, _, z in sorted(_visual(asset), key=lambda vertex: abs(vertex[0]))}
    assert widths[True] > widths[False]
    assert _lands_inside(asset)


def _lands_inside(asset: Asset) -> bool:
    """Whether a ray down the middle meets the shell only in its lower half, in PyBullet's eyes."""
    client = Client()
    try:
        client.load_urdf(asset.urdf, pose((0.0, 0.0, 0.0)), fixed=True)
        client.stepSimulation()
        hit = client.rayTest([0.001, 0.002, 0.2], [0.001, 0.002, -0.2])[0]
        low, high = (f([row[2] for row in _visual(asset)]) for f in (min, max))
        return bool(hit[0] >= 0 and low < hit[3][2] < low + 0.5 * (high - low))
    finally:
        client.close()


def test_wedges_hold_the_wall_and_leave_the_cavity_open() -> None:
    shape = own(bowl())
    parts = wedges(shape)
    fit = measure(shape, parts)
    assert fit.good
    assert fit.filled < 0.01
    assert sum(volume(part) for part in parts) == pytest.approx(volume(shape), rel=0.15)


def test_measure_sees_a_filled_cavity_and_a_missing_wall() -> None:
    shape = own(bowl())
    parts = wedges(shape)
    assert measure(shape, (hull(shape.vertices),)).filled > 0.95
    assert measure(shape, parts[: len(parts) // 2]).missed > 0.2
    assert not measure(shape, ()).good


@pytest.mark.slow
def test_wedges_beat_coacd_on_a_round_bowl() -> None:
    shape = own(bowl())
    cut, decomposed = measure(shape, wedges(shape)), measure(shape, coacd_parts(shape))
    assert cut.filled + cut.missed <= decomposed.filled + decomposed.missed
    assert decomposed.filled < 0.1


def test_posture_turns_only_what_lies_wrong() -> None:
    cone = Mesh(
        np.array([[0, 0, 0], [1, 0, 1], [-1, 1, 1], [-1, -1, 1.0]]), np.array([[0, 1, 2], [0, 2, 3], [1, 3, 2]])
    )
    assert np.array_equal(wider_end_up(cone, up=True), np.eye(3))
    assert np.array_equal(wider_end_up(cone, up=False), np.diag([1.0, -1.0, -1.0]))
    stool = merged((box((1.0, 1.0, 0.1), (0.0, 0.0, 0.0)), box((0.3, 0.3, 0.2), (0.0, 0.0, -0.15))))
    assert np.array_equal(fuller_side_down(stool), np.diag([1.0, -1.0, -1.0]))


URDF = """<?xml version="0.0" ?>
<robot name="r"><link name="a"><visual><origin xyz="0 0 0.1"/><geometry>
<mesh filename="m/one.obj" scale="0.001 0.001 0.001"/></geometry></visual>
<collision><geometry><mesh filename="m/collision.obj"/></geometry></collision></link>
<link name="b"><visual><geometry><mesh filename="m/one.obj" scale="0.001 0.001 0.001"/></geometry></visual></link>
<joint name="j" type="fixed"><parent link="a"/><child link="b"/><origin xyz="0 0 0.11"/></joint></robot>"""


def test_urdf_meshes_are_scaled_and_placed(tmp_path: Path) -> None:
    put(tmp_path, "Phone/x/m/one.obj", slab((150.0, 70.0, 10.0)))
    (tmp_path / "Phone/x/model.urdf").write_text(URDF)
    asset = load(f"mesh:{tmp_path}", "Phone", "x")
    assert size(asset) == pytest.approx([0.15, 0.07, 0.02], abs=1e-6)


MJCF = """<mujoco><compiler meshdir="parts"/><include file="absent.xml"/><asset><mesh name="shown" file="one.obj"/>
<mesh file="other.stl" scale="2 2 2"/></asset><worldbody><body pos="5 5 5" euler="0 90 0"><geom mesh="shown"
class="visual_a" euler="90 0 0"/><geom mesh="other"/></body></worldbody></mujoco>"""


def test_mjcf_meshes_that_are_seen_are_read_in_the_body_frame(tmp_path: Path) -> None:
    put(tmp_path, "Phone/x/parts/one.obj", slab((0.15, 0.01, 0.07)))
    put(tmp_path, "Phone/x/parts/other.stl", slab((1.0, 1.0, 1.0)))
    (tmp_path / "Phone/x/model.xml").write_text(MJCF)
    asset = load(f"mesh:{tmp_path}", "Phone", "x")
    assert size(asset) == pytest.approx([0.15, 0.07, 0.01], abs=1e-6)
    assert "its include absent.xml is missing" in asset.notes


@pytest.mark.parametrize(
    ("file", "text", "reason"),
    [
        ("model.urdf", "<robot>", r"its model\.urdf is not valid XML"),
        ("model.urdf", "<robot/>", r"its model\.urdf names no mesh"),
        ("model.urdf", URDF.replace("one.obj", "two.obj"), r"its mesh two\.obj is missing"),
        ("model.urdf", URDF.replace('scale="0.001 ', 'scale="inf '), "is not 3 finite numbers"),
        ("model.urdf", URDF.replace("m/one.obj", "package://m/one.obj"), "is not a file beside its description"),
        ("model.xml", MJCF.replace('mesh="shown"', 'mesh="lost"'), 'names the mesh "lost", which is not among'),
        ("model.xml", "<mujoco><include file='model.xml'/></mujoco>", "includes are nested more than 8 deep"),
    ],
)
def test_senseless_description_is_explained(tmp_path: Path, file: str, text: str, reason: str) -> None:
    put(tmp_path, "Phone/x/m/one.obj", slab())
    (tmp_path / "Phone/x" / file).write_text(text)
    with pytest.raises(BadAsset, match=reason):
        load(f"mesh:{tmp_path}", "Phone", "x")


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("nan.obj", TRIANGLE.replace("1 0 0", "nan 0 0") + "f 1 3 2\n" * 4, r"vertices of nan\.obj are not finite"),
        ("empty.obj", "", r"its mesh empty\.obj (has no triangles|cannot be read)"),
        ("points.obj", "v 0 0 0\nv 1 0 0\n", r"its mesh points\.obj (has no triangles|cannot be read)"),
        ("one.obj", TRIANGLE, r"its mesh one\.obj has 1 triangles, a body needs at least 4"),
        ("flat.obj", TRIANGLE + "v 1 1 0\n" + "f 2 3 4\n" * 4, "it has no volume"),
        ("dot.obj", "v 1 1 1\nv 1 1 1\nv 1 1 1\n" + "f 1 2 3\n" * 4, "all its vertices are one point"),
        ("noise.glb", "not a glb", r"its mesh noise\.glb cannot be read"),
        ("noise.stl", "solid", r"its mesh noise\.stl (has no triangles|cannot be read)"),
        ("noise.ply", "ply\nformat ascii 1.0\n", r"its mesh noise\.ply (has no triangles|cannot be read)"),
    ],
)
def test_unusable_mesh_is_rejected_with_its_reason(tmp_path: Path, name: str, text: str, reason: str) -> None:
    (tmp_path / "Phone").mkdir()
    (tmp_path / "Phone" / name).write_text(text)
    source = f"mesh:{tmp_path}"
    with pytest.raises(BadAsset, match=reason):
        load(source, "Phone", name.split(".", maxsplit=1)[0])
    [refusal] = survey(source, "Phone")
    assert isinstance(refusal, Rejected)


def test_folder_without_a_mesh_and_wrong_extensions_are_explained(tmp_path: Path) -> None:
    (tmp_path / "Phone/x").mkdir(parents=True)
    (tmp_path / "Phone/x/model.fbx").write_text("")
    (tmp_path / "Phone/stray.fbx").write_text("")
    source = f"mesh:{tmp_path}"
    assert names(source, "Phone") == ["x"]
    with pytest.raises(BadAsset, match=r"neither models/model_normalized\.obj, a URDF, nor a mesh \(\.obj, "):
        load(source, "Phone", "x")


def test_dense_mesh_is_simplified_and_says_so(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.08)
    ball.vertices[:, 2] *= 0.2
    path = put(tmp_path, "Phone/ball.stl", ball)
    mesh, [note] = read_mesh(path)
    assert len(ball.faces) > MOST_KEPT >= len(mesh.faces) > MOST_KEPT / 8
    assert note == f"ball.stl simplified from {len(ball.faces)} to {len(mesh.faces)} triangles"
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx(np.ptp(ball.vertices, axis=0), rel=0.02)
    assert volume(hull(mesh.vertices)) == pytest.approx(float(ball.volume), rel=0.03)
    assert len(simplified(mesh, most=500).faces) <= 500


def test_operated_category_needs_joints(tmp_path: Path) -> None:
    put(tmp_path, "Bottle/one.obj", slab())
    put(tmp_path, "Pen/two.obj", slab())
    source = f"mesh:{tmp_path}"
    assert categories(source) == ["Bottle", "Pen-Button", "Pen-Cap"]
    for category, instance in (("Bottle", "one"), ("Pen-Cap", "two"), ("Pen-Button", "two")):
        with pytest.raises(BadAsset, match="it has no joints"):
            load(source, category, instance)
    with pytest.raises(BadInput, match=r"No usable Bottle in mesh:.*: one: it has no joints\."):
        choose(source, "Bottle", None, seed=0)


def test_index_gives_scale_axes_and_a_name_with_its_source(tmp_path: Path) -> None:
    root = tmp_path / "objects"
    put(root, "Phone/a/a.obj", slab((15.0, 1.0, 7.0)))
    source = index(root, path="objects/Phone/a", units="y-up, centimetres", scale_xyz_obj_to_m=[0.01, 0.01, 0.01])
    assert names(source, "Phone") == ["s-a"]
    assert size(load(source, "Phone", "s-a")) == pytest.approx([0.15, 0.07, 0.01])


def test_index_leaves_articulated_and_foreign_objects_out(tmp_path: Path) -> None:
    assert categories(index(tmp_path, source="partnet_mobility")) == []
    assert categories(index(tmp_path, category="Kettle")) == []


def test_missing_entry_file_is_replaced_by_the_folders_mesh_and_said(tmp_path: Path) -> None:
    source = index(tmp_path, entry="../a.urdf")
    with pytest.raises(BadAsset, match=r"its a\.urdf is missing, and so is any mesh in a"):
        load(source, "Phone", "s-a")
    put(tmp_path, "Phone/a/a_collision.stl", slab((0.5, 0.5, 0.5)))
    put(tmp_path, "Phone/a/textured.obj", slab())
    asset = load(source, "Phone", "s-a")
    assert "its a.urdf is missing: read textured.obj instead" in asset.notes
    assert size(asset) == pytest.approx([0.15, 0.07, 0.01])


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"path": "../../etc"}, r'its path "\.\./\.\./etc" leaves the folder of the index'),
        ({"scale_xyz_obj_to_m": [1.0, 2.0]}, r"its scale \[1\.0, 2\.0\] in the index is not three positive numbers"),
        ({"json_scale": [1.0, -1.0, 1.0]}, "is not three positive numbers"),
        ({"entry": "a.docx"}, r"a\.docx is missing, and so is any mesh"),
    ],
)
def test_senseless_index_entry_rejects_its_object(tmp_path: Path, fields: dict[str, object], reason: str) -> None:
    with pytest.raises(BadAsset, match=reason):
        load(index(tmp_path, **fields), "Phone", "s-a")


@pytest.mark.parametrize(
    "text", ["", "{", '{"a": 1}', "[1]", '[{"category": "Phone"}]', '[{"category": 3}]', "\x00\xff"]
)
def test_corrupt_index_is_one_readable_message(tmp_path: Path, text: str) -> None:
    (tmp_path / "INDEX.json").write_bytes(text.encode("latin-1"))
    for look in (lambda: categories(f"mesh:{tmp_path}"), lambda: survey(f"mesh:{tmp_path}", "Phone")):
        with pytest.raises(BadInput, match=r"The index .*INDEX\.json cannot be read: .*\.$"):
            look()


def test_folder_without_objects_says_what_it_has(tmp_path: Path) -> None:
    (tmp_path / "toys").mkdir()
    with pytest.raises(BadInput, match=r"has neither INDEX\.json nor a folder of a known category; it has: toys\."):
        categories(f"mesh:{tmp_path}")
    put(tmp_path, "bowl/one.obj", bowl())
    with pytest.raises(BadInput, match=r"The folder .* has no Plate; it has: Bowl\."):
        names(f"mesh:{tmp_path}", "Plate")
    with pytest.raises(UnknownName, match=r'No Bowl instance "on"\. Did you mean "one"\?'):
        load(f"mesh:{tmp_path}", "Bowl", "on")


def test_same_file_gives_the_same_hash_and_another_one_does_not(tmp_path: Path) -> None:
    put(tmp_path, "Phone/one.stl", slab())
    put(tmp_path, "Phone/two.stl", slab((0.15, 0.07, 0.011)))
    source = f"mesh:{tmp_path}"
    first, again, other = (load(source, "Phone", name).content_hash for name in ("one", "one", "two"))
    assert first == again != other


def test_scale_beside_a_mesh_is_applied_or_its_fault_named(tmp_path: Path) -> None:
    put(tmp_path, "Phone/x/base.glb", slab((3.0, 0.2, 1.4)))
    source, data = f"mesh:{tmp_path}", tmp_path / "Phone/x/model_data1.json"
    data.write_text('{"scale": [0.05, 0.05, 0.05], "other": 1}')
    assert size(load(source, "Phone", "x")) == pytest.approx([0.15, 0.07, 0.01])
    for text, reason in (("{", r"its model_data1\.json cannot be read"), ('{"scale": [1.0]}', "not three positive")):
        data.write_text(text)
        with pytest.raises(BadAsset, match=reason):
            load(source, "Phone", "x")


@needs_objects
def test_real_collection_lists_every_category_it_has() -> None:
    assert set(categories(SOURCE)) == {*USABLE, *JOINTLESS}
    assert {category: len(names(SOURCE, category)) for category in (*USABLE, *JOINTLESS)} == USABLE | JOINTLESS
    assert not any(name.startswith("partnet") for category in USABLE for name in names(SOURCE, category))


@needs_objects
def test_a_real_bowl_is_open_and_of_everyday_size() -> None:
    asset = load(SOURCE, "Bowl", "robotwin_od-002_bowl_base1")
    assert size(asset) == pytest.approx([0.111, 0.111, 0.047], abs=0.003)
    assert 0.08 < asset.mass < 0.5
    assert _lands_inside(asset)


@needs_objects
def test_real_articulated_categories_are_refused_for_want_of_joints() -> None:
    for category, count in JOINTLESS.items():
        found = survey(SOURCE, category)
        assert [getattr(refusal, "reason", "") for refusal in found] == ["it has no joints"] * count


@needs_objects
@pytest.mark.slow
@pytest.mark.parametrize("category", USABLE)
def test_every_real_rigid_object_is_usable(category: str) -> None:
    for asset in survey(SOURCE, category):
        assert isinstance(asset, Asset)
        assert asset.function is None
        assert 0.01 < asset.mass <= MOST_MASS + 1e-9
        longest = float(size(asset).max()) / EVERYDAY[category].size
        assert 0.4 < longest < 2.0
        if EVERYDAY[category].lies:
            assert size(asset)[2] == pytest.approx(size(asset).min())
            assert size(asset)[2] < 0.072
        if category in ("Bowl", "Plate"):
            assert _lands_inside(asset)
