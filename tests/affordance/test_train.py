"""Laws of training, on the stored episodes: it learns, it resumes exactly, it stops in time, it keeps what it did."""
# ruff: noqa: E402 - what needs torch is imported once it is known to be there

from __future__ import annotations

import json
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")
pytest.importorskip("h5py", reason="the extra `data` is not installed")

from affordance import checkpoint
from affordance.curves import series_in, write_curves
from affordance.dataset import Dataset
from affordance.fit import Task, fit, forecast
from affordance.objective import parts_of
from affordance.settings import Settings, settings_of
from affordance.text import HashText
from affordance.train import AVERAGE, CHECKPOINT, LOG, WEIGHTS, Fitting, begun, train
from robots.errors import BadInput, TrainingDiverged
from tamp.learning import examples_in

STORED = Path(__file__).parents[1] / "data" / "episodes"


def tensors_of(fitting: Fitting) -> dict[str, torch.Tensor]:
    """Every number that a training consists of, for comparing two."""
    found = dict(fitting.model.state_dict()) | {f"{AVERAGE}{k}": v for k, v in fitting.average.state_dict().items()}
    for name, weight in fitting.model.named_parameters():
        for key, value in fitting.optimiser.state.get(weight, {}).items():
            found[f"{key}.{name}"] = torch.as_tensor(value)
    return found


def settings(steps: int) -> Settings:
    small = settings_of("test")
    return msgspec.structs.replace(small, training=msgspec.structs.replace(small.training, batch=4, steps=steps))


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    learned, kept = examples_in([STORED])
    return Dataset([*learned, *kept], settings(1), HashText())


def fresh(steps: int, **more: bool) -> Fitting:
    torch.set_num_threads(1)
    return begun(settings(steps), seed=3, text_backend="hash", **more)


def silent(step: int, line: object) -> None:
    """Nobody watches."""


def test_what_is_shown_again_is_learned(dataset: Dataset, tmp_path: Path) -> None:
    train(fresh(60), dataset, None, tmp_path, silent)
    losses = series_in(tmp_path / LOG)["loss"][1]
    assert losses[-1] < 0.75 * losses[0]
    assert checkpoint.load(tmp_path / WEIGHTS).step == 60
    assert write_curves(tmp_path / LOG, tmp_path / "curves.png").read_bytes().startswith(b"\x89PNG")


def test_stopping_and_going_on_changes_no_bit(dataset: Dataset, tmp_path: Path) -> None:
    whole, half = fresh(6), fresh(6)
    for _ in range(6):
        whole.advance(dataset, "cpu")
    for _ in range(3):
        half.advance(dataset, "cpu")
    half.save(tmp_path)
    again = fresh(6)
    again.go_on_from(checkpoint.load(tmp_path / CHECKPOINT))
    for _ in range(3):
        again.advance(dataset, "cpu")
    ours, theirs = tensors_of(again), tensors_of(whole)
    assert ours.keys() == theirs.keys() and again.step == whole.step == 6
    assert all(torch.equal(ours[name], theirs[name]) for name in theirs)


def test_an_interruption_waits_for_the_step_and_keeps_what_was_done(dataset: Dataset, tmp_path: Path) -> None:
    """Interrupted in the middle of a step, it ends that step, and resuming changes no bit."""
    whole, fitting = fresh(6), fresh(6)
    for _ in range(6):
        whole.advance(dataset, "cpu")

    def at_step_three(*args: Any, **more: Any) -> Any:
        if args[3] == 2:
            signal.raise_signal(signal.SIGINT)
        return parts_of(*args, **more)

    with pytest.raises(KeyboardInterrupt):
        train(fitting, dataset, None, tmp_path, silent, loss_of=at_step_three)
    found = checkpoint.load(tmp_path / CHECKPOINT)
    assert found.step == 3 and not (tmp_path / WEIGHTS).exists()
    again = fresh(6)
    again.go_on_from(found)
    train(again, dataset, None, tmp_path, silent)
    ours, theirs = tensors_of(again), tensors_of(whole)
    assert all(torch.equal(ours[name], theirs[name]) for name in theirs)


def test_a_training_that_diverges_keeps_its_last_checkpoint(dataset: Dataset, tmp_path: Path) -> None:
    fitting = fresh(20)
    fitting.advance(dataset, "cpu")
    fitting.save(tmp_path)
    before = (tmp_path / CHECKPOINT).read_bytes()

    def steep(*args: Any, **more: Any) -> Any:
        parts = parts_of(*args, **more)
        return replace(parts, opening_goal=parts.opening_goal.sqrt() * 0.0 + (parts.opening_goal * 0.0).sqrt())

    with pytest.raises(TrainingDiverged, match="the gradient is not a finite number"):
        train(fitting, dataset, None, tmp_path, silent, loss_of=steep)
    assert (tmp_path / CHECKPOINT).read_bytes() == before
    assert all(bool(torch.isfinite(weight).all()) for weight in fitting.model.parameters())


def test_the_log_forgets_what_came_after_the_checkpoint(dataset: Dataset, tmp_path: Path) -> None:
    lines = [json.dumps({"step": step, "loss": 1.0}) for step in (20, 40)]
    (tmp_path / LOG).write_text("\n".join([*lines, '{"step": 60, "lo']), "utf-8")
    fitting = fresh(21)
    fitting.step = 20
    train(fitting, dataset, None, tmp_path, silent)
    assert [json.loads(line)["step"] for line in (tmp_path / LOG).read_text("utf-8").splitlines()] == [20, 21]


