"""What a workcell file may say, and what a user is told when it says something else."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from robots.errors import BadWorkcell, UnknownName
from robots.model import DualArm, arm_urdf
from robots.workcell import SIDES, Workcell, load_workcell, other, parse_workcell, workcell_names

TEXT = (resources.files("robots") / "workcells" / "panda_pair.toml").read_text("utf-8")


def message(text: str) -> str:
    with pytest.raises(BadWorkcell) as caught:
        parse_workcell(text, "cell.toml")
    return str(caught.value)


def test_the_shipped_cell_loads_by_name_and_by_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(TEXT)
    assert load_workcell("panda_pair") == load_workcell(str(file))
    assert "panda_pair" in workcell_names()


def test_an_unknown_key_is_named_with_the_nearest_known_one() -> None:
    text = message(TEXT.replace("thickness = 0.04", "thicknes = 0.04"))
    assert "cell.toml" in text
    assert "`thicknes`" in text
    assert 'Did you mean "thickness"?' in text


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("velocity = [2.1750,", "velocity = [-2.1750,", ("> 0.0", "velocity[0]")),
        ("acceleration = [15.0,", "acceleration = [0.0,", ("> 0.0", "acceleration[0]")),
        ("torque = [87.0,", "torque = [-87.0,", ("> 0.0", "torque[0]")),
        ("finger_travel = 0.04", "finger_travel = -0.04", ("> 0.0", "finger_travel")),
        ("lower = [-2.8973,", "lower = [3.0,", ("panda_joint1", "lower limit 3.0 rad is not below upper limit 2.8973")),
        ("home = [-1.4,", "home = [-3.4,", ("arms.left.home", "-3.4 rad is outside [-2.8973, 2.8973] rad")),
        ('model = "panda"', 'model = "pandda"', ('"pandda" is not among models: panda',)),
        ("size = [0.70, 0.60]", "size = [0.70]", ("length 2", "table.size")),
        ("top = 0.0", "top = -0.6", ("below the floor",)),
        ("top = 0.0", 'top = "high"', ("float", "table.top")),
        ("[table]", "[table", ("not valid TOML",)),
        ("thickness = 0.04\n", "", ("missing required field `thickness`",)),
    ],
)
def test_a_value_that_cannot_be_is_refused_with_its_place(old: str, new: str, words: tuple[str, ...]) -> None:
    assert old in TEXT
    text = message(TEXT.replace(old, new, 1))
    for word in words:
        assert word in text


def test_names_and_files_that_do_not_exist_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(UnknownName, match=r'No workcell "panda_pear". Did you mean "panda_pair"?'):
        load_workcell("panda_pear")
    with pytest.raises(BadWorkcell, match="cannot be read"):
        load_workcell(str(tmp_path / "none.toml"))


def test_a_urdf_that_does_not_exist_is_named() -> None:
    with pytest.raises(BadWorkcell, match=r"nowhere.urdf does not exist"):
        DualArm(parse_workcell(TEXT.replace("franka_panda/panda.urdf", "nowhere.urdf"), "cell"))
    with pytest.raises(BadWorkcell, match="no_such_package is not installed"):
        DualArm(parse_workcell(TEXT.replace("pybullet_data:", "no_such_package:"), "cell"))


def test_names_are_unique_in_the_world_and_limits_are_the_cells(workcell: Workcell, arms: DualArm) -> None:
    for side in SIDES:
        text = arm_urdf(workcell, side)
        assert f'"{side}/panda_hand"' in text
        assert f'"{other(side)}/' not in text
        assert np.array_equal(arms[side].lower, workcell.arm(side).lower)
        assert all(str(name).startswith(f"{side}/") for name in list(arms[side].model.names)[1:])
        assert arms[side].within_limits(arms[side].home)


def test_bases_stand_where_the_cell_says(workcell: Workcell, arms: DualArm) -> None:
    for side in SIDES:
        expected = np.array(workcell.placement(side).base_xyz)
        assert np.allclose(arms[side].base[:2], expected[:2])
        assert arms[side].base[2] > expected[2]
