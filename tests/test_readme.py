"""What the README promises runs as it stands there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tamp.cli.verbs import NAMES

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text("utf-8")


def test_the_python_example_runs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(compile(example, "README.md", "exec"), {})
    said = capsys.readouterr().out
    assert "pregrasp(left)" in said
    assert "verified" in said


def test_every_verb_is_listed_and_every_link_leads_somewhere() -> None:
    for verb in NAMES:
        assert f"| `bipre {verb}" in README
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert target.startswith("https://") or (ROOT / target).exists(), target


def test_make_has_the_two_commands() -> None:
    makefile = (ROOT / "Makefile").read_text("utf-8")
    for command in ("demo", "test"):
        assert f"\n{command}: " in makefile
        assert f"make {command}" in README