def test_a_loss_that_is_not_a_number_stops_before_any_weight_changes(dataset: Dataset) -> None:
    fitting = fresh(10)
    before = {name: weight.detach().clone() for name, weight in fitting.model.named_parameters()}

    def broken(*args: object, **more: object) -> object:
        return replace(parts_of(*args, **more), push=torch.tensor(float("nan")))  # type: ignore[arg-type]

    with pytest.raises(TrainingDiverged, match=r"step 0: the loss of push is not a finite number"):
        fitting.advance(dataset, "cpu", broken)  # type: ignore[arg-type]
    assert fitting.step == 0
    assert all(torch.equal(weight, before[name]) for name, weight in fitting.model.named_parameters())


def test_the_mean_follows_the_weights(dataset: Dataset) -> None:
    fitting = fresh(10)
    before = [weight.detach().clone() for weight in fitting.average.parameters()]
    fitting.advance(dataset, "cpu")
    for old, mean, weight in zip(before, fitting.average.parameters(), fitting.model.parameters(), strict=True):
        assert torch.allclose(mean, old + (1.0 - 0.1) * (weight - old), atol=1e-6)


def test_the_rate_falls_along_a_cosine() -> None:
    fitting = fresh(100)
    rates = []
    for step in (0, 50, 100, 200):
        fitting.step = step
        rates.append(fitting.rate())
    assert rates == pytest.approx([1e-3, 0.5 * (1e-3 + 1e-5), 1e-5, 1e-5])


def test_adapting_changes_judges_and_maps_alone(dataset: Dataset) -> None:
    start = begun(settings(4), seed=1, text_backend="hash")
    path = checkpoint.Checkpoint(start.model, "hash", 4, {})
    fitting = begun(settings(4), seed=3, text_backend="hash", start=path, adapting=True)
    before = {name: tensor.clone() for name, tensor in fitting.model.state_dict().items()}
    for _ in range(3):
        fitting.advance(dataset, "cpu")
    for state in (fitting.model.state_dict(), fitting.average.state_dict()):
        changed = {name for name, tensor in state.items() if not torch.equal(tensor, before[name])}
        assert changed and all(name.startswith(("critics.", "goal.scorer.", "pre.scorer.")) for name in changed)


def test_fitting_goes_on_where_it_ended(tmp_path: Path) -> None:
    learned, kept = examples_in([STORED])
    tasks = [Task(learned, kept, settings(steps), 0, "cpu", 1, None, False) for steps in (2, 4)]
    assert fit(tasks[0], tmp_path, silent).steps == 2
    done = fit(tasks[1], tmp_path, silent)
    assert (done.steps, done.rows, done.held_out) == (4, len(learned), len(kept))
    (tmp_path / "adapted").mkdir()
    assert fit(replace(tasks[0], start=Path(done.weights), adapting=True), tmp_path / "adapted", silent).steps == 2
    (tmp_path / "longer").mkdir()
    longer = fit(replace(tasks[0], start=Path(done.weights)), tmp_path / "longer", silent)
    actors = [
        {n: w for n, w in checkpoint.load(Path(path)).model.state_dict().items() if n.startswith("goal.orientation.")}
        for path in (done.weights, tmp_path / "adapted" / WEIGHTS, longer.weights)
    ]
    assert all(torch.equal(actors[0][n], actors[1][n]) for n in actors[0])
    assert any(not torch.equal(actors[0][n], actors[2][n]) for n in actors[0])


def test_what_is_asked_for_must_be_what_the_weights_to_begin_with_have(tmp_path: Path) -> None:
    made = begun(settings(1), seed=1, text_backend="hash")
    path = made.give_out(tmp_path)
    task = Task([], [], settings(1), 0, "cpu", 1, path, False)
    other = msgspec.structs.replace(settings(1), anticipation=False, head="flow")
    assert replace(task, settings=other).begun().settings.head == "cvae"
    assert replace(task, asked=("profile", "losses", "head", "anticipation")).begun().settings.head == "cvae"
    for name, option in (("head", "--head"), ("anticipation", "--no-anticipation")):
        with pytest.raises(BadInput, match=f"trained with another {option} than asked for"):
            replace(task, settings=other, asked=(name,)).begun()


def test_half_precision_changes_little(dataset: Dataset) -> None:
    half = msgspec.structs.replace(settings(2), training=msgspec.structs.replace(settings(2).training, bf16=True))
    exact, coarse = (begun(s, seed=1, text_backend="hash") for s in (settings(2), half))
    losses = [float(f.advance(dataset, "cpu").critic_goal) for f in (exact, coarse)]
    assert losses[0] != losses[1]
    assert losses[0] == pytest.approx(losses[1], rel=0.05)


def test_a_forecast_writes_nothing_and_tells_sizes(tmp_path: Path) -> None:
    learned, kept = examples_in([STORED])
    told = forecast(Task(learned, kept, settings(1000), 0, "cpu", 1, None, False))
    assert told.rows == len(learned) and told.steps == 1000
    assert (
        told.parameters > 3e6
        and told.megabytes > 100
        and told.hours == pytest.approx(told.seconds_per_step / 3.6, abs=0.006)
    )
    assert np.isfinite(told.seconds_per_step)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device here")
def test_an_absent_device_is_said() -> None:
    learned, kept = examples_in([STORED])
    with pytest.raises(BadInput, match="torch sees no CUDA device"):
        forecast(Task(learned, kept, settings(1), 0, "cuda", 1, None, False))


def test_weights_alone_are_no_checkpoint(tmp_path: Path) -> None:
    path = fresh(2).give_out(tmp_path)
    with pytest.raises(BadInput, match="networks without their training"):
        fresh(2).go_on_from(checkpoint.load(path))
