"""The command line as scripts meet it: exit codes, pure JSON, and one readable message for every wrong use."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from tamp import proposers
from tamp.cli.plan import PROPOSERS
from tamp.cli.verbs import NAMES
from tests.conftest import SHARED
from worlds.tasks import TASKS

REPOSITORY = Path(__file__).parents[2]
PARTNET = SHARED / "assets" / "objects" / "partnet_mobility"
INTERRUPTIBLE = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
"""Undoes what a shell does to commands in the background: they ignore Ctrl-C."""

NOISE = ("pybullet build time", "viser", "nanobind", "Traceback", "OMPL", "b3Warning", "RuntimeWarning")


def bipre(*words: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own."""
    command = [sys.executable, "-m", "tamp.cli", *words]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), "COLUMNS": "100"}
    return subprocess.run(
        command, cwd=cwd or REPOSITORY, env=environment, capture_output=True, text=True, timeout=300, check=False
    )


def answer(done: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    """The one JSON object on stdout."""
    assert done.stdout.count("\n") == 1
    value = json.loads(done.stdout)
    assert isinstance(value, dict)
    return value


def refused(*words: str, cwd: Path | None = None) -> str:
    """The message of a wrong use: exit 2, nothing on stdout, one line on stderr, no traceback."""
    done = bipre(*words, cwd=cwd)
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("error: ")
    return lines[0].removeprefix("error: ")


# -- the whole road --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder that the command made."""
    folder = tmp_path_factory.mktemp("cli") / "run"
    done = bipre("plan", "Dispenser", "--proposer", "heuristic", "--seed", "1", "--json", "--out", str(folder))
    assert done.returncode == 0, done.stderr
    report = answer(done)
    assert report["status"] == "success"
    assert report["success"] is True
    assert (report["category"], report["seed"], report["proposer"]) == ("Dispenser", 1, "heuristic")
    assert report["plan_seconds"] > 0.0
    assert report["execute_seconds"] > 0.0
    assert report["failure"] is None
    assert report["run_dir"] == str(folder)
    assert [set(stage) for stage in report["stages"]] == [{"name", "arm", "role", "duration", "candidates_tried"}] * 6
    assert not [noise for noise in NOISE if noise in done.stderr]
    return folder


def test_verify_says_ok_and_how_close_it_was(run_dir: Path) -> None:
    done = bipre("verify", str(run_dir), "--json")
    assert done.returncode == 0
    found = answer(done)
    assert found["ok"] is True
    assert found["violations"] == []
    assert found["checked_states"] > 1000
    for key in ("min_clearance", "max_velocity_ratio", "max_acceleration_ratio"):
        assert isinstance(found[key], float)
    assert "ok" in done.stderr


def test_verify_of_a_faulty_plan_is_exit_1_and_names_the_fault(run_dir: Path, tmp_path: Path) -> None:
    raw = json.loads((run_dir / "plan.json").read_bytes())
    raw["start"]["left"][0] += 0.05
    (tmp_path / "plan.json").write_text(json.dumps(raw))
    done = bipre("verify", str(tmp_path), "--json")
    assert done.returncode == 1
    assert {violation["kind"] for violation in answer(done)["violations"]} >= {"start"}
    assert "the left arm starts 0.050000 rad from its waiting configuration" in done.stderr


def test_run_executes_the_saved_plan_again(run_dir: Path) -> None:
    done = bipre("run", str(run_dir), "--json")
    assert done.returncode == 0, done.stderr
    assert answer(done)["status"] == "success"


def test_why_tells_what_was_tried(run_dir: Path) -> None:
    done = bipre("why", str(run_dir), "--json")
    assert done.returncode == 0
    told = answer(done)
    assert told["status"] == "success"
    assert told["skeletons"][told["chosen"]][0].startswith("pregrasp(")
    assert "<- the plan" in done.stderr


def test_networks_propose_unless_told_otherwise(tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="torch is not installed")
    done = bipre("plan", "Pen-Cap", "--seed", "1", "--no-execute", "--json", "--out", str(tmp_path / "run"))
    assert answer(done)["proposer"] == "learned", done.stderr
    assert (tmp_path / "run" / "affordance.npz").is_file()


def test_why_tells_every_round_of_a_closed_loop(tmp_path: Path) -> None:
    """The phone is pushed, looked at again, and grasped by a second plan; the first one is kept aside."""
    folder = tmp_path / "run"
    done = bipre(
        "plan", "Phone", "--proposer", "heuristic", "--seed", "0", "--closed-loop", "--json", "--out", str(folder)
    )
    assert done.returncode == 0, done.stderr
    report = answer(done)
    assert (report["mode"], report["rounds"]) == ("E3", 2)
    assert [stage["name"] for stage in report["stages"]] == ["grasp", "lift"]
    assert "over 2 rounds" in done.stderr
    told = bipre("why", str(folder), "--json")
    assert told.returncode == 0
    rounds = answer(told)
    assert rounds["rounds"] == 2
    assert [searched["status"] for searched in rounds["earlier"]] == ["success"]
    assert "push(" in rounds["earlier"][0]["skeletons"][0][0]
    assert rounds["skeletons"][rounds["chosen"]][0].startswith("grasp(")
    assert told.stderr.index("round 1 of 2") < told.stderr.index("round 2 of 2")
    for place in (folder, folder / "round-0"):
        assert bipre("verify", str(place)).returncode == 0


def test_without_resampling_the_report_says_so(tmp_path: Path) -> None:
    words = ("--proposer", "heuristic", "--seed", "0", "--no-resample", "--no-execute", "--json")
    done = bipre("plan", "Phone", *words, "--out", str(tmp_path / "r"))
    assert answer(done)["mode"] == "E1"
    assert {stage["candidates_tried"] for stage in answer(done)["stages"]} <= {1}


def test_why_of_a_failure_names_stage_reason_and_numbers(tmp_path: Path) -> None:
    """An object pose that this object cannot have makes every candidate fail; the trace says how."""
    cell = (resources.files("robots") / "workcells" / "panda_pair.toml").read_text("utf-8")
    far = tmp_path / "far.toml"
    far.write_text(cell.replace("[-0.55, -0.10, -0.20]", "[-1.55, -0.10, -0.20]").replace("[0.55, ", "[1.55, "))
    folder = tmp_path / "run"
    words = ("--proposer", "heuristic", "--seed", "1", "--workcell", str(far), "--json")
    done = bipre("plan", "Bottle", *words, "--out", str(folder))
    assert done.returncode == 1
    failed = answer(done)
    assert failed["status"] == "no_plan"
    assert failed["failure"]["stage"] == "pregrasp"
    assert failed["failure"]["reason"] == "unreachable"
    assert "unreachable by" in failed["failure"]["detail"]
    assert "bipre why" in done.stderr
    told = answer(bipre("why", str(folder), "--json"))
    assert told["rejected"] > 0
    assert told["failure"] == failed["failure"]
    assert not (folder / "plan.json").exists()


def test_view_serves_until_interrupted(run_dir: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    script = INTERRUPTIBLE + "import sys\nfrom tamp.cli import main\nsys.exit(main(sys.argv[1:]))"
    with subprocess.Popen(
        [sys.executable, "-c", script, "view", str(run_dir), "--port", str(port), "--json"],
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stderr is not None
            said = process.stderr.readline()
            time.sleep(0.5)
            process.send_signal(signal.SIGINT)
            out, rest = process.communicate(timeout=30)
        finally:
            process.kill()
    assert f"viewing http://localhost:{port}" in said
    assert "ssh -L" in said
    assert process.returncode == 0, rest
    assert json.loads(out)["served"] is True


def test_ctrl_c_while_planning_is_130_and_keeps_the_trace(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    script = INTERRUPTIBLE + (
        "import sys, os\n"
        "from tamp.refine import Search\n"
        "def stop(*a): os.kill(os.getpid(), signal.SIGINT)\n"
        "Search._descend = stop\n"
        "from tamp.cli import main\n"
        f"sys.exit(main(['plan', 'Bottle', '--seed', '1', '--json', '--out', {str(folder)!r}]))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=REPOSITORY, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 130, done.stderr
    assert answer(done)["error"]["kind"] == "interrupted"
    assert "Traceback" not in done.stderr
    assert json.loads((folder / "trace.json").read_text())["status"] == "interrupted"


def test_assets_lists_every_instance(tmp_path: Path) -> None:
    done = bipre("assets", "Dispenser", "--json")
    assert done.returncode == 0
    told = answer(done)
    assert told["usable"] == len(told["instances"]) >= 57
    assert {row["split"] for row in told["instances"]} == {"seen", "unseen"}


def test_doctor_examines_everything(tmp_path: Path) -> None:
    done = bipre("doctor", "--json")
    assert done.returncode == 0, done.stderr
    names = {check["name"] for check in answer(done)["checks"]}
    assert {"python", "pybullet", "ompl", "pin", "coal", "toppra", "viewer port", "GPU", "display"} <= names


# -- help ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", NAMES)
def test_every_verb_has_help_on_its_arguments(verb: str) -> None:
    done = bipre(verb, "--help")
    assert done.returncode == 0
    assert f"usage: bipre {verb}" in done.stderr
    assert "--json" in done.stderr
    assert done.stdout == ""


def test_help_names_every_category_proposer_and_object_source() -> None:
    said = bipre("plan", "--help").stderr
    for word in (*TASKS, *PROPOSERS, "synthetic", "partnet:DIR", "mesh:DIR"):
        assert word in said


def test_the_proposers_refused_early_are_those_that_an_episode_knows() -> None:
    assert PROPOSERS == proposers.PROPOSERS


def test_the_overview_lists_every_verb_and_loads_nothing_heavy() -> None:
    done = bipre("--help")
    assert done.returncode == 0
    for verb in NAMES:
        assert f"\n  {verb} " in done.stderr
    script = (
        "import sys\nfrom tamp.cli import main\nmain(['--help'])\n"
        "heavy = {'torch', 'pybullet', 'viser', 'pinocchio', 'ompl', 'toppra', 'trimesh', 'numpy', 'scipy'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_importing_tamp_loads_no_simulator_viewer_or_network() -> None:
    script = "import sys, tamp, tamp.cli\nprint(sorted({'torch', 'pybullet', 'viser'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# -- wrong use -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("paln", "Bottle"), 'No verb "paln". Did you mean "plan"? Verbs: ' + ", ".join(NAMES) + "."),
        (("plan", "Botle"), 'No category "Botle". Did you mean "Bottle"? Valid: Bottle, Bowl, Cap, Dispenser, '),
        (("plan", "bottle"), 'No category "bottle". Did you mean "Bottle"? Valid: Bottle, Bowl, Cap, Dispenser, '),
        (("plan", "Bottle", "--proposer", "heuristc"), 'No proposer "heuristc". Did you mean "heuristic"?'),
        (("plan", "Bottle", "--proposer", "psychic"), "Valid: actor_reorient, heuristic, learned, "),
        (("plan", "Handover-Botle"), 'No category "Handover-Botle". Did you mean "Handover-Bottle"?'),
        (("plan", "Phone", "--closed-loop", "--no-resample"), "--closed-loop tries again and --no-resample does not;"),
        (("plan", "Phone", "--closed-loop", "--no-execute"), "--closed-loop needs the execution that --no-execute"),
        (("plan", "Phone", "--max-pushes", "0"), "--max-pushes 0 is too few; give 1 or more."),
        (("plan", "Phone", "--max-pushes", "two"), "'two' is not a whole number"),
        (("plan", "Bottle", "--workcell", "panda_pear"), 'No workcell "panda_pear". Did you mean "panda_pair"?'),
        (("plan", "Bottle", "--instance", "bottle-0"), 'No Bottle instance "bottle-0". Did you mean'),
        (("plan", "Bottle", "--asset", "sinthetic"), "sinthetic"),
        (("plan", "Bottle", "--asset", "partnet:/no/such"), "/no/such"),
        (("plan", "Bottle", "--seed", "x"), "--seed"),
        (("plan", "Bottle", "--seed", "-1"), "--seed -1 is negative; give 0 or more."),
        (("plan", "Bottle", "--timeout", "0"), "--timeout 0.0 is not a time; give seconds above 0."),
        (("plan", "Bottle", "--timeout", "soon"), "'soon' is not a number"),
        (
            ("plan", "Bottle", "--proposer", "heuristic", "--affordance-png", "m.png"),
            "heuristic has no affordance maps.",
        ),
        (("plan", "Bottle", "--proposer", "uniform", "--affordance-png", "m.png"), "uniform has no affordance maps."),
        (("plan", "Bottle", "--proposer", "learned", "--affordance-png", "no/m.png"), "there is no folder"),
        (("plan", "Bottle", "--proposer", "learned", "--affordance-png", "."), "is not a PNG file"),
        (("plan", "Bottle", "--split", "sen"), "sen"),
        (("plan", "Bottle", "--sed", "1"), "--sed"),
        (("plan",), "CATEGORY"),
        (("verify",), "RUN_DIR"),
        (("verify", "/no/such/run"), "Run folder /no/such/run does not exist."),
        (("run", "/no/such/run"), "Run folder /no/such/run does not exist."),
        (("why", "/no/such/run"), "Run folder /no/such/run does not exist."),
        (("view", "/no/such/run"), "Run folder /no/such/run does not exist."),
        (("view", ".", "--port", "99999"), "--port 99999 is not a port; give 1 to 65535."),
        (("assets", "Botle"), 'No category "Botle". Did you mean "Bottle"?'),
        (("assets", "--asset", "partnet:/no/such"), "/no/such"),
    ],
    ids=lambda value: " ".join(value)[:40] if isinstance(value, tuple) else "",
)
def test_a_wrong_argument_is_one_message(words: tuple[str, ...], message: str, tmp_path: Path) -> None:
    assert message in refused(*words, cwd=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_seed_that_is_no_number_is_told_in_words() -> None:
    assert "'x' is not a whole number" in refused("plan", "Bottle", "--seed", "x")


def test_an_error_under_json_is_an_object_too() -> None:
    done = bipre("plan", "Botle", "--json")
    assert done.returncode == 2
    error = answer(done)["error"]
    assert error["kind"] == "bad_input"
    assert 'Did you mean "Bottle"?' in error["message"]


def test_no_arguments_show_the_overview_and_are_wrong_use() -> None:
    done = bipre()
    assert done.returncode == 2
    assert "usage: bipre VERB" in done.stderr


# -- bad files -------------------------------------------------------------------------------------------------------


def test_a_corrupt_or_truncated_plan_is_one_message(run_dir: Path, tmp_path: Path) -> None:
    data = (run_dir / "plan.json").read_bytes()
    for name, bad in {"cut": data[: len(data) // 2], "corrupt": b"\x00\x01" + data, "empty": b""}.items():
        folder = tmp_path / name
        folder.mkdir()
        (folder / "plan.json").write_bytes(bad)
        for verb in ("verify", "run"):
            text = refused(verb, str(folder))
            assert text.startswith(f"{folder}/plan.json cannot be read as a plan: ")
            assert text.endswith("Plan again to make a new one.")
        assert [entry.name for entry in folder.iterdir()] == ["plan.json"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("thickness = 0.04", "thicknes = 0.04", 'unknown field `thicknes` - at `$.table`. Did you mean "thickness"?'),
        ("velocity = [2.1750,", "velocity = [-2.1750,", "velocity[0]"),
    ],
)
def test_a_bad_workcell_is_one_message(old: str, new: str, words: str, tmp_path: Path) -> None:
    cell = (resources.files("robots") / "workcells" / "panda_pair.toml").read_text("utf-8")
    assert old in cell
    file = tmp_path / "cell.toml"
    file.write_text(cell.replace(old, new))
    text = refused("plan", "Bottle", "--workcell", str(file), "--out", str(tmp_path / "run"))
    assert f"Workcell {file}: " in text
    assert words in text
    assert not (tmp_path / "run").exists()


@pytest.fixture
def object_folder(tmp_path: Path) -> Path:
    """A folder with one real bottle that may be damaged."""
    if not PARTNET.is_dir():
        pytest.skip("../shared/assets is absent")
    source = tmp_path / "objects"
    shutil.copytree(PARTNET / "Bottle" / "3763", source / "Bottle" / "3763")
    return source


def damaged(folder: Path, tmp_path: Path) -> str:
    text = refused(
        "plan", "Bottle", "--asset", f"partnet:{folder}", "--instance", "3763", "--out", str(tmp_path / "run")
    )
    assert not (tmp_path / "run").exists()
    assert "3763" in text
    return text


def test_a_urdf_with_a_missing_mesh_is_one_message(object_folder: Path, tmp_path: Path) -> None:
    mesh = sorted((object_folder / "Bottle" / "3763" / "textured_objs").glob("*.obj"))[0]
    mesh.unlink()
    assert mesh.name in damaged(object_folder, tmp_path)


def test_a_mesh_with_nan_is_one_message(object_folder: Path, tmp_path: Path) -> None:
    for mesh in (object_folder / "Bottle" / "3763" / "textured_objs").glob("*.obj"):
        lines = mesh.read_text().splitlines()
        first = next(k for k, line in enumerate(lines) if line.startswith("v "))
        lines[first] = "v nan 0.0 0.0"
        mesh.write_text("\n".join(lines) + "\n")
    text = damaged(object_folder, tmp_path)
    assert "nan" in text.lower() or "finite" in text.lower()


def test_a_broken_urdf_is_one_message(object_folder: Path, tmp_path: Path) -> None:
    urdf = object_folder / "Bottle" / "3763" / "mobility.urdf"
    urdf.write_text(urdf.read_text()[:300])
    damaged(object_folder, tmp_path)
